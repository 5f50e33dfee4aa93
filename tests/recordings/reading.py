"""Read whole recordings and streams, and compare them with what was written."""

from __future__ import annotations

import numpy as np

from gpvo.recordings import Events, Recording
from gpvo.recordings.streams import EventBlock, EventStream, Faults


def read_recording(recording: Recording) -> tuple[EventBlock, EventBlock]:
    """Return all events of both cameras, with absolute stamps."""
    batches = list(recording.event_batches())
    left = Events.concatenate([batch.left for batch in batches])
    right = Events.concatenate([batch.right for batch in batches])
    return stamped(left, recording), stamped(right, recording)


def stamped(events: Events, recording: Recording) -> EventBlock:
    t_ns = recording.start_ns + np.rint(events.t * 1e9).astype(np.int64)
    return EventBlock(events.x, events.y, t_ns, events.polarity)


def read_stream(stream: EventStream, faults: Faults | None = None) -> EventBlock:
    return EventBlock.concatenate(list(stream.blocks(None, Faults() if faults is None else faults)))


def assert_same_events(ours: EventBlock, theirs: EventBlock, tolerance_ns: int = 0) -> None:
    """Check for equal columns and types; stamps may differ by the resolution of a format."""
    assert len(ours) == len(theirs)
    for column in ("x", "y", "polarity"):
        assert getattr(ours, column).dtype == getattr(theirs, column).dtype
        np.testing.assert_array_equal(getattr(ours, column), getattr(theirs, column))
    assert ours.t_ns.dtype == np.int64
    np.testing.assert_allclose(ours.t_ns - theirs.t_ns, 0, atol=tolerance_ns)


def assert_recording_holds(
    recording: Recording, left: EventBlock, right: EventBlock, tolerance_ns: int = 0
) -> None:
    """Check that the batches of a recording hold these events."""
    ours = read_recording(recording)
    assert_same_events(ours[0], left, tolerance_ns)
    assert_same_events(ours[1], right, tolerance_ns)
