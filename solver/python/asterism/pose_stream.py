"""asterism.pose while it is being recorded: a window that slides."""

from __future__ import annotations

import dataclasses
from typing import Iterable

import numpy as np
import numpy.typing as npt

from . import _asterism, inputs
from .cameras import Camera
from .pose_estimate import _calmness, _Floats, _matrices, _Recording, _Scales, _systematic, _trust, _upper
from .pose_fuse import FusedPose, _calibration


#: After so many frames in which all detections of a joint are outliers its path begins again.
_LOST = 5


@dataclasses.dataclass(frozen=True, eq=False)
class StreamedPose:
    """The newest frame of a Stream, for J joints and V views, in D = 2 or 3 dimensions."""

    #: (J, D), as FusedPose.points.
    points: _Floats
    #: (J, D, D), as FusedPose.covariance. A joint that was not seen is predicted, and has the covariance of that.
    covariance: _Floats
    #: (V, J): the detections that do not agree with the path so far. The first of a sudden motion are among them.
    outliers: npt.NDArray[np.bool_]

    __repr__ = inputs.brief


class Stream:
    """Points frame by frame, each from the detections so far: the energy of fuse over a window that slides.

    The newest frame comes in, the oldest one leaves, and what it says about the first two frames of the window is kept as a normal distribution:
    the frame is marginalised, with the weights that it had. Within the window the weights of detections and changes are estimated in every step. Scales
    are those of a recording of the same cameras and joints; limbs do not count. A joint whose detections are outliers in five frames, one after the
    other, begins a new path. Time and memory of a frame do not grow.
    """

    def __init__(self, recorded: FusedPose, cameras: Iterable[Camera] | None = None, window: int = 12):
        """recorded: what fuse found with these cameras, which are None for points in the image. window: frames, 6 or more. ValueError if they do not
        belong together.
        """
        cameras = None if cameras is None else list(cameras)
        views, joints, _ = recorded.offsets.shape
        if window <= _LOST:
            raise ValueError(f"window: expected {_LOST + 1} frames or more, found {window}")
        if (3 if cameras else 2) != recorded.points.shape[2]:
            raise ValueError(f"cameras: the recording has points in {recorded.points.shape[2]} dimensions")
        seen = recorded.reprojections
        self._lenses = cameras
        self._cameras = np.zeros((0, 12))
        self._area = np.maximum(np.prod(np.ptp(seen, axis=(1, 2)), -1), 1.0)
        if cameras is not None:
            self._cameras, self._area = _calibration(cameras, seen)
        extent = float(np.ptp(recorded.points.reshape(-1, recorded.points.shape[2]), axis=0).max())
        self._scales = _Scales(recorded.noise, np.square(recorded.motion), recorded.offsets, recorded.disagreement, max(extent, 1e-300))
        self._centre = np.median(recorded.points, (0, 1))
        self._window, self._dim = int(window), recorded.points.shape[2]
        self._shape = views, joints
        #: A slope where a joint was not seen: the pixels for a unit in the middle of the image.
        self._slope = np.tile(np.eye(2).ravel(), (views, 1))
        if cameras is not None:
            for view, camera in enumerate(cameras):
                middle = np.median(seen[view].reshape(-1, 2), 0)
                self._slope[view] = camera.undistort(middle)[1].ravel()
        self._widest = float(self._area.max()) / 16  # px^2
        self._lost = np.zeros(joints, int)  # frames in a row
        self._frame = 0
        self._restart()

    @property
    def points(self) -> _Floats:
        """(frames, joints, D): all frames of the window, which later detections have improved. The last one is the newest."""
        return self._points.copy()

    def _restart(self) -> None:
        (views, joints), dim = self._shape, self._dim
        self._sights = np.zeros((views, 0, joints, 6))
        self._is_seen = np.zeros((views, 0, joints), bool)
        self._belief = np.ones((views, 0, joints))
        self._times = np.zeros(0)
        self._points = np.zeros((0, joints, dim))
        self._used = np.zeros((views, 0, joints))
        self._calm = np.zeros((0, joints))
        self._past = np.zeros((joints, 2 * dim, 2 * dim))  # information about the first two points
        self._past_right = np.zeros((joints, 2 * dim))

    def push(self, detections: npt.ArrayLike, time: float | None = None, confidence: npt.ArrayLike | None = None) -> StreamedPose:
        """The next frame. detections: (V, J, 2) [px], or (J, 2) for one view, NaN where none. time: that of the frame, if the recording had times; else
        frames are one apart. confidence: (V, J), in [0, 1], or (J,). ValueError for other shapes, infinite numbers and a time that does not rise.
        """
        self._append(detections, time, confidence)
        recording = _Recording(self._sights, self._is_seen, self._belief, self._times, self._cameras, self._area)
        covariance, spread = self._solve(recording, False)  # the newest frame is predicted
        width = np.zeros(self._used.shape)
        width[:, -1] = np.minimum(self._doubt(recording, covariance), self._widest)
        covariance, probability = self._settle(recording, width, covariance, spread)
        is_lost = self._is_seen[:, -1].any(0) & ~(probability[:, -1] >= 0.5).any(0)
        self._lost = np.where(self._is_seen[:, -1].any(0), (self._lost + 1) * is_lost, self._lost)
        if (self._lost >= _LOST).any():
            covariance, probability = self._begin_again(recording, self._lost >= _LOST)
        return self._newest(recording, covariance, probability)

    def _settle(self, recording: _Recording, width: _Floats, covariance: _Floats, spread: _Floats) -> tuple[_Floats, _Floats]:
        """Weights and points by turns, from a wide distribution of the detections, width (V, frames, J) [px^2], to theirs. Covariance, probability."""
        scales, noise = self._scales, self._scales.noise[:, None] ** 2
        is_wide = width > 0
        square = _asterism._pose_squares(self._points, covariance, recording.sights, recording.cameras, scales.offset)
        exactly = _asterism._pose_squares(self._points, np.zeros_like(covariance), recording.sights, recording.cameras, scales.offset)
        square = np.where(is_wide, exactly, square)  # the width has the doubt of the points
        while True:
            variance = noise + width
            probability, trust = _trust(recording, square, covariance, self._used, variance)
            if len(self._times) > 2:
                change = (recording.differences(self._points) ** 2).sum(-1) + spread
                self._calm[:-1] = _calmness(change / scales.motion, self._dim)[:-1]  # only what follows tells a sudden motion from an outlier
            self._used = trust / variance
            covariance, spread = self._solve(recording, bool((width > 900 * noise).any()))
            if not is_wide.any():
                return covariance, probability
            width = np.where(width > noise, width / 16, 0)
            is_wide = width > 0
            square = _asterism._pose_squares(self._points, covariance, recording.sights, recording.cameras, scales.offset)

    def _begin_again(self, recording: _Recording, joints: npt.NDArray[np.bool_]) -> tuple[_Floats, _Floats]:
        """Forgets the former path of a joint that was lost."""
        self._lost[joints] = 0
        self._past[joints], self._past_right[joints] = 0, 0
        self._is_seen[:, :-_LOST, joints] = False
        self._used[:, :, joints] = 0
        self._calm[:, joints] = 1
        covariance, spread = self._solve(recording, False)
        width = np.where(self._is_seen & joints, self._widest, 0.0)
        return self._settle(recording, width, covariance, spread)

    def _append(self, detections: npt.ArrayLike, time: float | None, confidence: npt.ArrayLike | None) -> None:
        views, joints = self._shape
        pixels = inputs.numbers(detections, "detections", missing=np.nan)
        pixels = pixels[None] if pixels.ndim == 2 else pixels
        if pixels.shape != (views, joints, 2):
            raise ValueError(f"detections: expected shape {(views, joints, 2)}, found {pixels.shape}")
        if np.isinf(pixels).any():
            raise ValueError(f"detections: infinite in frame {self._frame}")
        belief = np.ones((views, joints)) if confidence is None else inputs.numbers(confidence, "confidence", missing=np.nan).reshape(-1, joints)
        belief = np.where(np.isnan(pixels[..., 0]), 1, belief)
        if belief.shape != (views, joints) or not ((belief >= 0) & (belief <= 1)).all():
            raise ValueError(f"confidence: expected {(views, joints)} numbers, 0 to 1, in frame {self._frame}")
        when = float(self._times[-1] + 1 if len(self._times) else 0) if time is None else float(time)
        if not np.isfinite(when) or (len(self._times) and when <= self._times[-1]):
            raise ValueError(f"time: expected rising times, found {when} in frame {self._frame}")
        sights = np.empty((views, joints, 6))
        if self._lenses is None:
            sights[..., :2], sights[..., 2:] = pixels, np.eye(2).ravel()
        else:
            for sight, camera, view in zip(sights, self._lenses, pixels):
                image, slope = camera.undistort(view)
                sight[:, :2], sight[:, 2:] = image, slope.reshape(-1, 4)
        is_seen = np.isfinite(sights).all(-1)
        sights = np.where(is_seen[..., None], sights, np.concatenate([np.zeros((views, 2)), self._slope], 1)[:, None])
        if len(self._times) == self._window:
            self._forget()
        predicted = self._predicted(when)

        def grown(rows: _Floats, row: _Floats) -> _Floats:
            return np.concatenate([rows, row[:, None]], 1)

        self._sights, self._is_seen = grown(self._sights, sights), grown(self._is_seen, is_seen)
        self._belief = grown(self._belief, np.clip(belief, 0.01, 1))
        self._used = grown(self._used, np.zeros((views, joints)))
        self._times, self._points = np.append(self._times, when), np.concatenate([self._points, predicted[None]])
        if len(self._times) > 2:
            self._calm = np.concatenate([self._calm, np.ones((1, joints))])
        self._frame += 1

    def _predicted(self, when: float) -> _Floats:
        """The points if their velocity does not change."""
        if len(self._times) < 2:
            return self._points[-1] if len(self._times) else np.tile(self._centre, (self._shape[1], 1))
        share = (when - self._times[-1]) / (self._times[-1] - self._times[-2])
        return self._points[-1] + share * (self._points[-1] - self._points[-2])

    def _solve(self, recording: _Recording, is_far: bool) -> tuple[_Floats, _Floats]:
        """The points, given the weights; and their covariance, and its share in the changes of velocity."""
        stiffness = self._calm / self._scales.motion
        # The prior of a point, which holds where nothing else does: as weak as rounding allows where a joint is not seen in the window.
        weak = np.maximum((100 * self._scales.extent) ** -2, 1e-9 * stiffness.max(0, initial=0))[:, None]
        information, right = _asterism._pose_evidence(
            self._points, recording.sights, recording.cameras, self._used, self._scales.offset, is_far
        )
        information[..., _upper(self._dim)[2]] += weak
        right += weak * self._centre
        self._evidence = information, right.copy(), stiffness, recording.difference
        if len(right) > 1:
            right[:2] += self._past_right.reshape(-1, 2, self._dim).transpose(1, 0, 2)
        self._points, covariance, spread, _ = _asterism._difference_chains(
            information, right, recording.difference, self._evidence[2], True, self._past
        )
        return covariance, spread

    def _doubt(self, recording: _Recording, covariance: _Floats) -> _Floats:
        """The variance [px^2] of a prediction of each detection of the newest frame (V, J), in each coordinate."""
        newest = slice(-1, None)
        points, sights = np.ascontiguousarray(self._points[newest]), np.ascontiguousarray(recording.sights[:, newest])
        at = _asterism._pose_squares(points, np.ascontiguousarray(covariance[newest]), sights, recording.cameras, self._scales.offset)
        exactly = _asterism._pose_squares(points, np.zeros_like(covariance[newest]), sights, recording.cameras, self._scales.offset)
        return np.where(recording.is_seen[:, -1], (at - exactly)[:, 0] / 2, 0)

    def _forget(self) -> None:
        """Marginalises the oldest frame: what it says about the next two becomes the past."""
        dim, joints = self._dim, self._shape[1]
        information, right, stiffness, difference = self._evidence
        matrix, vector = np.zeros((joints, 3 * dim, 3 * dim)), np.zeros((joints, 3 * dim))
        matrix[:, : 2 * dim, : 2 * dim], vector[:, : 2 * dim] = self._past, self._past_right
        matrix[:, :dim, :dim] += _matrices(information[0])
        vector[:, :dim] += right[0]
        squares = np.outer(difference[0], difference[0])[:, None, :, None] * np.eye(dim)[:, None, :]
        matrix += stiffness[0, :, None, None] * squares.reshape(3 * dim, 3 * dim)
        share = np.linalg.solve(matrix[:, :dim, :dim], matrix[:, :dim, dim:]).transpose(0, 2, 1)
        past = matrix[:, dim:, dim:] - share @ matrix[:, :dim, dim:]
        size, axes = np.linalg.eigh((past + past.transpose(0, 2, 1)) / 2)  # rounding makes what is not known negative
        self._past = (axes * np.maximum(size, 0)[:, None]) @ axes.transpose(0, 2, 1)
        self._past_right = vector[:, dim:] - (share @ vector[:, :dim, None])[..., 0]
        self._sights, self._is_seen, self._belief, self._used = (a[:, 1:] for a in (self._sights, self._is_seen, self._belief, self._used))
        self._times, self._points, self._calm = self._times[1:], self._points[1:], self._calm[1:]

    def _newest(self, recording: _Recording, covariance: _Floats, probability: _Floats) -> StreamedPose:
        newest = slice(-1, None)
        frame = _Recording(
            np.ascontiguousarray(self._sights[:, newest]), self._is_seen.any(1, keepdims=True), self._belief[:, newest], self._times[newest],
            self._cameras, self._area,
        )
        lasting = _systematic(frame, np.ascontiguousarray(self._points[newest]), self._scales.disagreement)
        return StreamedPose(
            self._points[-1].copy(), _matrices(covariance[newest] + lasting)[0], self._is_seen[:, -1] & (probability[:, -1] < 0.5)
        )
