"""Trackers in the shape of those of cv2: `ok, box = tracker.update(image)`, on boxes of whole pixels."""

from __future__ import annotations

import math
from typing import Any

from . import _asterism, inputs

__all__ = ["OpenCvTracker"]

_Box = tuple[int, int, int, int]


def _whole(box: tuple[float, float, float, float]) -> _Box:
    """Each edge rounded to the nearest whole pixel, and at least a pixel apart."""
    x, y, width, height = box
    left, top = math.floor(x + 0.5), math.floor(y + 0.5)
    return left, top, max(math.floor(x + width + 0.5) - left, 1), max(math.floor(y + height + 0.5) - top, 1)


class OpenCvTracker:
    """One of our trackers with the functions of cv2.Tracker, so that only the line changes that makes the tracker.

        tracker = asterism.OpenCvTracker.create("dpt_plus")    # was cv2.TrackerCSRT.create()
        tracker.init(image, box)
        ok, box = tracker.update(image)

    name, options: as for asterism.Tracker. Its errors are those of asterism.Tracker, too. For boxes of fractions of a pixel, the parts
    and the confidence, see `result`.
    """

    def __init__(self, name: str = "dpt_plus", options: dict[str, Any] | None = None) -> None:
        self._tracker = _asterism.Tracker(name, options)
        self._box: _Box = (0, 0, 0, 0)
        #: The TrackResult of the last update; None before the first one.
        self.result: _asterism.TrackResult | None = None

    @classmethod
    def create(cls, name: str = "dpt_plus", options: dict[str, Any] | None = None) -> OpenCvTracker:
        """OpenCvTracker(name, options), as cv2 writes it."""
        return cls(name, options)

    def init(self, image: Any, boundingBox: Any) -> None:
        """Starts on the object in boundingBox, (x, y, width, height) [px]; may be called again at any time."""
        x, y, width, height = map(float, inputs.numbers(boundingBox, "boundingBox", (4,)))
        self._tracker.init(image, (x, y, width, height))
        self._box, self.result = _whole((x, y, width, height)), None

    def update(self, image: Any) -> tuple[bool, _Box]:
        """(True, box) with the object's box in the next image, in whole pixels; (False, the last box) if the tracker has lost it."""
        self.result = self._tracker.update(image)
        if not self.result.lost:
            self._box = _whole(self.result.box)
        return not self.result.lost, self._box

    def __repr__(self) -> str:
        return f"<asterism.OpenCvTracker: {self._tracker.name}>"
