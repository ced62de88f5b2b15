"""asterism.pose while it is being recorded: a window that slides."""

from __future__ import annotations

import dataclasses
import math
from typing import Iterable

import numpy as np
import numpy.typing as npt

from . import _asterism, inputs
from .cameras import Camera
from .pose_estimate import _Floats, _moved
from .pose_fuse import FusedPose, _area, _calibration


@dataclasses.dataclass(frozen=True, eq=False)
class StreamedPose:
    """The newest frame of a Stream, for J joints and V views, in D = 2 or 3 dimensions."""

    #: (J, D), as FusedPose.points.
    points: _Floats
    #: (J, D, D), as FusedPose.covariance. A joint that was not seen is predicted, and has the covariance of that.
    covariance: _Floats
    #: (V, J): the detections that do not agree with the path so far. The first of a sudden motion may be among them.
    outliers: npt.NDArray[np.bool_]

    __repr__ = inputs.brief


class Stream:
    """Points frame by frame, each from the detections so far: the energy of fuse over a window that slides.

    The newest frame comes in, the oldest one leaves, and what it says about the first two frames of the window is kept as a normal distribution:
    the frame is marginalised, with the weights that it had. Within the window the weights of detections and changes are estimated in every step. Scales
    are those of a recording of the same cameras and joints; limbs do not count. While all detections of a joint are outliers, a path that changes
    suddenly is tried, too, and taken if it explains clearly more. Time and memory of a frame do not grow.
    """

    def __repr__(self) -> str:
        views, joints = self._shape
        return f"<asterism.pose.Stream: {inputs.counted(views, 'view')}, {inputs.counted(joints, 'joint')}>"

    def __init__(self, recorded: FusedPose, cameras: Iterable[Camera] | None = None, window: int = 12):
        """recorded: what fuse found with these cameras, which are None for points in the image. window: frames, 6 or more. ValueError if they do not
        belong together.
        """
        cameras = None if cameras is None else inputs.items(cameras, "cameras", "a list of Cameras")
        if not isinstance(recorded, FusedPose):
            raise TypeError(f"recorded: expected a FusedPose, found {inputs.shown(recorded)}")
        views, joints, _ = recorded.offsets.shape
        window = inputs.count(window, "window", 6)
        if (3 if cameras else 2) != recorded.points.shape[2]:
            raise ValueError(f"cameras: the recording has points in {recorded.points.shape[2]} dimensions")
        seen = recorded.reprojections
        poses = np.zeros((0, 12))
        area = np.array([_area(view) for view in seen])
        if cameras is not None:
            poses, area = _calibration(cameras, seen)
        self._shape = views, joints
        self._belief = np.ones((views, joints))
        extent = float(np.ptp(recorded.points.reshape(-1, recorded.points.shape[2]), axis=0).max())
        matrices, distortions = np.zeros((0, 3, 3)), np.zeros((0, 5))
        slope = np.tile(np.eye(2).ravel(), (views, 1))  # where a joint was not seen: the pixels for a unit in the middle of the image
        magnification = np.ones(views)  # the pixels for a unit of the points
        if cameras is not None:
            matrices, distortions = np.array([c.matrix for c in cameras]), np.array([c.distortions for c in cameras])
            for view, camera in enumerate(cameras):
                middle = np.median(seen[view].reshape(-1, 2), 0)
                slope[view] = camera.undistort(middle)[1].ravel()
                depth = float(np.median(recorded.points @ camera.rotation[2] + camera.translation[2]))
                magnification[view] = np.sqrt(abs(np.linalg.det(slope[view].reshape(2, 2)))) / max(depth, 1e-300)
        jitter = np.sqrt(np.mean((recorded.noise / magnification[:, None]) ** 2, 0))
        scales = recorded.noise, np.square(recorded.motion), recorded.offsets, recorded.disagreement, max(extent, 1e-300), jitter
        centre = np.median(recorded.points, (0, 1))
        self._origin = np.zeros(2) if cameras is None else centre  # of the window, as in fuse
        self._window = _asterism._PoseWindow(
            window, scales, _moved(poses, self._origin), matrices, distortions, area, slope, centre - self._origin
        )
        self._frame, self._time, self._greatest = 0, -1.0, 0.0

    @property
    def points(self) -> _Floats:
        """(frames, joints, D): all frames of the window, which later detections have improved. The last one is the newest."""
        return self._window.points + self._origin

    def push(self, detections: npt.ArrayLike, time: float | None = None, confidence: npt.ArrayLike | None = None) -> StreamedPose:
        """The next frame. detections: (V, J, 2) [px], or (J, 2) for one view, NaN where none. time: that of the frame, if the recording had times; else
        frames are one apart. confidence: (V, J), in [0, 1], or (J,), relative to the greatest one so far. ValueError for other shapes, infinite numbers and a time that does not rise.
        """
        views, joints = self._shape
        pixels = inputs.numbers(detections, "detections", missing=np.nan)
        pixels = pixels[None] if pixels.ndim == 2 else pixels
        if pixels.shape != (views, joints, 2):
            raise ValueError(f"detections: expected shape {(views, joints, 2)}, found {pixels.shape}")
        if np.isinf(pixels).any():
            raise ValueError(f"detections: infinite in frame {self._frame}")
        is_missing = np.isnan(pixels)
        if (is_missing[..., 0] != is_missing[..., 1]).any():
            raise ValueError(f"detections: only one coordinate is missing in frame {self._frame}")
        belief, greatest = self._belief, self._greatest
        if confidence is not None:
            belief = inputs.numbers(confidence, "confidence", missing=np.nan)
            belief = belief[None] if belief.ndim == 1 else belief
            if belief.shape != (views, joints) or not (np.isnan(pixels[..., 0]) | ((belief >= 0) & (belief <= 1))).all():
                raise ValueError(f"confidence: expected {(views, joints)} numbers, 0 to 1, in frame {self._frame}")
            belief = np.where(np.isnan(pixels[..., 0]), 0, belief)
            greatest = max(greatest, float(belief.max()))
            belief = belief / greatest if greatest > 0 else self._belief
        when = self._time + 1 if time is None else inputs.number(time, "time")
        if not math.isfinite(when) or (self._frame > 0 and when <= self._time):
            raise ValueError(f"time: expected rising times, found {when} in frame {self._frame}")
        self._frame, self._time, self._greatest = self._frame + 1, when, greatest
        points, covariance, outliers = self._window.push(pixels, belief, when)
        return StreamedPose(points + self._origin, covariance, outliers)
