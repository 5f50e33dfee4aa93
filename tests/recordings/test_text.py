"""Text files of strangers: columns in any order, units, names, separators, several cameras."""

from __future__ import annotations

from collections.abc import Callable
from itertools import permutations
from pathlib import Path

import numpy as np
import pytest
from encoders import START_NS, event_block, shifted
from reading import assert_recording_holds, assert_same_events, read_stream
from recording_files import HEIGHT, WIDTH

from gpvo.errors import InputError
from gpvo.recordings import open_recording
from gpvo.recordings.files.text import TextStream, cameras_in, is_text
from gpvo.recordings.files.text_layout import text_layout
from gpvo.recordings.streams import EventBlock, Faults

LEFT, RIGHT = event_block(4000, 1, seconds=0.05), event_block(3900, 2, seconds=0.05)
BEGIN = shifted(LEFT, -START_NS)
"""From 0 on, whole microseconds."""
ORDERS = sorted(
    {tuple(order) for order in permutations("txyp") if order.index("x") < order.index("y")}
)


def columns(block: EventBlock, unit_ns: int = 1000, fraction: str = "d") -> dict[str, list[str]]:
    """Return the fields of all lines by name."""
    t = block.t_ns // unit_ns if fraction == "d" else block.t_ns / unit_ns
    return {
        "t": [f"{one:{fraction}}" for one in t.tolist()],
        "x": [str(one) for one in block.x],
        "y": [str(one) for one in block.y],
        "p": [str(int(one)) for one in block.polarity],
    }


def write(path: Path, *fields: list[str], head: str = "", separator: str = " ") -> Path:
    lines = [separator.join(line) for line in zip(*fields, strict=True)]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(head + "\n".join(lines) + "\n")
    return path


@pytest.mark.parametrize("order", ORDERS, ids=" ".join)
def test_columns_are_found_in_any_order(tmp_path: Path, order: tuple[str, ...]) -> None:
    fields = columns(BEGIN)
    stream = TextStream(write(tmp_path / "a.txt", *(fields[name] for name in order)))
    assert_same_events(read_stream(stream), BEGIN)
    (note,) = stream.notes
    assert " ".join(order).replace("p", "polarity") in note and "t in microseconds" in note


UPTIME_NS = 1000 * 10**9
"""A sensor's clock after a quarter of an hour: in microseconds, seconds of the year 2001."""


