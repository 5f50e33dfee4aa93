"""Decoders of byte streams agree with plain decoders and with the encoded events."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from encoders import event_block, evt2_words, evt3_words, evt21_words, raw_file, shifted
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from reading import assert_recording_holds, assert_same_events, read_stream

from gpvo.errors import InputError
from gpvo.recordings import open_recording
from gpvo.recordings.decoders import evt2, evt3
from gpvo.recordings.files import prophesee_raw
from gpvo.recordings.files.prophesee_raw import RawStream
from gpvo.recordings.streams import EventBlock

WRAP_NS = evt3.WRAP_US * 1000


def plain_evt3(words: list[int]) -> list[tuple[int, int, int, int]]:
    """Return (x, y, t in microseconds, polarity) by the table of the format, for ordered times."""
    events = []
    y = base = polarity = wraps = 0
    high = low = None
    for word in words:
        code, payload = word >> 12, word & 0xFFF
        if code == 0x0:
            y = payload & 0x7FF
        elif code == 0x3:
            base, polarity = payload & 0x7FF, payload >> 11
        elif code == 0x6 and (low is not None or high is not None):
            low = payload
        elif code == 0x8:
            if high is not None and payload < high and high - payload > 10:
                wraps += 1
            high = payload
        elif code in (0x2, 0x4, 0x5):
            columns = [payload & 0x7FF]
            sign = payload >> 11
            if code != 0x2:
                width = 12 if code == 0x4 else 8
                columns = [base + bit for bit in range(width) if payload >> bit & 1]
                base, sign = base + width, polarity
            if high is not None and low is not None:
                t_us = wraps << 24 | high << 12 | low
                events += [(x, y, t_us, sign) for x in columns]
    return events


def decoded(
    decoder: evt3.Evt3 | evt2.Evt2 | evt2.Evt21, words: np.ndarray, cuts: list[int]
) -> list[tuple]:
    """Return the events of words that arrive in pieces."""
    parts = [block for piece in np.split(words, sorted(cuts)) for block in decoder.decode(piece)]
    return [
        (int(x), int(y), int(t) // 1000, int(p))
        for part in parts
        for x, y, t, p in zip(part.x, part.y, part.t_ns, part.polarity, strict=True)
    ]


CODES = st.sampled_from([0x0, 0x2, 0x2, 0x3, 0x4, 0x5, 0x6, 0x7, 0xA, 0xE, 0xF])


@settings(deadline=None, max_examples=60)
@given(
    words=st.lists(st.builds(lambda c, p: c << 12 | p, CODES, st.integers(0, 0xFFF)), max_size=80),
    steps=st.lists(st.integers(0, 60), max_size=30),
    start=st.integers(0, 4095),
    seed=st.integers(0, 9),
    cuts=st.lists(st.integers(0, 100), max_size=3),
)
def test_evt3_is_the_plain_decoder(
    words: list[int], steps: list[int], start: int, seed: int, cuts: list[int]
) -> None:
    """Words are arbitrary, with a clock that advances and wraps, and arrive in any pieces."""
    places = np.sort(np.random.default_rng(seed).integers(0, len(words) + 1, len(steps)))
    highs = (start + np.cumsum(steps, dtype=int)) & 0xFFF
    for place, high in zip(places[::-1], highs[::-1], strict=True):
        words.insert(int(place), 0x8000 | int(high))
    data = np.array(words, "<u2")
    ours = decoded(evt3.Evt3(), data, [cut for cut in cuts if cut < len(words)])
    assert ours == plain_evt3(words)


def in_rows(block: EventBlock) -> EventBlock:
    """Return runs of neighbours of one time, row and polarity, each column twice."""
    rows = np.arange(len(block)) // 40 * 40
    x = np.arange(len(block), dtype=np.uint16) // 2 % 60
    return EventBlock(x, block.y[rows], block.t_ns[rows], block.polarity[rows])


@pytest.mark.parametrize("vectors", [False, True])
def test_evt3_gives_back_what_was_encoded(vectors: bool) -> None:
    block = event_block(3000, 1, start_ns=WRAP_NS - 200_000_000)
    if vectors:
        block = in_rows(block)
    words = evt3_words(block, vectors)
    assert vectors == bool((words >> 12 == 4).any())
    assert_same_events(EventBlock.concatenate(list(evt3.Evt3().decode(words))), block)


def test_one_damaged_time_does_not_shift_all_that_follow() -> None:
    block = event_block(2000, 2, start_ns=0)
    words = evt3_words(block)
    highs = np.flatnonzero(words >> 12 == 8)
    for place in highs[[20, 50, 80]]:
        words[place] ^= 0x0A00
    ours = EventBlock.concatenate(list(evt3.Evt3().decode(words)))
    wrong = ours.t_ns != block.t_ns
    np.testing.assert_array_equal(ours.x, block.x)
    assert 0 < wrong.sum() < 0.1 * len(block)
    assert not wrong[-100:].any()


@pytest.mark.parametrize("cut", [1, 900, 1500])
def test_skipping_finds_the_last_time(cut: int) -> None:
    block = event_block(2000, 8, start_ns=WRAP_NS - 200_000_000)
    words = evt3_words(block, vectors=True)
    decoder = evt3.Evt3()
    assert len(decoder.last_event()) == 0
    for part in (words[:cut], words[cut:]):
        decoder.skip(part)
    assert decoder.last_event().t_ns.tolist() == [block.t_ns[-1]]


def continued(counter: int, previous: int | None) -> int:
    """Return a counter of 28 bits that counts on from the previous one, forwards or back."""
    if previous is None:
        return counter
    return min((counter + (k << 28) for k in range(-70, 70)), key=lambda one: abs(one - previous))


@settings(deadline=None, max_examples=30)
@given(words=arrays("<u4", st.integers(0, 60)), cut=st.integers(0, 60))
def test_evt2_is_the_plain_decoder(words: np.ndarray, cut: int) -> None:
    words = words & np.uint32(0x8FFFFFFF)
    high, events = None, []
    for word in words.tolist():
        if word >> 28 == 8:
            high = continued(word & 0xFFFFFFF, high)
        elif word >> 28 <= 1 and high is not None:
            events.append(
                (word >> 11 & 0x7FF, word & 0x7FF, high << 6 | word >> 22 & 63, word >> 28)
            )
    assert decoded(evt2.Evt2(), words, [min(cut, len(words))]) == events


@settings(deadline=None, max_examples=30)
@given(words=arrays("<u8", st.integers(0, 60)), cut=st.integers(0, 60), legacy=st.booleans())
def test_evt21_is_the_plain_decoder(words: np.ndarray, cut: int, legacy: bool) -> None:
    words = words & np.uint64(0x8FFFFFFF8FFFFFFF)
    high, events = None, []
    for word in words.tolist():
        halves = word >> 32, word & 0xFFFFFFFF
        head, valid = reversed(halves) if legacy else halves
        if head >> 28 == 8:
            high = continued(head & 0xFFFFFFF, high)
        elif head >> 28 <= 1 and high is not None:
            x, y, t_us = head >> 11 & 0x7FF, head & 0x7FF, high << 6 | head >> 22 & 63
            events += [(x + i, y, t_us, head >> 28) for i in range(32) if valid >> i & 1]
    assert decoded(evt2.Evt21(legacy), words, [min(cut, len(words))]) == events


@pytest.mark.parametrize("legacy", [False, True])
@pytest.mark.parametrize("stated", [False, True])
def test_pair_of_evt21_files(tmp_path: Path, calibration: Path, legacy: bool, stated: bool) -> None:
    """Either half of the words may be first, whether the header states it or not."""
    blocks = event_block(900, 4, start_ns=10**9), in_rows(event_block(800, 5, start_ns=10**9))
    form = f"format EVT21;height=1;endianness={'legacy' if legacy else 'little'};width=1"
    for side, block in zip(("left", "right"), blocks, strict=True):
        words = evt21_words(block, legacy)
        raw_file(tmp_path / f"{side}.raw", words, form if stated else "")
    assert len(words) < len(blocks[1])  # neighbours share one
    assert_recording_holds(open_recording(tmp_path, calibration), *blocks)


def test_another_version_is_refused(tmp_path: Path, calibration: Path) -> None:
    for side in ("left", "right"):
        path = raw_file(tmp_path / f"{side}.raw", evt2_words(event_block(10)))
        path.write_bytes(path.read_bytes().replace(b"evt 2.0", b"evt 4.0"))
    with pytest.raises(InputError, match=r"EVT 4\.0; gpvo reads EVT 2\.0, 2\.1 and 3\.0"):
        open_recording(tmp_path, calibration)


def test_decoding_stops_where_its_buffers_are_full(monkeypatch: pytest.MonkeyPatch) -> None:
    block = event_block(500, 3, start_ns=0)
    monkeypatch.setattr(evt3, "CAPACITY", 7)
    parts = list(evt3.Evt3().decode(evt3_words(block)))
    assert len(parts) > 50
    assert_same_events(EventBlock.concatenate(parts), block)


@pytest.mark.parametrize("encode", [evt2_words, evt3_words])
def test_pair_of_raw_files(tmp_path: Path, calibration: Path, encode: object) -> None:
    blocks = event_block(800, 4, start_ns=10**9), event_block(900, 5, start_ns=10**9)
    files = [
        raw_file(tmp_path / f"a_{side}.raw", encode(block))  # type: ignore[operator]
        for side, block in zip(("left", "right"), blocks, strict=True)
    ]
    for path in (*files, tmp_path):
        assert_recording_holds(open_recording(path, calibration), *blocks)


def test_raw_files_on_both_sides_of_a_wrap(tmp_path: Path, calibration: Path) -> None:
    """The right camera's file begins after the wrap that the left one's contains."""
    left = event_block(800, 6, start_ns=WRAP_NS - 100_000_000)
    right = event_block(300, 7, start_ns=20_000_000, seconds=0.3)
    raw_file(tmp_path / "left.raw", evt3_words(left))
    raw_file(tmp_path / "right.raw", evt3_words(right))
    recording = open_recording(tmp_path, calibration)
    assert_recording_holds(recording, left, shifted(right, WRAP_NS))
    assert any("16.777216 s" in note for note in recording.notes)


@pytest.mark.parametrize("encode", [evt2_words, evt21_words])
def test_a_camera_that_runs_for_hours(
    tmp_path: Path, calibration: Path, encode: Callable, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The clock of EVT2 wraps after 4.8 hours; the end is read from the last bytes alone."""
    monkeypatch.setattr(prophesee_raw, "BLOCK_BYTES", 800)
    start_ns = 1000 * evt2.WRAP_US - 300_000_000
    left = event_block(800, 6, start_ns)
    right = event_block(300, 7, start_ns + 310_000_000, seconds=0.15)
    raw_file(tmp_path / "left.raw", encode(left))
    raw_file(tmp_path / "right.raw", encode(right))
    recording = open_recording(tmp_path, calibration)
    assert_recording_holds(recording, left, right)
    assert recording.duration == pytest.approx((left.t_ns[-1] - left.t_ns[0]) / 1e9)


def test_a_damaged_time_of_evt2_does_not_shift_all_that_follow() -> None:
    block = event_block(300, 2, start_ns=0)
    words = evt2_words(block)
    highs = np.flatnonzero(words >> 28 == 8)
    words[highs[50]] ^= np.uint32(3 << 26)
    words[highs[90]] ^= np.uint32(5 << 20)
    ours = EventBlock.concatenate(list(evt2.Evt2().decode(words)))
    assert 2 <= (ours.t_ns != block.t_ns).sum() <= 4


def test_real_stereo_evt3(shared: Path) -> None:
    """Hardware-synchronised cameras start and end within 10 ms of each other."""
    folder = shared / "real/reader_samples"
    left, right = (
        read_stream(RawStream(folder / f"stereo_evt3_{side}.raw")) for side in ("left", "right")
    )
    assert (len(left), len(right)) == (1_216_905, 358_284)
    for block in (left, right):
        assert block.x.max() == 639 and block.y.max() == 479
        assert (np.diff(block.t_ns) >= 0).all()
        assert block.t_ns[-1] - block.t_ns[0] == pytest.approx(1.1e9, rel=0.01)
    assert abs(int(left.t_ns[-1] - right.t_ns[-1])) < 10_000_000
