"""Damaged files: intact parts are read and losses reported, or there is one clear error."""

from __future__ import annotations

import logging
import struct
from collections.abc import Callable

import numpy as np
import pytest
import yaml
from damage import DAMAGES, Sample, cut, outcome, samples
from reading import read_recording
from recording_files import camchain

from gpvo.recordings import open_recording
from gpvo.recordings.files.aedat4 import MAGIC
from gpvo.recordings.streams import EventBlock

FORMATS = (
    "dsec",
    "rosbag1",
    "mcap",
    "aedat4",
    "raw evt3",
    "raw evt2",
    "raw evt2.1",
    "text",
    "rosbag1 packets",
    "rosbag2 packets",
)
WITHOUT_AN_END = ("raw evt3", "raw evt2", "raw evt2.1", "text")
"""Formats whose files may end anywhere."""

Intact = dict[str, tuple[Sample, bytes, tuple[EventBlock, EventBlock]]]


@pytest.fixture(scope="module")
def intact(tmp_path_factory: pytest.TempPathFactory) -> Intact:
    logging.getLogger("gpvo.recordings").setLevel(logging.CRITICAL)
    folder = tmp_path_factory.mktemp("damage")
    calibration = folder / "calibration.yaml"
    calibration.write_text(yaml.safe_dump(camchain()))
    found = samples(folder, calibration)
    assert tuple(found) == FORMATS
    return {
        name: (
            sample,
            sample.damaged.read_bytes(),
            read_recording(open_recording(sample.path, sample.calibration)),
        )
        for name, sample in found.items()
    }


@pytest.mark.parametrize("damage", DAMAGES)
@pytest.mark.parametrize("name", FORMATS)
def test_damage(intact: Intact, name: str, damage: Callable) -> None:
    sample, whole, expected = intact[name]
    rng = np.random.default_rng(7)
    outcomes = []
    try:
        for _ in range(5):
            sample.damaged.write_bytes(damage(whole, rng))
            outcomes.append(outcome(sample, expected, damage is cut))
    finally:
        sample.damaged.write_bytes(whole)
    assert outcome(sample, expected, True) == "whole"
    assert set(outcomes) != {"whole"}
    if damage is cut and name not in WITHOUT_AN_END:
        assert "untold" not in outcomes


@pytest.mark.parametrize("name", ["rosbag1", "rosbag1 packets"])
def test_a_bag_without_its_end_loses_its_end_only(intact: Intact, name: str) -> None:
    """A killed recorder leaves no index, no list of topics, and half a chunk."""
    sample, whole, expected = intact[name]
    try:
        sample.damaged.write_bytes(whole[: len(whole) * 3 // 5])
        recording = open_recording(sample.path, sample.calibration)
        ours = read_recording(recording)
    finally:
        sample.damaged.write_bytes(whole)
    for block, theirs in zip(ours, expected, strict=True):
        assert len(block) > 0.4 * len(theirs)
        np.testing.assert_array_equal(block.t_ns, theirs.t_ns[: len(block)])
    assert any("cut short" in note and "% of the file" in note for note in recording.notes)  # type: ignore[attr-defined]


def test_aedat4_cut_between_packets_tells_it(intact: Intact) -> None:
    """All packets are whole; only the header shows that more should follow them."""
    sample, unfinished, expected = intact["aedat4"]
    whole = unfinished.replace(struct.pack("<q", -1), struct.pack("<q", len(unfinished)), 1)
    at = len(MAGIC) + 4 + struct.unpack_from("<I", whole, len(MAGIC))[0]
    at += 8 + struct.unpack_from("<ii", whole, at)[1]
    at += 8 + struct.unpack_from("<ii", whole, at)[1]
    try:
        sample.damaged.write_bytes(whole)
        assert outcome(sample, expected, only_cut=True) == "whole"
        sample.damaged.write_bytes(whole[:at])
        assert outcome(sample, expected, only_cut=True) == "told"
    finally:
        sample.damaged.write_bytes(unfinished)
