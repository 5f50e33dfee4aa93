"""Send two cameras' events as DV does, by dv-processing's own writer, each on a port of its own.

python dv_sender.py LEFT_PORT RIGHT_PORT FILE: events of FILE, an npz, 5 ms at a time.
"""

from __future__ import annotations

import os
import sys
import time

import dv_processing as dv
import numpy as np

STEP_US = 5000


def writer(port: int, size: tuple[int, int]) -> dv.io.NetworkWriter:
    stream = dv.io.Stream.EventStream(0, "events", "SIMULATED", size)
    return dv.io.NetworkWriter("127.0.0.1", port, stream)


def main() -> None:
    file = np.load(sys.argv[3])
    size = tuple(file["size"].tolist())
    writers = [writer(int(port), size) for port in sys.argv[1:3]]
    print("ready", flush=True)
    while not all(each.getClientCount() for each in writers):
        time.sleep(0.005)
    sides = [file["left"], file["right"]]
    for start in range(0, int(max(side[-1, 2] for side in sides)) + 1, STEP_US):
        for each, side in zip(writers, sides, strict=True):
            first, last = np.searchsorted(side[:, 2], [start, start + STEP_US])
            events = dv.EventStore()
            for x, y, t, polarity in side[first:last].tolist():
                events.push_back(10**15 + t, x, y, bool(polarity))
            if last > first:
                each.writeEvents(events)
        time.sleep(0.002)
    time.sleep(0.5)
    os._exit(0)  # the writers' own end may wait for readers


main()
