"""Keep the events of a live run in a file, while it runs."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from queue import SimpleQueue
from threading import Thread

from gpvo.errors import InputError, OutputError
from gpvo.recordings import StereoRig
from gpvo.recordings.streams import EventBlock
from gpvo.recordings.writing.convert import WRITERS, camchain_path, kind_of, require_free
from gpvo.recordings.writing.writer import RecordingWriter, write_camchain

PIECE_NS = 200_000_000
"""Events are written in pieces of this length."""


class Recorder:
    """Writes events in a thread of its own, in the format of the file's ending.

    Raises
    ------
    InputError
        If the ending says no format, or the file or another calibration beside it exists.
    """

    def __init__(self, path: Path, rig: StereoRig) -> None:
        self._path, self._rig, self._kind = path, rig, kind_of(path, asked=False)
        if path.exists():
            raise InputError(f"{path}: exists; name another file to record to")
        require_free(camchain_path(path, self._kind), rig)
        self._waiting: list[tuple[EventBlock, EventBlock]] = []
        self._begin_ns: int | None = None
        self._pieces: SimpleQueue[tuple[EventBlock, EventBlock] | None] = SimpleQueue()
        self._failure: OSError | None = None
        self._thread: Thread | None = None

    def __call__(self, left: EventBlock, right: EventBlock) -> None:
        """Take the next events of both cameras."""
        if len(left) + len(right) == 0:
            return
        newest = max(int(block.t_ns[-1]) for block in (left, right) if len(block))
        self._begin_ns = newest if self._begin_ns is None else self._begin_ns
        self._waiting.append((left, right))
        if newest - self._begin_ns >= PIECE_NS:
            self._hand_over()
            self._begin_ns = newest

    def close(self) -> None:
        """Write the rest and finish the file; `check` says whether it could be written."""
        self._hand_over()
        if self._thread is not None:
            self._pieces.put(None)
            self._thread.join()

    def check(self) -> None:
        """Check that all so far could be written.

        Raises
        ------
        OutputError
            If it could not.
        """
        if self._failure is not None:
            problem = self._failure.strerror or self._failure
            raise OutputError(f"{self._path}: the recording ends early ({problem})")

    def _hand_over(self) -> None:
        if self._waiting:
            left, right = zip(*self._waiting, strict=True)
            self._pieces.put((EventBlock.concatenate(left), EventBlock.concatenate(right)))
            if self._thread is None:
                self._thread = Thread(target=self._write, name="gpvo recorder")
                self._thread.start()
        self._waiting = []

    def _write(self) -> None:
        """Write the pieces until there are no more; after a failure they are taken and left out."""
        writer: RecordingWriter | None = None
        while (piece := self._pieces.get()) is not None:
            if self._failure is None:
                with self._failing():
                    writer = writer or self._begin(*piece)
                    writer.append(*piece)
        if writer is not None:
            with self._failing():
                writer.close()

    @contextmanager
    def _failing(self) -> Iterator[None]:
        """Keep the first failure to write."""
        try:
            yield
        except OSError as error:
            self._failure = self._failure or error

    def _begin(self, left: EventBlock, right: EventBlock) -> RecordingWriter:
        start_ns = min(int(block.t_ns[0]) for block in (left, right) if len(block))
        self._path.parent.mkdir(parents=True, exist_ok=True)
        sizes = self._rig.left.resolution, self._rig.right.resolution
        writer = WRITERS[self._kind](self._path, sizes, start_ns)
        write_camchain(camchain_path(self._path, self._kind), self._rig)
        return writer
