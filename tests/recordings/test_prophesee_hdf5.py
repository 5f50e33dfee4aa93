"""Prophesee's HDF5, packed by a filter of h5py or by a plugin that is missing."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from encoders import event_block
from reading import assert_recording_holds

from gpvo.errors import InputError
from gpvo.recordings import Events, open_recording
from gpvo.recordings.files.prophesee_hdf5 import ECF
from gpvo.recordings.streams import EventBlock

LEFT, RIGHT = event_block(900, 1), event_block(800, 2)


def prophesee_file(path: Path, block: EventBlock, **packing: Any) -> Path:
    """Write the table CD/events; `packing` is passed to h5py."""
    kinds = [("x", "<u2"), ("y", "<u2"), ("p", "<i2"), ("t", "<i8")]
    table = np.empty(len(block), kinds)
    table["x"], table["y"], table["p"] = block.x, block.y, block.polarity
    table["t"] = block.t_ns // 1000
    with h5py.File(path, "w") as file:
        events = file.create_dataset("CD/events", table.shape, kinds, **packing)
        if packing.get("compression") == ECF:
            events.id.write_direct_chunk((0,), table.tobytes())
        else:
            events[:] = table
    return path


def test_prophesee_hdf5(tmp_path: Path, calibration: Path) -> None:
    for side, block in (("left", LEFT), ("right", RIGHT)):
        prophesee_file(tmp_path / f"a_{side}.hdf5", block, compression="gzip", chunks=(100,))
    recording = open_recording(tmp_path, calibration)
    assert_recording_holds(recording, LEFT, RIGHT)
    late = Events.concatenate([batch.left for batch in recording.event_batches(0.2)])
    kept = LEFT.t_ns >= recording.start_ns + 200_000_000
    np.testing.assert_array_equal(late.x, LEFT.x[kept])


def test_prophesee_hdf5_without_the_plugin(tmp_path: Path, calibration: Path) -> None:
    if h5py.h5z.filter_avail(ECF):
        pytest.skip("Prophesee's plugin is installed")
    for side, block in (("left", LEFT), ("right", RIGHT)):
        prophesee_file(
            tmp_path / f"a_{side}.hdf5",
            block,
            compression=ECF,
            allow_unknown_filter=True,
            chunks=(len(block),),
        )
    with pytest.raises(InputError, match=r"packed by Prophesee's ECF; set HDF5_PLUGIN_PATH"):
        open_recording(tmp_path / "a_left.hdf5", calibration)


def test_another_table_is_refused(tmp_path: Path, calibration: Path) -> None:
    for side in ("left", "right"):
        with h5py.File(tmp_path / f"{side}.hdf5", "w") as file:
            file["CD/events"] = np.zeros(3)
    with pytest.raises(InputError, match="is not a table of x, y, p and t"):
        open_recording(tmp_path, calibration)
