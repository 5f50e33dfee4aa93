"""Video of both event images with tracks, and the path as it grows beside them."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from gpvo.errors import InputError
from gpvo.observer import Step
from gpvo.second_thread import SecondThread
from gpvo.view.event_image import Image, event_image
from gpvo.view.path_so_far import PathSoFar
from gpvo.view.tracks import TrackHistory, Tracks

RATE = 30.0
"""Pictures per second, at the recording's own pace."""
HEIGHT = 540
"""Height of the event images, at most; they are enlarged by whole numbers."""
BAR = 36
"""Height of the line of text."""
INK, PALE, PATH = (40, 40, 40), (200, 200, 200), (0, 114, 178)
"""RGB."""


class VideoWriter:
    """Writes a picture of each cluster, for as long as it lasts; to be given as observer.

    It is encoded in a thread of its own, while the next one is made.

    Raises
    ------
    InputError
        If the file cannot be written.
    """

    def __init__(self, file: Path) -> None:
        if file.suffix != ".mp4":
            raise InputError(f"{file}: a video ends with .mp4")
        self._file = file
        self._history = TrackHistory()
        self._path = PathSoFar()
        self._start: float | None = None
        self._written = 0
        self._video: cv2.VideoWriter | None = None
        self._encoder = SecondThread[None]()
        file.parent.mkdir(parents=True, exist_ok=True)

    def __call__(self, step: Step) -> None:
        """Draw one more cluster."""
        picture = self._picture(step, self._history.add(step.tracked))
        self._start = step.report.start if self._start is None else self._start
        wanted = round((step.report.stop - self._start) * RATE)
        self._video = self._video or self._begin(picture)
        list(self._encoder.wait())
        self._encoder.start(self._encode, self._video, picture, wanted - self._written)
        self._written = max(wanted, self._written)

    def close(self) -> None:
        """Finish the file."""
        list(self._encoder.wait())
        if self._video is not None:
            self._video.release()

    def _begin(self, picture: Image) -> cv2.VideoWriter:
        height, width = picture.shape[:2]
        codec = cv2.VideoWriter.fourcc(*"mp4v")
        video = cv2.VideoWriter(str(self._file), codec, RATE, (width, height))
        if not video.isOpened():
            raise InputError(f"{self._file}: the video cannot be written")
        return video

    @staticmethod
    def _encode(video: cv2.VideoWriter, picture: Image, times: int) -> None:
        """Write a picture so many times."""
        blue_first = np.ascontiguousarray(picture[..., ::-1])
        for _ in range(times):
            video.write(blue_first)

    def _picture(self, step: Step, tracks: Tracks) -> Image:
        """Return the event images, the path and a line of text, (height, width, 3) RGB."""
        left, right = (
            _with_tracks(event_image(getattr(step.cluster, side)), tracks, side)
            for side in ("left", "right")
        )
        height, gap = left.shape[0], np.full((left.shape[0], 8, 3), 255, np.uint8)
        pictures = np.hstack(
            [left, gap, right, gap, _path_picture(self._path(step.estimator), height)]
        )
        pictures = pictures[:, : pictures.shape[1] // 2 * 2]  # codecs want even sides
        bar = np.full((BAR + height % 2, pictures.shape[1], 3), 255, np.uint8)
        report = step.report
        _write(bar, f"{report.stop:.2f} s    {report.inliers} of {report.tracklets} tracks agree")
        return np.vstack([pictures, bar])


def _path_picture(path: NDArray[np.float64], side: int) -> Image:
    """Draw a path (N, 3) from above, as large as it fits, with a bar of a round length."""
    image = np.full((side, side, 3), 255, np.uint8)
    cv2.rectangle(image, (0, 0), (side - 1, side - 1), PALE, 1)
    if len(path) == 0:
        return image
    above = path[:, [0, 2]]
    low, high = above.min(axis=0), above.max(axis=0)
    size = max(float((high - low).max()), 0.1)
    scale = 0.75 * side / size
    points = 0.5 * side + scale * (above - 0.5 * (low + high)) * [1, -1]
    drawn = [np.rint(8 * points).astype(np.int32)[:, None]]
    cv2.polylines(image, drawn, False, PATH, 2, cv2.LINE_AA, shift=3)
    newest = tuple(np.rint(points[-1]).astype(int).tolist())
    cv2.circle(image, newest, 5, INK, -1, cv2.LINE_AA)
    _draw_scale(image, scale, size)
    return image


def _with_tracks(image: Image, tracks: Tracks, side: str) -> Image:
    """Enlarge an event image by a whole number and draw the tracks of one camera."""
    factor = max(1, HEIGHT // image.shape[0])
    large = np.repeat(np.repeat(image, factor, axis=0), factor, axis=1)
    points = np.rint(8 * (factor * (getattr(tracks, side) + 0.5) - 0.5)).astype(np.int32)
    for line, colour in zip(points, tracks.colours.tolist(), strict=True):
        cv2.polylines(large, [line[:, None]], False, colour, 1, cv2.LINE_AA, shift=3)
        cv2.circle(large, line[-1].tolist(), 16, colour, -1, cv2.LINE_AA, shift=3)
    return large


def _draw_scale(image: Image, scale: float, size: float) -> None:
    """Draw a bar of 1, 2 or 5 times a power of ten, about a third of the path's size."""
    power = 10.0 ** np.floor(np.log10(size / 3))
    length = max(step * power for step in (1, 2, 5) if step * power <= size / 3 + 1e-12)
    y = image.shape[0] - 14
    cv2.line(image, (14, y), (14 + round(scale * length), y), INK, 2)
    _write(image, f"{length:g} m, from above", (14, y - 8))


def _write(image: Image, text: str, at: tuple[int, int] = (10, 24)) -> None:
    cv2.putText(image, text, at, cv2.FONT_HERSHEY_SIMPLEX, 0.5, INK, 1, cv2.LINE_AA)
