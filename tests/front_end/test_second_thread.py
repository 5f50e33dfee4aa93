"""Calls in a second thread: in order, each result once, and nothing left running."""

from __future__ import annotations

import multiprocessing
from threading import Event, get_ident

import pytest

from gpvo.second_thread import Begun, SecondThread, both


def test_each_result_is_given_once_and_what_a_call_raises_where_it_is_asked_for() -> None:
    thread = SecondThread[int]()
    assert list(thread.done()) == list(thread.wait()) == []
    goes_on = Event()
    thread.start(lambda: 1 if goes_on.wait(60) else 0)
    assert list(thread.done()) == []
    goes_on.set()
    thread.settle()
    assert list(thread.done()) == [1] and list(thread.wait()) == []
    thread.start(lambda: 1 // 0)
    thread.settle()
    with pytest.raises(ZeroDivisionError):
        list(thread.done())
    assert list(thread.wait()) == []


def test_both_calls_are_made_at_once() -> None:
    first, second = Event(), Event()

    def meet(own: Event, other: Event) -> tuple[bool, int]:
        own.set()
        return other.wait(60), get_ident()

    (met, thread), (met_too, other) = both(lambda: meet(first, second), lambda: meet(second, first))
    assert met and met_too and thread == get_ident() != other


def test_the_second_is_made_here_while_the_other_thread_is_busy() -> None:
    began, goes_on = Event(), Event()

    def busy() -> int:
        thread, second = both(get_ident, get_ident)
        goes_on.set()
        assert thread == second == get_ident()
        return thread

    assert both(lambda: began.wait(60) and busy(), lambda: began.set() or goes_on.wait(60))[1]


def test_what_was_begun_is_made_once_by_whom_it_may() -> None:
    """By who asks where the thread is busy, and what it raises is raised each time."""
    made, goes_on = list[int](), Event()
    busy = Begun(lambda: goes_on.wait(60))
    waiting, failing = Begun(lambda: made.append(get_ident())), Begun(lambda: 1 // 0)
    for _ in range(2):
        assert waiting.result() is None
    assert made == [get_ident()]
    for _ in range(2):
        with pytest.raises(ZeroDivisionError):
            failing.result()
    goes_on.set()
    assert busy.result()
    began = Event()
    beside = Begun(lambda: began.set() or get_ident())
    assert began.wait(60) and beside.result() != get_ident()


def test_an_error_of_the_first_leaves_nothing_running() -> None:
    ended = Event()
    with pytest.raises(ZeroDivisionError):
        both(lambda: 1 // 0, ended.set)
    seen = ended.is_set()
    assert both(lambda: 1, lambda: 2) == (1, 2) and ended.is_set() == seen


def test_a_forked_process_has_a_second_thread_of_its_own() -> None:
    both(int, int)
    with multiprocessing.get_context("fork").Pool(1) as pool:
        assert pool.apply_async(both, (int, int)).get(timeout=60) == (0, 0)
