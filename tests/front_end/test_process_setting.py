"""Settings of the process last until the last of all threads leaves."""

from __future__ import annotations

import gc
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Thread

import pytest

from gpvo.process_setting import SWITCH_INTERVAL, ProcessSetting, quick_switches, short_collections


def test_a_setting_is_made_once_and_taken_back_by_the_last_that_leaves() -> None:
    told: list[str] = []

    @contextmanager
    def tell() -> Iterator[None]:
        told.append("made")
        yield
        told.append("taken back")

    def enter_and_leave() -> None:
        with setting():
            pass

    setting = ProcessSetting(tell)
    with pytest.raises(ZeroDivisionError), setting():
        other = Thread(target=enter_and_leave)
        other.start()
        other.join()
        assert told == ["made"]
        raise ZeroDivisionError
    assert told == ["made", "taken back"]


def test_threads_switch_quickly_inside_only() -> None:
    before = sys.getswitchinterval()
    with quick_switches():
        assert sys.getswitchinterval() == pytest.approx(SWITCH_INTERVAL)
        assert sys.getswitchinterval() < before
    assert sys.getswitchinterval() == before


def test_what_exists_is_not_collected_inside_only() -> None:
    before = gc.get_freeze_count()
    with short_collections():
        assert gc.get_freeze_count() > before + 1000
        assert len(gc.get_objects()) < gc.get_freeze_count()
    assert gc.get_freeze_count() == 0
