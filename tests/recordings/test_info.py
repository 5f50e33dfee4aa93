"""`gpvo info` and `gpvo convert`: what they print and write, and one line for bad input."""

from __future__ import annotations

import logging
from pathlib import Path

import numpy as np
import pytest
from bag_files import event_arrays, types, write_rosbag1
from encoders import START_NS, column_file, event_block, evt3_words, raw_file, shifted
from hypothesis import given, settings
from hypothesis import strategies as st
from reading import assert_recording_holds
from recording_files import HEIGHT, WIDTH
from typer.testing import CliRunner

from gpvo.commands.cli import app
from gpvo.commands.info import open_for_info, summarise
from gpvo.errors import InputError
from gpvo.recordings import open_recording, read_calibration
from gpvo.recordings.checks.clock_offset import BIN, clock_offset
from gpvo.recordings.files.hdf5_columns import DSEC, ColumnStream
from gpvo.recordings.stereo import StreamRecording
from gpvo.recordings.streams import EventBlock

LEFT, RIGHT = event_block(900, 1, seconds=0.3), event_block(800, 2, seconds=0.3)


def invoke(*arguments: object) -> str:
    """Return the standard output of a command; InputError passes through."""
    result = CliRunner(env={"COLUMNS": "200"}).invoke(app, [str(one) for one in arguments])
    if isinstance(result.exception, InputError):
        raise result.exception
    assert result.exit_code == 0, result.output
    return result.output


def test_info_of_a_bag(tmp_path: Path, calibration: Path) -> None:
    store = types(True)
    late = shifted(RIGHT, 200_000_000)
    right = EventBlock.concatenate([RIGHT[RIGHT.t_ns < START_NS + 100_000_000], late])
    messages = event_arrays(store, "/davis/left/events", LEFT, True)
    messages += event_arrays(store, "/davis/right/events", right, True)
    path = write_rosbag1(tmp_path / "a.bag", messages)
    (tmp_path / "groundtruth.txt").write_text(
        "1500000000.1 0 0 0 0 0 0 1\n1500000000.3 1 0 0 0 0 0 1\n"
    )
    output = invoke("info", path, "--calibration", calibration)
    for fact in ("ROS 1 bag", "64 x 48", "0.100001 m", "900", f"{len(right):,}"):
        assert fact in output
    assert "1, longest 0.1" in output
    assert "groundtruth.txt: 2 poses from -0.02" in output


def test_names_are_printed_as_they_are(tmp_path: Path, calibration: Path) -> None:
    """Also those that the terminal's library takes for markup."""
    column_file(tmp_path / "left.h5", LEFT)
    column_file(tmp_path / "right.h5", RIGHT)
    output = tmp_path / "mk[" / "b]:bug:[red].hdf5"
    assert str(output) in invoke("convert", tmp_path, output, "--calibration", calibration)
    shown = invoke("info", output, "--calibration", calibration)
    assert "[/b]:bug:[red].hdf5" in "".join(shown.split())


def test_converted_recordings_have_calibrations_of_their_own(
    tmp_path: Path, calibration: Path
) -> None:
    """Beside their original, which keeps its own, and beside each other."""
    for side, block in (("left", LEFT), ("right", RIGHT)):
        column_file(tmp_path / f"{side}.h5", block)
    original = open_recording(tmp_path)
    for source, output in ((".", "room.bag"), (".", "room.mcap"), ("room.bag", "room.aedat4")):
        place = "in " + str(tmp_path / "room.camchain.yaml")
        assert place in invoke("convert", tmp_path / source, tmp_path / output)
        tables = open_recording(tmp_path / output).rig.tables
        np.testing.assert_array_equal(tables, original.rig.tables)
    invoke("convert", tmp_path / "left.h5", tmp_path / "b.bag")
    (tmp_path / "b.camchain.yaml").write_text("another")
    with pytest.raises(InputError, match=r"b\.camchain\.yaml: exists, with another calibration"):
        invoke("convert", tmp_path / "left.h5", tmp_path / "b.hdf5")
    calibration.with_name("camchain2.yaml").write_bytes(calibration.read_bytes())
    assert "several: camchain.yaml, camchain2.yaml" in invoke("info", tmp_path / "left.h5")


def test_info_tells_of_faults(tmp_path: Path, calibration: Path) -> None:
    x, t = LEFT.x.copy(), (LEFT.t_ns - START_NS) // 1000 + 5
    x[7], t[500] = 900, 3_000_000_000
    changes = {"events/x": x, "events/t": t.astype(np.uint32), "ms_to_idx": None}
    column_file(tmp_path / "left.h5", LEFT, **changes)
    column_file(tmp_path / "right.h5", RIGHT)
    output = invoke("info", tmp_path, "--calibration", calibration)
    assert "left.h5: events: 1 events outside the sensor were left out" in output
    assert "1 events with stamps that do not fit to those around them were left out" in output
    assert "warning" not in invoke(
        "info", write_clean(tmp_path / "clean"), "--calibration", calibration
    )