@pytest.mark.parametrize("since", [0, UPTIME_NS, START_NS // 10**9 * 10**9])
@pytest.mark.parametrize(
    ("unit", "unit_ns", "fraction"),
    [
        ("s", 10**9, ".6f"),
        ("s", 10**9, ".9f"),
        ("ms", 10**6, ".3f"),
        ("us", 1000, "d"),
        ("us", 1000, ".1f"),
        ("ns", 1, "d"),
    ],
)
def test_units_are_found(
    tmp_path: Path, unit: str, unit_ns: int, fraction: str, since: int
) -> None:
    block = shifted(BEGIN, since)
    path = write(tmp_path / "a.txt", *columns(block, unit_ns, fraction).values())
    layout = text_layout(path)
    assert layout is not None and layout.unit == unit
    # float64 nanoseconds since 1970 resolve a quarter of a microsecond.
    assert_same_events(read_stream(TextStream(path)), block, 500 if since > UPTIME_NS else 0)
    assert bool(layout.note) == (unit != "s")


@pytest.mark.parametrize("place", [0, 2000, -1])
@pytest.mark.parametrize("far", ["100000.5", "1e15", "-1e15"])
@pytest.mark.parametrize(("unit", "unit_ns", "fraction"), [("s", 10**9, ".6f"), ("us", 1000, "d")])
def test_one_wrong_stamp_does_not_change_the_unit(
    tmp_path: Path, unit: str, unit_ns: int, fraction: str, far: str, place: int
) -> None:
    t, *rest = columns(BEGIN, unit_ns, fraction).values()
    t[place] = far
    layout = text_layout(write(tmp_path / "a.txt", t, *rest, head="# time x y p\n"))
    assert layout is not None and layout.unit == unit


@pytest.mark.parametrize("seconds", [0.02, 0.5, 2.0])
@pytest.mark.parametrize("unit_ns", [1, 1000, 10**9])
def test_units_are_found_at_rates_of_slow_and_fast_cameras(
    tmp_path: Path, seconds: float, unit_ns: int
) -> None:
    """2000 to 200,000 events per second."""
    block = shifted(event_block(4000, 3, seconds=seconds), -START_NS)
    fraction = "d" if unit_ns < 10**9 else ".9f"
    path = write(tmp_path / "a.txt", *columns(block, unit_ns, fraction).values())
    assert_same_events(read_stream(TextStream(path)), block)


@pytest.mark.parametrize(
    ("head", "separator"),
    [
        ("x,y,polarity,timestamp_us\n", ","),
        ("# X; Y; Pol; time [us]\n", ";"),
        ("% x\ty\tp\tts(us)\n", "\t"),
        ('"x" "y" "p" "t"\n', " "),
        ("# of the left camera, in time order, x to the right\n# x y p t[us]\n", " "),
    ],
)
def test_names_in_the_first_line(tmp_path: Path, head: str, separator: str) -> None:
    fields = columns(BEGIN)
    order = [fields[name] for name in "xypt"]
    faults = Faults()
    stream = TextStream(write(tmp_path / "a.csv", *order, head=head, separator=separator))
    assert bool(stream.notes) == ("us" not in head)  # a unit that is not stated is said
    assert_same_events(read_stream(stream, faults), BEGIN)
    assert not any(faults.values())


@pytest.mark.parametrize(("on", "off"), [("True", "False"), ("true", "false")])
def test_polarities_of_bool(tmp_path: Path, on: str, off: str) -> None:
    fields = columns(BEGIN)
    signs = [on if one else off for one in BEGIN.polarity]
    order = [fields["t"], fields["x"], fields["y"], signs]
    faults = Faults()
    stream = TextStream(write(tmp_path / "a.csv", *order, head="t_us,x,y,p\n", separator=","))
    assert_same_events(read_stream(stream, faults), BEGIN)
    assert not any(faults.values())


def test_names_say_what_numbers_do_not(tmp_path: Path) -> None:
    """y before x, milliseconds without fractions, and a column that means nothing."""
    fields, noise = columns(BEGIN, 10**6), ["7.5"] * len(BEGIN)
    order = [fields["t"], fields["y"], fields["x"], noise, fields["p"]]
    path = write(tmp_path / "a.txt", *order, head="# time_ms y x weight p\n")
    block = read_stream(TextStream(path))
    np.testing.assert_array_equal([block.x, block.y], [BEGIN.x, BEGIN.y])
    np.testing.assert_array_equal(block.t_ns, BEGIN.t_ns // 10**6 * 10**6)


@pytest.mark.parametrize(
    ("head", "problem"),
    [
        ("# t x y weight\n", "no column is polarity in `t x y weight`"),
        ("t,x,x,p\n", "two columns are named x"),
    ],
)
def test_names_of_other_columns_are_refused(tmp_path: Path, head: str, problem: str) -> None:
    path = write(tmp_path / "a.txt", *columns(BEGIN).values(), head=head)
    with pytest.raises(InputError, match=problem) as caught:
        TextStream(path)
    assert str(caught.value).startswith(str(path)) and "name them in a first line" in str(
        caught.value
    )


@pytest.mark.parametrize("head", ["240 180\n", "%geometry:240,180\n", "# geometry 240x180\n"])
def test_the_size_in_the_first_line(tmp_path: Path, head: str) -> None:
    """E2VID writes it as a line of two numbers, Metavision as a comment."""
    faults = Faults()
    stream = TextStream(write(tmp_path / "a.txt", *columns(BEGIN).values(), head=head))
    assert stream.resolution == (240, 180)
    assert_same_events(read_stream(stream, faults), BEGIN)
    assert not any(faults.values())


def test_the_sensor_tells_x_from_y(tmp_path: Path) -> None:
    fields = columns(BEGIN)
    path = write(tmp_path / "a.txt", *(fields[name] for name in "tyxp"))
    assert_same_events(read_stream(TextStream(path, (WIDTH, HEIGHT))), BEGIN)
    assert "t y x polarity" in TextStream(path, (WIDTH, HEIGHT)).notes[0]


@pytest.mark.parametrize("off", ["0", "-1"])
@pytest.mark.parametrize("numbers", [("0", "1"), ("1", "2")])
@pytest.mark.parametrize("how", ["5 columns", "seconds and nanoseconds", "row number"])
def test_both_cameras_in_one_file(
    tmp_path: Path, calibration: Path, how: str, numbers: tuple[str, str], off: str
) -> None:
    """Five or six columns, one of them the camera's index."""
    both = EventBlock.concatenate([LEFT, RIGHT])
    order = np.argsort(both.t_ns, kind="stable")
    camera = np.repeat(numbers, [len(LEFT), len(RIGHT)])[order].tolist()
    both = both[order]
    fields = columns(both)
    fields["p"] = ["1" if one == "1" else off for one in fields["p"]]
    if how == "seconds and nanoseconds":
        seconds, nanoseconds = np.divmod(both.t_ns, 10**9)
        fields["t"] = [str(one) for one in seconds]
        fields = {"t": fields["t"], "ns": [str(one) for one in nanoseconds]} | fields
    elif how == "row number":
        fields = {"row": [str(one) for one in range(len(both))]} | fields
    path = write(tmp_path / "events.txt", *fields.values(), camera)
    assert cameras_in(path) == list(numbers)
    assert_recording_holds(open_recording(path, calibration), LEFT, RIGHT)
    right_first = open_recording(path, calibration, *reversed(numbers))
    assert_recording_holds(right_first, RIGHT, LEFT)
    with pytest.raises(InputError, match="has no camera 7; it has"):
        open_recording(path, calibration, "7", numbers[1])


def test_a_column_with_one_camera_index(tmp_path: Path, calibration: Path) -> None:
    """Each camera has a file of six columns, in which the index is always the same."""
    for side, block, camera in (("left", LEFT, "0"), ("right", RIGHT, "1")):
        row = [str(one) for one in range(len(block))]
        path = tmp_path / f"{side}.txt"
        write(path, row, *columns(block).values(), [camera] * len(block))
        assert cameras_in(path) == []
    assert_recording_holds(open_recording(tmp_path, calibration), LEFT, RIGHT)


@pytest.mark.parametrize(
    "line",
    [
        lambda t, rng: [t, *rng.normal(size=7)],
        lambda t, rng: [t, *rng.normal(size=6)],
        lambda t, rng: [t, rng.integers(9999)],
        lambda t, rng: [t, t, t, t],
        lambda t, rng: ["a", "b", "c", "d"],
    ],
    ids=["poses", "inertial", "exposure", "times", "words"],
)
def test_other_text_is_not_taken_for_events(tmp_path: Path, line: Callable) -> None:
    rng = np.random.default_rng(0)
    lines = (" ".join(map(str, line(0.005 * k + 1.5e9, rng))) for k in range(500))
    (tmp_path / "a.txt").write_text("\n".join(lines))
    assert not is_text(tmp_path / "a.txt")
    with pytest.raises(InputError, match="if they are, name them in a first line, as `# t"):
        open_recording(tmp_path / "a.txt")


def test_damaged_lines_do_not_hide_the_columns(tmp_path: Path) -> None:
    fields = columns(BEGIN)
    path = write(tmp_path / "a.txt", *(fields[name] for name in "xypt"))
    lines = path.read_text().splitlines()
    for number in range(50, len(lines), 100):
        lines[number] = lines[number][:4]
    path.write_text("\n".join(lines))
    faults = Faults()
    assert len(read_stream(TextStream(path), faults)) == len(BEGIN) - sum(faults.values())
    assert sum(faults.values()) == 40
