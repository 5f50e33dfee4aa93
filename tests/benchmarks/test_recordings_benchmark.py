"""Benchmarks of the readers, on files of a few events."""

from __future__ import annotations

import sys

import pytest

from benchmarks import fuzz_recordings, recordings


def call(main: object, arguments: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", ["benchmark", *arguments.split()])
    assert callable(main)
    main()


def test_speeds_of_all_readers(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    call(recordings.main, "--seconds 0.1 --rate 20000", monkeypatch)
    printed = capsys.readouterr().out
    for name in ("ros 1 bag", "mcap", "mvsec", "dsec", "aedat4"):
        assert name in printed.lower()


def test_damage_of_all_formats(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    call(fuzz_recordings.main, "--count 1", monkeypatch)
    assert "whole" in capsys.readouterr().out
