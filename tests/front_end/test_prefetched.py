"""Prefetched items are the same, in the same order, and fail at the same place."""

from __future__ import annotations

import threading
from collections.abc import Iterator

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gpvo.second_thread import prefetched


@given(st.lists(st.integers()), st.integers(1, 5))
@settings(deadline=None, max_examples=30)
def test_items_come_in_order(items: list[int], ahead: int) -> None:
    assert list(prefetched(iter(items), ahead)) == items


def test_a_failure_comes_after_the_items_before_it() -> None:
    def failing() -> Iterator[int]:
        yield from range(5)
        raise ValueError("the sixth")

    coming = prefetched(failing())
    assert [next(coming) for _ in range(5)] == list(range(5))
    with pytest.raises(ValueError, match="the sixth"):
        next(coming)


def test_no_more_is_read_than_asked_for_and_none_in_this_thread() -> None:
    readers, made = set(), []

    def items() -> Iterator[int]:
        for item in range(100):
            readers.add(threading.get_ident())
            made.append(item)
            yield item

    coming = prefetched(items(), ahead=3)
    assert [next(coming), next(coming)] == [0, 1]
    coming.close()
    assert len(made) <= 2 + 3
    assert len(readers) == 1 and threading.get_ident() not in readers