def test_faults_of_the_file_are_said_once_when_they_are_met(
    tmp_path: Path,
    calibration: Path,
    caplog: pytest.LogCaptureFixture,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Not at the end, not again by a second reading; info has them in its summary only."""
    caplog.set_level(logging.WARNING, logger="gpvo.recordings")
    monkeypatch.setattr("gpvo.recordings.files.hdf5_rows.BLOCK_ROWS", 100)
    monkeypatch.setattr("gpvo.recordings.checks.time_order.HELD_BACK", 16)
    x, at = LEFT.x.copy(), (LEFT.t_ns[400] - START_NS) / 1e9
    x[400:405] = 900
    files = column_file(tmp_path / "left.h5", LEFT, **{"events/x": x}), tmp_path / "right.h5"
    column_file(files[1], RIGHT)
    streams = [ColumnStream(file, DSEC) for file in files]
    rig = read_calibration(calibration)
    recording = StreamRecording(tmp_path, "columns", rig, *streams, batch_length=0.01)
    said = {batch.stop: len(caplog.messages) for batch in recording.event_batches()}
    first = min(stop for stop, count in said.items() if count)
    assert abs(first - at) < 0.05 and first < 0.6 * recording.duration
    list(recording.event_batches())
    (line,) = caplog.messages
    assert line.startswith(
        f"{files[0]}: events: events outside the sensor were left out, the first"
    )
    assert recording.faults.to_dict() == {"left": {"events outside the sensor were left out": 5}}
    caplog.clear()
    output = invoke("info", tmp_path, "--calibration", calibration)
    assert output.count("5 events outside the sensor") == 1 and not caplog.messages


def write_clean(folder: Path) -> Path:
    for side, block in (("left", LEFT), ("right", RIGHT)):
        column_file(folder / f"{side}.h5", block)
    return folder


def test_info_and_convert_without_a_calibration(tmp_path: Path, calibration: Path) -> None:
    for side, block in (("left", LEFT), ("right", RIGHT)):
        raw_file(tmp_path / f"raw/{side}.raw", evt3_words(shifted(block, -START_NS)))
    folder = tmp_path / "raw"
    calibration.rename(tmp_path / "elsewhere")
    output = invoke("info", folder)
    assert "not looked for without a calibration" in " ".join(output.replace("│", " ").split())
    assert "none found" in output and "64 x 48" in output
    output = invoke("convert", folder, tmp_path / "out/a.bag")
    assert "900 left and 800 right events; calibration none found" in output
    converted, calibrated = open_for_info(tmp_path / "out/a.bag", None, None, None)
    assert not calibrated
    assert_recording_holds(converted, shifted(LEFT, -START_NS), shifted(RIGHT, -START_NS))


@pytest.mark.parametrize(("to", "name"), [(None, "a.mcap"), ("dsec", "sequence"), ("aedat4", "x")])
def test_convert(tmp_path: Path, calibration: Path, to: str | None, name: str) -> None:
    options = ["--to", to] if to else []
    source = write_clean(tmp_path / "source")
    invoke("convert", source, tmp_path / "out" / name, "--calibration", calibration, *options)
    assert_recording_holds(open_recording(tmp_path / "out" / name), LEFT, RIGHT)
    with pytest.raises(InputError, match="exists"):
        invoke("convert", source, tmp_path / "out" / name, *options)


def bursts(seed: int) -> np.ndarray:
    """Return event rates of a moving scene, (1500,), one per bin."""
    rng = np.random.default_rng(seed)
    return 30 + 20 * np.sin(np.cumsum(rng.normal(0, 0.3, 1500)))


@settings(deadline=None, max_examples=25)
@given(offset=st.integers(-150, 150), seed=st.integers(0, 50))
def test_clock_offset_is_found(offset: int, seed: int) -> None:
    """In eight bands of rows, whose rates are not alike."""
    rng = np.random.default_rng(seed)
    rates = [bursts(9 * seed + band) for band in range(8)]
    left = np.array([rng.poisson(rate[200:1200]) for rate in rates])
    right = np.array([rng.poisson(rate[200 - offset : 1200 - offset]) for rate in rates])
    found = clock_offset(left, right)
    assert found is not None
    assert found.seconds == pytest.approx(offset * BIN, abs=0.002)
    assert found.is_apart == (abs(found.seconds) > 3 * found.deviation)
    assert found.is_apart or abs(offset) <= 9


def test_no_offset_without_a_sign_of_one() -> None:
    rng = np.random.default_rng(0)
    assert clock_offset(rng.poisson(20, (8, 1000)), rng.poisson(20, (8, 1000))) is None
    assert clock_offset(np.zeros((1, 1000), int), np.ones((1, 1000), int)) is None
    assert clock_offset(np.zeros((8, 0), int), np.ones((8, 3), int)) is None
    left, right = (np.array([bursts(seed + band)[:1000] for band in range(8)]) for seed in (0, 90))
    assert clock_offset(left, right) is None


def test_an_offset_is_reported(tmp_path: Path, calibration: Path) -> None:
    rng = np.random.default_rng(1)
    counts = rng.poisson(bursts(2) / 10)
    t_ns = START_NS + 2_000_000 * np.repeat(np.arange(1500), counts) + 500_000
    x = rng.integers(0, WIDTH, len(t_ns)).astype(np.uint16)
    y = rng.integers(0, HEIGHT, len(t_ns)).astype(np.uint16)
    block = EventBlock(x, y, t_ns, x % 2 > 0)
    column_file(tmp_path / "left.h5", block)
    column_file(tmp_path / "right.h5", shifted(block, 40_000_000))
    summary = summarise(open_recording(tmp_path, calibration))
    assert any("seem to be +0.040 s (within 0.00" in warning for warning in summary.warnings)
