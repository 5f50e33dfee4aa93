"""ROS 2 bags: a folder or a single file of SQLite or MCAP storage."""

from __future__ import annotations

import re
import sqlite3
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import quote

import zstandard

from gpvo.errors import InputError
from gpvo.recordings.bags.mcap import McapFile
from gpvo.recordings.bags.message_log import MessageLog, Topic
from gpvo.recordings.bags.topics import event_topics
from gpvo.recordings.compression import LARGEST_CHUNK
from gpvo.recordings.streams import DAMAGED, Faults

MAGIC = b"SQLite format 3\0"
ZSTD = b"\x28\xb5\x2f\xfd"
KINDS = (".db3", ".mcap", ".db3.zstd", ".mcap.zstd")
NUMBER = re.compile(r"_\d+(?=\.(?:db3|mcap)(?:\.zstd)?$)", re.IGNORECASE)
"""Number of a file, of several that the recorder made of one bag."""


def is_rosbag2(path: Path) -> bool:
    """Return whether a folder contains storage files of ROS 2, or a file is one of SQLite."""
    if path.is_dir():
        return bool(_storage_files(path))
    with path.open("rb") as file:
        return file.read(len(MAGIC)) == MAGIC


def open_rosbag2(path: Path) -> MessageLog:
    """Open a bag and read its files as one.

    metadata.yaml is not needed, as it is missing if the recorder was killed.
    """
    files = _storage_files(path) if path.is_dir() else [path]
    packed = [file for file in files if file.suffix.lower() == ".zstd"]
    if packed:
        raise InputError(f"{packed[0]}: is compressed as a whole; unpack it with zstd -d first")
    logs: list[MessageLog] = [
        McapFile(file) if McapFile.recognise(file) else SqliteBag(file) for file in files
    ]
    if len(logs) == 1:
        return logs[0]
    _check_one_bag(path, logs)
    return SplitBag(path, logs)


def _storage_files(folder: Path) -> list[Path]:
    files = [file for file in folder.iterdir() if file.name.lower().endswith(KINDS)]
    return sorted(files, key=lambda file: (len(file.name), file.name))


def _check_one_bag(folder: Path, logs: Sequence[MessageLog]) -> None:
    """Raise InputError unless the files are numbered parts, or have topics of their own."""
    if len({NUMBER.sub("", log.path.name) for log in logs}) == 1:
        return
    if max(Counter(name for log in logs for name in event_topics(log)).values(), default=0) > 1:
        names = " ".join(str(log.path) for log in logs)
        raise InputError(f"{folder}: holds several recordings; name one: {names}")


@dataclass
class SplitBag(MessageLog):
    """A bag in several files, in the order of their numbers."""

    name = "ROS 2 bag"

    path: Path
    logs: list[MessageLog]

    def __post_init__(self) -> None:
        self.topics = {name: topic for log in self.logs for name, topic in log.topics.items()}
        self.notes = [note for log in self.logs for note in log.notes]

    def messages(self, topic: str, faults: Faults, backwards: bool = False) -> Iterator[memoryview]:
        for log in reversed(self.logs) if backwards else self.logs:
            if topic in log.topics:
                yield from log.messages(topic, faults, backwards)


@dataclass
class SqliteBag(MessageLog):
    """SQLite storage of ROS 2.

    Raises
    ------
    InputError
        If it is no such database, or its table of topics is damaged.
    """

    name = "ROS 2 bag (SQLite)"

    path: Path
    topics: dict[str, Topic] = field(init=False)
    notes: list[str] = field(init=False, default_factory=list)

    def __post_init__(self) -> None:
        try:
            with closing(self._connect()) as database:
                rows = database.execute("SELECT id, name, type FROM topics").fetchall()
        except (sqlite3.Error, UnicodeDecodeError, OverflowError) as error:
            raise InputError(
                f"{self.path}: cannot be read as a ROS 2 bag ({error}); copy it again"
            ) from error
        if _missing_bytes(self.path):
            self.notes.append(
                f"{self.path}: the file is cut short, {_missing_bytes(self.path)} bytes of it are"
                " missing; copy it again, or go on with what is intact"
            )
        named = [(number, str(name), str(kind)) for number, name, kind in rows]
        self.topics = {
            name: Topic(name, kind.replace("/msg/", "/"), "cdr") for _, name, kind in named
        }
        self._numbers = {name: number for number, name, _ in named}

    def messages(self, topic: str, faults: Faults, backwards: bool = False) -> Iterator[memoryview]:
        order = "DESC" if backwards else "ASC"
        query = (
            f"SELECT data FROM messages WHERE topic_id = ? ORDER BY timestamp {order}, id {order}"
        )
        try:
            with closing(self._connect()) as database:
                for (data,) in database.execute(query, (self._numbers[topic],)):
                    if isinstance(data, bytes):
                        yield memoryview(_unpacked(data))
                    else:
                        faults[DAMAGED] += 1
        except (sqlite3.Error, zstandard.ZstdError, OverflowError, UnicodeDecodeError):
            faults[DAMAGED] += 1

    def _connect(self) -> sqlite3.Connection:
        # Make no lock or journal beside a recording; read the journal of a killed recorder.
        journal = self.path.with_name(self.path.name + "-wal").exists()
        mode = "mode=ro" if journal else "immutable=1"
        return sqlite3.connect(f"file:{quote(str(self.path.absolute()))}?{mode}", uri=True)


def _missing_bytes(path: Path) -> int:
    """Return the bytes that a database lacks according to its header; SQLite reads zeros there."""
    with path.open("rb") as file:
        header = file.read(32)
    page = int.from_bytes(header[16:18], "big")
    size = (65536 if page == 1 else page) * int.from_bytes(header[28:32], "big")
    return max(0, size - path.stat().st_size)


def _unpacked(data: bytes) -> bytes:
    """Return a message, decompressed if the recorder compressed it."""
    if data[:4] != ZSTD:
        return data
    return zstandard.ZstdDecompressor().decompress(data, max_output_size=LARGEST_CHUNK)
