"""The events of a live run are kept in a file, and a disk that is full ends no run."""

from __future__ import annotations

import errno
from pathlib import Path

import numpy as np
import pytest

from gpvo.errors import InputError, OutputError
from gpvo.live.recorder import PIECE_NS, Recorder
from gpvo.recordings import Camera, StereoRig
from gpvo.recordings.streams import EventBlock
from gpvo.recordings.writing.convert import WRITERS
from gpvo.recordings.writing.writer import RecordingWriter, Sizes

LENS = Camera((16, 12), np.array([20.0, 20, 8, 6]), "none", np.zeros(4), np.eye(3))
RIG = StereoRig(LENS, LENS, 20.0, (8.0, 6.0), 0.1)


def block(t_ns: int) -> EventBlock:
    one = np.ones(1, np.uint16)
    return EventBlock(one, one, np.array([t_ns], np.int64), np.ones(1, bool))


class FullDisk(RecordingWriter):
    """Takes one piece, and no more."""

    pieces = 0

    def __init__(self, path: Path, sizes: Sizes, start_ns: int) -> None:
        del sizes, start_ns
        path.touch()

    def append(self, *blocks: EventBlock) -> None:
        del blocks
        FullDisk.pieces += 1
        if FullDisk.pieces > 1:
            raise OSError(errno.ENOSPC, "No space left on device")

    def close(self) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")


def test_a_full_disk_is_said_at_the_end_and_what_comes_after_is_not_kept_in_memory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(WRITERS, "mvsec", FullDisk)
    recorder = Recorder(tmp_path / "kept.hdf5", RIG)
    for k in range(8):
        recorder(block(k * PIECE_NS), block(k * PIECE_NS))
    recorder.close()
    assert FullDisk.pieces == 2 and recorder._pieces.empty()
    with pytest.raises(OutputError, match=r"kept\.hdf5: .* ends early \(No space left"):
        recorder.check()


def test_another_calibration_beside_it_is_not_replaced(tmp_path: Path) -> None:
    (tmp_path / "kept.camchain.yaml").write_text("cam0: another")
    with pytest.raises(InputError, match=r"kept\.camchain\.yaml: exists, with another calibration"):
        Recorder(tmp_path / "kept.hdf5", RIG)
