"""Interface of bags: topics and their serialised messages."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar, NamedTuple

from gpvo.recordings.streams import Faults


class Topic(NamedTuple):
    """One topic of a log.

    `type` is package/Name without the /msg/ of ROS 2; `encoding` is "ros1" or "cdr"; `digest` is
    the md5 of a ROS 1 definition, empty for ROS 2.
    """

    name: str
    type: str
    encoding: str
    digest: str = ""


class MessageLog(ABC):
    """A file of messages on topics.

    Attributes
    ----------
    name
        Name of the format, for reports.
    path
        The file or folder.
    topics
        Topics by name.
    notes
        What could not be read when it was opened.
    """

    name: ClassVar[str]
    path: Path
    topics: dict[str, Topic]
    notes: list[str]

    @abstractmethod
    def messages(self, topic: str, faults: Faults, backwards: bool = False) -> Iterator[memoryview]:
        """Yield the serialised messages of a topic, in the order of the file or backwards.

        Damage is skipped and counted in `faults`.
        """
