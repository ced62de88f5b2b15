"""Key-points of animals and people over time and over several cameras: one path for each joint, with its covariance.

`fuse` takes what a pose estimator found, frame by frame, and gives the points that explain it best; docs/pose.md shows it on recordings.
"""

from __future__ import annotations

import concurrent.futures
import csv
import dataclasses
import os
import pathlib
import warnings
from typing import Any, Iterable, Sequence

import numpy as np
import numpy.typing as npt

from . import _asterism, inputs

_Floats = npt.NDArray[np.float64]

__all__ = ["Camera", "Detections", "FusedPose", "fuse", "read_cameras", "read_detections", "write_points"]


@dataclasses.dataclass(frozen=True, eq=False)
class Camera:
    """A calibrated camera, as OpenCV describes it: a point X of the world is seen by cv::projectPoints. ValueError for other shapes."""

    #: (3, 3) [px].
    matrix: npt.ArrayLike
    #: Rotation from the world to the camera: (3, 3), or a Rodrigues vector (3,).
    rotation: npt.ArrayLike
    #: (3,), in the world's unit of length.
    translation: npt.ArrayLike
    #: k1, k2, p1, p2, k3; the last ones may be left out.
    distortions: npt.ArrayLike = ()
    #: Width and height of the image [px], if known.
    size: Sequence[float] | None = None
    name: str = ""

    def __post_init__(self) -> None:
        def keep(field: str, value: Any) -> None:
            object.__setattr__(self, field, value)

        where = f"camera {self.name}".rstrip()
        for field, shapes in [("matrix", [(3, 3)]), ("rotation", [(3, 3), (3,)]), ("translation", [(3,)])]:
            value = np.array(inputs.numbers(getattr(self, field), f"{where}: {field}"))
            if value.shape not in shapes:
                raise ValueError(f"{where}: {field}: expected shape {' or '.join(map(str, shapes))}, found {value.shape}")
            if not np.isfinite(value).all():
                raise ValueError(f"{where}: {field}: expected finite numbers")
            keep(field, value)
        distortions = np.array(inputs.numbers(self.distortions, f"{where}: distortions")).ravel()
        if len(distortions) > 5 or not np.isfinite(distortions).all():
            raise ValueError(f"{where}: distortions: expected at most five finite numbers (k1, k2, p1, p2, k3)")
        keep("distortions", np.append(distortions, np.zeros(5 - len(distortions))))
        if self.rotation.shape == (3,):
            keep("rotation", _rotation(self.rotation))
        if not np.allclose(self.rotation @ self.rotation.T, np.eye(3), atol=1e-6) or np.linalg.det(self.rotation) < 0:
            raise ValueError(f"{where}: rotation: expected a rotation")
        if not (self.matrix[0, 0] > 0 and self.matrix[1, 1] > 0):
            raise ValueError(f"{where}: matrix: expected positive focal lengths")
        if self.size is not None:
            size = np.array(inputs.numbers(self.size, f"{where}: size", (2,)))
            if not (size > 0).all():
                raise ValueError(f"{where}: size: expected a positive width and height")
            keep("size", size)

    def project(self, points: npt.ArrayLike) -> _Floats:
        """Where points (..., 3) of the world are seen, (..., 2) [px]."""
        seen = np.asarray(points, float) @ self.rotation.T + self.translation
        image, _ = self._distorted(seen[..., :2] / seen[..., 2:])
        return image @ self.matrix[:2, :2].T + self.matrix[:2, 2]

    def undistort(self, pixels: npt.ArrayLike) -> tuple[_Floats, _Floats]:
        """Normalised coordinates (..., 2) of pixels (..., 2), NaN where the distortion has no inverse, and the pixels for a unit of them."""
        scale = self.matrix[:2, :2]
        goal = (np.asarray(pixels, float) - self.matrix[:2, 2]) @ np.linalg.inv(scale).T
        image = goal.copy()
        with np.errstate(all="ignore"):
            found, slope = self._distorted(image)
            for _ in range(12):  # Newton's method
                if not (np.abs(found - goal) > 1e-13).any():
                    break
                (a, b), (c, d) = np.moveaxis(slope, (-2, -1), (0, 1))
                u, v = np.moveaxis(goal - found, -1, 0)
                image = image + np.stack([d * u - b * v, a * v - c * u], -1) / (a * d - b * c)[..., None]
                found, slope = self._distorted(image)
            is_bad = ~(np.abs(found - goal).max(-1) < 1e-9) | ~(np.linalg.det(slope) > 0)
        image[is_bad] = np.nan
        return image, scale @ slope

    def _distorted(self, image: _Floats) -> tuple[_Floats, _Floats]:
        k1, k2, p1, p2, k3 = self.distortions
        x, y = image[..., 0], image[..., 1]
        r = x * x + y * y
        radial, slope = 1 + r * (k1 + r * (k2 + r * k3)), k1 + r * (2 * k2 + 3 * k3 * r)
        mixed = 2 * (x * y * slope + p1 * x + p2 * y)
        rows = [
            [radial + 2 * x * x * slope + 2 * p1 * y + 6 * p2 * x, mixed],
            [mixed, radial + 2 * y * y * slope + 6 * p1 * y + 2 * p2 * x],
        ]
        found = [x * radial + 2 * p1 * x * y + p2 * (r + 2 * x * x), y * radial + p1 * (r + 2 * y * y) + 2 * p2 * x * y]
        return np.stack(found, -1), np.stack([np.stack(row, -1) for row in rows], -2)


def _rotation(vector: _Floats) -> _Floats:
    """Rodrigues' formula."""
    angle = float(np.linalg.norm(vector))
    if angle == 0:
        return np.eye(3)
    x, y, z = vector / angle
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


@dataclasses.dataclass(frozen=True, eq=False)
class FusedPose:
    """What fuse finds, for T frames, J joints and V views, in D = 2 or 3 dimensions."""

    #: (T, J, D): pixels, or the cameras' unit of length.
    points: _Floats
    #: Of each point: (T, J, D, D). Of one view alone it has only errors that change from frame to frame, and is too small where a network's errors last.
    covariance: _Floats
    #: (V, T, J): the detections that belong to no path. A missing one is not an outlier.
    outliers: npt.NDArray[np.bool_]
    #: (L,): the length of each limb of the skeleton, in the unit of the points.
    lengths: _Floats
    #: (L,): how much it differs from frame to frame, as a standard deviation.
    length_deviations: _Floats
    #: (V, T, J, 2): where each view should see the points [px].
    reprojections: _Floats
    #: (V, J): standard deviation of a detection in each of its two coordinates [px].
    noise: _Floats
    #: (J,): standard deviation of the change of a joint's velocity in a unit of time, for each coordinate.
    motion: _Floats
    #: Standard deviation of the errors of a view that last over frames, as a calibration's do [px]; 0 with one view, which cannot show them.
    disagreement: float

    __repr__ = inputs.brief


@dataclasses.dataclass
class _Scales:
    """What is estimated from the data besides the points."""

    noise: _Floats  # (V, J)
    motion: _Floats  # (J,), a variance
    offset: _Floats  # (V, J, 2): what the views are off by in all frames
    disagreement: float
    extent: float  # of the scene


class _Recording:
    """Detections as the energy sees them: sights, and the frames' second differences."""

    def __init__(self, sights: _Floats, is_seen: npt.NDArray[np.bool_], belief: _Floats, times: _Floats, cameras: _Floats, area: _Floats):
        self.sights, self.is_seen, self.belief = sights, is_seen, belief
        self.times, self.cameras, self.area = times, cameras, area
        self.dim = 3 if len(cameras) else 2
        # Of the change of velocity at a frame between two others, divided by the square root of the time it has.
        step = np.diff(times)
        before, after = 1 / step[:-1], 1 / step[1:]
        self.difference = np.stack([before, -before - after, after], 1) / np.sqrt((step[:-1] + step[1:]) / 2)[:, None]

    def part(self, frames: slice) -> _Recording:
        return _Recording(
            np.ascontiguousarray(self.sights[:, frames]), self.is_seen[:, frames], self.belief[:, frames], self.times[frames], self.cameras, self.area,
        )

    def of_joints(self, which: npt.NDArray[np.bool_]) -> _Recording:
        return _Recording(
            np.ascontiguousarray(self.sights[:, :, which]), self.is_seen[..., which], self.belief[..., which], self.times, self.cameras, self.area
        )

    def differences(self, points: _Floats) -> _Floats:
        a, b, c = self.difference.T[..., None, None]
        return a * points[:-2] + b * points[1:-1] + c * points[2:]

    def centre(self) -> tuple[_Floats, _Floats]:
        """A point in the middle of what is seen, and for each view the pixels for a unit of length there."""
        middle = np.array([np.median(s[seen][:, :2], 0) if seen.any() else np.zeros(2) for s, seen in zip(self.sights, self.is_seen)])
        if self.dim == 2:
            return np.median(middle[self.is_seen.any((1, 2))], 0), np.ones(len(middle))
        across, right = np.zeros((3, 3)), np.zeros(3)
        for image, camera in zip(middle, self.cameras):  # the point that is nearest to all the views' middle rays
            rotation, translation = camera[:9].reshape(3, 3), camera[9:]
            ray = rotation.T @ np.append(image, 1)
            plane = np.eye(3) - np.outer(ray, ray) / (ray @ ray)
            across += plane
            right -= plane @ rotation.T @ translation
        if np.linalg.cond(across) > 1e12:
            raise ValueError("cameras: they look along one line, so that depth is unknown")
        point = np.linalg.solve(across, right)
        depth = np.array([camera[6:9] @ point + camera[11] for camera in self.cameras])
        if not (depth > 0).all():
            raise ValueError(f"cameras: view {int(np.argmin(depth))} has the joints behind it; does each view have its own calibration?")
        pixels = [np.sqrt(np.median(np.abs(np.linalg.det(s[seen][:, 2:].reshape(-1, 2, 2))))) if seen.any() else 1.0 for s, seen in zip(self.sights, self.is_seen)]
        return point, np.array(pixels) / depth


def fuse(
    detections: npt.ArrayLike,
    confidence: npt.ArrayLike | None = None,
    cameras: Iterable[Camera] | None = None,
    skeleton: Iterable[tuple[int, int]] | None = None,
    times: npt.ArrayLike | None = None,
) -> FusedPose:
    """The paths of J joints over T frames that explain what V views detected, with covariance and outliers; nothing has to be tuned.

    detections: (V, T, J, 2) [px], or (T, J, 2) for one view; NaN, or a mask, where a joint was not seen. confidence: (V, T, J), or (T,
    J), in [0, 1]: the probability that the detection is no outlier; 1 if left out. cameras: one for each view, for points in space;
    without them the views are several detectors' results for one image. skeleton: pairs of joints. times: (T,), rising; frame numbers
    if left out.

    The points minimise a sum of squares, each in units of its variance: errors of the detections in the image, less what a view is off by in all
    frames, and changes of velocity along the path of each joint, both with Student's t distribution; then, frame by frame, limbs are springs of a length that all
    frames have in common, as firm as the lengths turned out to be. Outliers have no weight: a detection may also
    be a point anywhere in the image. The distribution is met from a wide one to a narrow one (graduated non-convexity). The variances maximise the evidence
    (expectation-maximisation with the exact covariances). A joint without detections in a frame is interpolated, and has the covariance of that.
    Errors that last over frames are found where views disagree, and are part of the covariance: a single view cannot show them, and what all views
    have in common no data show.

    ValueError, which names the input, for other shapes, infinite numbers, a joint that is never seen, cameras of which two are the
    same or which do not belong to the detections, one camera, and times that do not rise.
    """
    cameras = None if cameras is None else list(cameras)
    recording, limbs, pixels = _checked(detections, confidence, cameras, skeleton, times)
    with warnings.catch_warnings():  # which threads share
        warnings.simplefilter("ignore", RuntimeWarning)  # medians over joints that a view never sees
        found = _estimate(recording) if len(recording.times) <= 2 * _PART else _estimate_by_parts(recording)
    scales, points = found.scales, found.points
    covariance = found.covariance + _systematic(recording, points, scales.disagreement)
    lengths, deviations = _limb_lengths(points, covariance, limbs)
    if len(limbs):
        points, covariance = _with_limbs(found, covariance, limbs, lengths, deviations)
    image = np.array([camera.project(points) for camera in cameras]) if recording.dim == 3 else np.array([points] * len(recording.sights))
    return FusedPose(
        points, _matrices(covariance), ~np.isnan(pixels[..., 0]) & (found.probability < 0.5), lengths, deviations, image,
        scales.noise, np.sqrt(scales.motion), scales.disagreement,
    )


#: The frames of a part of a long recording, and how many its neighbours share with it on each side.
_PART = 500
_OVERLAP = 100
_EM_STEPS = 30
#: Degrees of freedom of Student's t distribution of detections in the plane, and of changes of velocity: animals rest, and start suddenly.
_DETECTION = 4.0
_MOTION = 1.0
#: Sudden motions come in bursts: so many neighbouring changes of velocity, an odd number, share a variance.
_BURST = 5
#: How probable an outlier is beforehand. An estimate instead takes sudden motions for outliers, and then finds many.
_OUTLIERS = 0.01


def _checked(
    detections: Any, confidence: Any, cameras: list[Camera] | None, skeleton: Any, times: Any
) -> tuple[_Recording, npt.NDArray[np.intp], _Floats]:
    """The recording, the limbs (L, 2), and the detections as (V, T, J, 2)."""
    pixels = inputs.numbers(detections, "detections", missing=np.nan)
    if pixels.ndim == 3:
        pixels = pixels[None]
    if pixels.ndim != 4 or pixels.shape[-1] != 2:
        raise ValueError(f"detections: expected shape (views, frames, joints, 2) or (frames, joints, 2), found {np.shape(detections)}")
    views, frames, joints, _ = pixels.shape
    if 0 in pixels.shape:
        raise ValueError(f"detections: expected at least one view, frame and joint, found shape {pixels.shape}")
    if np.isinf(pixels).any():
        v, t, j, _ = np.argwhere(np.isinf(pixels))[0]
        raise ValueError(f"detections: infinite in view {v}, frame {t}, joint {j}")
    is_missing = np.isnan(pixels)
    if (is_missing[..., 0] != is_missing[..., 1]).any():
        v, t, j = np.argwhere(is_missing[..., 0] != is_missing[..., 1])[0]
        raise ValueError(f"detections: only one coordinate is missing in view {v}, frame {t}, joint {j}")
    pixels = np.where(is_missing, np.nan, pixels)
    belief = np.ones((views, frames, joints))
    if confidence is not None:
        belief = inputs.numbers(confidence, "confidence", missing=np.nan)
        belief = belief[None] if belief.ndim == 2 else belief
        if belief.shape != (views, frames, joints):
            raise ValueError(f"confidence: expected shape {(views, frames, joints)}, found {belief.shape}")
        belief = np.where(is_missing[..., 0], 1, belief)
        if not ((belief >= 0) & (belief <= 1)).all():
            v, t, j = np.argwhere(~((belief >= 0) & (belief <= 1)))[0]
            raise ValueError(f"confidence: expected 0 to 1, found {belief[v, t, j]} in view {v}, frame {t}, joint {j}")
    when = np.arange(frames, dtype=float) if times is None else inputs.array(times, "times", (frames,))
    if not np.isfinite(when).all():
        raise ValueError("times: expected finite numbers")
    if (np.diff(when) <= 0).any():
        t = int(np.argmax(np.diff(when) <= 0))
        raise ValueError(f"times: expected rising times, found {when[t]} before {when[t + 1]} at frame {t + 1}")
    limbs = np.zeros((0, 2), np.intp) if skeleton is None else np.array(list(skeleton)).reshape(-1, 2)
    if len(limbs) and (limbs.dtype.kind not in "iu" or (limbs < 0).any() or (limbs >= joints).any() or (limbs[:, 0] == limbs[:, 1]).any()):
        raise ValueError(f"skeleton: expected pairs of two joints, 0 to {joints - 1}")
    sights = np.zeros((views, frames, joints, 6))
    if cameras is None:
        sights[..., :2], sights[..., 2], sights[..., 5] = pixels, 1, 1
        poses = np.zeros((0, 12))
        low, high = np.nanmin(pixels, (0, 1, 2)) if not is_missing.all() else 0, np.nanmax(pixels, (0, 1, 2)) if not is_missing.all() else 0
        area = np.full(views, max(float(np.prod(high - low)), 1.0))
    else:
        poses, area = _calibration(cameras, pixels)
        for view, camera in enumerate(cameras):
            sights[view, ..., :2], slope = camera.undistort(pixels[view])
            sights[view, ..., 2:] = slope.reshape(frames, joints, 4)
    is_seen = np.isfinite(sights).all(-1)
    if not is_seen.any((0, 1)).all():
        raise ValueError(f"detections: joint {int(np.argmin(is_seen.any((0, 1))))} is never seen")
    sights[~is_seen] = 0
    for sight, seen in zip(sights, is_seen):  # errors that last are there without a detection as well: the pixels for a unit
        if seen.any():
            sight[~seen, 2:] = np.median(sight[seen, 2:], 0)
    return _Recording(sights, is_seen, np.clip(belief, 0.01, 1), when, poses, area), limbs, pixels


def _calibration(cameras: list[Camera], pixels: _Floats) -> tuple[_Floats, _Floats]:
    """Rotation and translation (V, 12), and each image's area [px^2]."""
    if not all(isinstance(camera, Camera) for camera in cameras):
        raise TypeError("cameras: expected asterism.pose.Camera for each view")
    if len(cameras) != len(pixels):
        raise ValueError(f"cameras: expected one for each of the {len(pixels)} views, found {len(cameras)}")
    if len(cameras) == 1:
        raise ValueError("cameras: one view has no depth; leave cameras out for points in the image")
    names = [camera.name or str(view) for view, camera in enumerate(cameras)]
    poses = np.array([np.append(camera.rotation.ravel(), camera.translation) for camera in cameras])
    for b in range(len(cameras)):
        for a in range(b):
            if np.array_equal(poses[a], poses[b]):
                raise ValueError(f"cameras: {names[a]} and {names[b]} are in one place with one rotation; is one the copy of the other?")
    area = np.ones(len(cameras))
    for view, camera in enumerate(cameras):
        seen = pixels[view][~np.isnan(pixels[view, ..., 0])]
        if camera.size is None:
            area[view] = max(float(np.prod(np.ptp(seen, 0))), 1.0) if len(seen) else 1.0
            continue
        area[view] = np.prod(camera.size)
        is_outside = ((seen < -0.05 * camera.size) | (seen > 1.05 * camera.size)).any(-1)
        if len(seen) and is_outside.mean() > 0.3:
            width, height = camera.size
            raise ValueError(
                f"cameras: {names[view]} is calibrated for an image of {width:g} x {height:g}, but {is_outside.mean():.0%} of its detections are outside of it"
            )
    return poses, area


@dataclasses.dataclass
class _Estimate:
    """What explains a recording best."""

    scales: _Scales
    points: _Floats  # (T, J, D)
    covariance: _Floats  # (T, J, entries)
    probability: _Floats  # (V, T, J): that a detection is no outlier
    weight: _Floats  # (V, T, J): of each detection
    stiffness: _Floats  # (T - 2, J): the weight of each change of velocity


def _posterior(
    recording: _Recording, points: _Floats, weight: _Floats, stiffness: _Floats, scales: _Scales, centre: _Floats, along_ray: bool = False
) -> tuple[_Floats, _Floats, _Floats]:
    """Points and their covariance, given the weights, and the covariance's share in the square of each change of velocity."""
    weak = (100 * scales.extent) ** -2  # the prior of a point, which holds where nothing else does
    information, right = _asterism._pose_evidence(points, recording.sights, recording.cameras, weight, scales.offset, along_ray)
    row, column = np.triu_indices(recording.dim)
    information[..., row == column] += weak
    right += weak * centre
    return _asterism._difference_chains(information, right, recording.difference, stiffness)[:3]


#: The least change of velocity in a frame, in sizes of the scene: that of a joint which rests, or is seen once.
_STILL = 1e-5
_SPRING_STEPS = 3


def _with_limbs(
    free: _Estimate, covariance: _Floats, limbs: npt.NDArray[np.intp], lengths: _Floats, deviations: _Floats
) -> tuple[_Floats, _Floats]:
    """Points and covariance if limbs are springs, of which the lengths and deviations are those of the estimate without them.

    In each frame a joint is held at the limb's length from where the other one is without limbs, as firmly as that place (covariance) and the length
    are known. If it were held at where the other one is with them, each would take the other's doubt for its own evidence, and the limbs would seem
    rigid. Nor do the limbs of other frames count, as what they are off by is alike. What lasts moves both ends: its covariance is left.
    """
    row, column = np.triu_indices(free.points.shape[2])
    points = free.points
    for _ in range(_SPRING_STEPS):  # the directions of the limbs
        found, held = free.points.copy(), _matrices(free.covariance)
        for (a, b), length, deviation in zip(limbs, lengths, deviations):
            offset = points[:, a] - points[:, b]
            direction = offset / np.maximum(np.linalg.norm(offset, axis=-1), 1e-300)[:, None]
            for to, of, sign in ((a, b, 1.0), (b, a, -1.0)):
                doubt = np.einsum("td,tde,te->t", direction, _matrices(covariance[:, of]), direction) + deviation**2 + (1e-3 * length) ** 2
                error = sign * length + ((free.points[:, of] - found[:, to]) * direction).sum(-1)
                gain = np.einsum("tde,te->td", held[:, to], direction)
                total = doubt + (gain * direction).sum(-1) + 1e-300
                found[:, to] += gain * (error / total)[:, None]
                held[:, to] -= gain[:, :, None] * gain[:, None] / total[:, None, None]
        points = found
    return points, held[..., row, column] + covariance - free.covariance


def _estimate_by_parts(recording: _Recording) -> _Estimate:
    """Of a long recording: parts that overlap give the weights and the scales, in several threads; the path is that of all frames at once."""
    views, frames, joints = recording.is_seen.shape
    starts = range(0, frames - _PART // 2, _PART)

    def estimate(start: int) -> tuple[npt.NDArray[np.bool_], _Estimate] | None:
        part = recording.part(slice(max(start - _OVERLAP, 0), end(start) + _OVERLAP))
        is_seen = part.is_seen.any((0, 1))
        return (is_seen, _estimate(part.of_joints(is_seen))) if is_seen.any() else None

    def end(start: int) -> int:
        return frames if start == starts[-1] else start + _PART

    with concurrent.futures.ThreadPoolExecutor(inputs.processors()) as pool:
        parts = list(pool.map(estimate, starts))
    # A joint that a part does not see has the scales that it has in the others.
    scales = _pooled([part for part in parts if part is not None], views, joints)
    centre, _ = recording.centre()
    points = np.broadcast_to(centre, (frames, joints, recording.dim)).copy()
    probability, weight = np.zeros((2, views, frames, joints))
    stiffness = np.broadcast_to(1 / scales.motion, (frames - 2, joints)).copy()
    for start, found in zip(starts, parts):
        if found is None:
            continue
        is_seen, part = found
        to, of = slice(start, end(start)), slice(start - max(start - _OVERLAP, 0), None)
        size = end(start) - start
        points[to, is_seen] = part.points[of][:size]
        for whole, piece in ((probability, part.probability), (weight, part.weight)):
            whole[:, to, is_seen] = piece[:, of][:, :size]
        changes = stiffness[to]  # those that begin in the part
        changes[:, is_seen] = part.stiffness[of][: len(changes)]
    stiffness = np.minimum(stiffness, 16 / (_STILL * scales.extent) ** 2)  # a part of which the joints rest knows a smaller scene
    points, covariance, _ = _posterior(recording, points, weight, stiffness, scales, centre)
    return _Estimate(scales, points, covariance, probability, weight, stiffness)


def _estimate(recording: _Recording) -> _Estimate:
    """By expectation-maximisation."""
    views, frames, joints = recording.is_seen.shape
    centre, magnification = recording.centre()
    scales = _first_guess(recording, magnification)
    extent = scales.extent
    smallest = 1e-5 * extent * float(np.median(magnification))
    calm = np.ones((max(frames - 2, 0), joints))  # the weight of each change of velocity: small where the joint moves suddenly
    points = np.broadcast_to(centre, (frames, joints, recording.dim)).copy()
    width = np.sqrt(recording.area.max()) / 4
    probability = recording.is_seen.astype(float)
    for _ in range(3 if recording.dim == 3 else 1):  # until the depth, which scales a ray's weight, is about right
        used = probability / width**2
        points, covariance, spread = _posterior(recording, points, used, calm / scales.motion, scales, centre, True)
    remaining = _EM_STEPS
    target = float(np.median(scales.noise))
    while remaining:
        is_wide = width > target
        square = _asterism._pose_squares(points, covariance, recording.sights, recording.cameras, scales.offset)
        # Expectation: which detections are no outliers.
        variance = np.maximum(scales.noise[:, None], width) ** 2
        prior = (1 - _OUTLIERS) * recording.belief
        base = 1 + square / (_DETECTION * variance)  # to the power of 1 + _DETECTION / 2
        expected, surprise = variance, base
        if recording.dim == 2:  # what the other detections predict, with the uncertainty that the motion leaves there
            doubt = covariance[..., 0]  # in each coordinate
            others = np.maximum(1 - used * doubt, 1e-3)
            expected = variance + doubt / others
            surprise = 1 + np.maximum(square - 2 * doubt, 0) / (others**2 * _DETECTION * expected)
        likelihood = prior / (2 * np.pi * expected * surprise * surprise * surprise)
        probability = recording.is_seen * likelihood / (likelihood + (1 - prior) / recording.area[:, None, None] + 1e-300)
        trust = probability * ((1 + 2 / _DETECTION) / base)
        # Maximisation: the scales.
        if width < 4 * target:
            total, count = (trust * square).sum(1), 2 * probability.sum(1)
            common = total.sum() / max(count.sum(), 1e-9)
            scales.noise = np.maximum(np.sqrt((total + _PRIOR_COUNT * common) / (count + _PRIOR_COUNT)), smallest)
        if width < 30 * target:
            scales.offset, scales.disagreement = _disagreement(recording, points, probability)
        if frames > 2:
            change = (recording.differences(points) ** 2).sum(-1) + spread
            near, count = _sums_of_neighbours(change)
            calm = (_MOTION + recording.dim * count) / (_MOTION + near / scales.motion)
            if not is_wide:
                scales.motion = np.maximum((calm * change).mean(0) / recording.dim, (_STILL * extent) ** 2)
        variance = np.maximum(scales.noise[:, None], width) ** 2
        used = trust / variance
        points, covariance, spread = _posterior(recording, points, used, calm / scales.motion, scales, centre, width > 30 * target)
        width, remaining = width / 2, remaining - (not is_wide)
    return _Estimate(scales, points, covariance, probability, used, calm / scales.motion)


def _sums_of_neighbours(change: _Floats) -> tuple[_Floats, _Floats]:
    """Sums of _BURST neighbouring rows, fewer at the ends, and how many they are, as a column."""
    half, count = min(_BURST // 2, len(change) - 1), np.ones((len(change), 1))
    total, number = change.copy(), count.copy()
    for k in range(1, half + 1):
        for to, of in ((slice(k, None), slice(None, -k)), (slice(None, -k), slice(k, None))):
            total[to] += change[of]
            number[to] += count[of]
    return total, number


#: Of the noise that all views and joints have in common, in detections.
_PRIOR_COUNT = 10.0


def _first_guess(recording: _Recording, magnification: _Floats) -> _Scales:
    """Noise of a detection, motion of each joint and the size of the scene.

    All are medians, which bear outliers; the noise counts as motion as well, from which the evidence separates it.
    """
    scale = np.sqrt(np.abs(np.linalg.det(recording.sights[..., 2:].reshape(*recording.is_seen.shape, 2, 2))))
    seen = np.where(recording.is_seen[..., None], recording.sights[..., :2] * scale[..., None], np.nan)
    views, _, joints = recording.is_seen.shape

    def guess(noise: float, motion: _Floats) -> _Scales:
        return _Scales(np.full((views, joints), noise), motion, np.zeros((views, joints, 2)), 0.0, extent)

    spread = np.nanpercentile(seen, 90, axis=1) - np.nanpercentile(seen, 10, axis=1)
    middle = np.nanmedian(seen, axis=1)
    apart = np.nanpercentile(middle, 90, axis=1) - np.nanpercentile(middle, 10, axis=1)
    size = np.concatenate([spread, apart[:, None]], axis=1).max(-1) / magnification[:, None]
    extent = float(np.nanmax(np.nanmedian(size, axis=0)))
    extent = extent if extent > 0 else float(1 / np.median(magnification))
    smallest = 1e-4 * extent * float(np.median(magnification))
    if len(recording.times) < 3:
        return guess(max(1.0, smallest), np.full(joints, extent**2))
    second = np.abs(seen[:, 2:] - 2 * seen[:, 1:-1] + seen[:, :-2])
    noise = float(np.nanmean(np.nanmedian(second, (1, 3)))) / (0.6745 * np.sqrt(6))
    smooth = np.stack([_running_median(view) for view in seen])
    change = np.stack([recording.differences(view) for view in smooth]) / magnification[:, None, None, None]
    motion = np.nanmedian(np.nanmedian((change**2).sum(-1), 1), 0) / recording.dim
    floor = max(1e-3 * float(np.nanmedian(motion)) if np.isfinite(motion).any() else 0.0, (_STILL * extent) ** 2)
    return guess(max(noise if np.isfinite(noise) else 0.0, smallest), np.maximum(np.nan_to_num(motion), floor))


def _running_median(path: _Floats, width: int = 7) -> _Floats:
    padded = np.pad(path, ((width // 2, width // 2), (0, 0), (0, 0)), constant_values=np.nan)
    return np.nanmedian(np.lib.stride_tricks.sliding_window_view(padded, width, axis=0), -1)


def _disagreement(recording: _Recording, points: _Floats, probability: _Floats) -> tuple[_Floats, float]:
    """What each view is off by for each joint in all frames (V, J, 2) [px], and the standard deviation of errors that last.

    A calibration and a detector have errors that no average over frames removes. The offsets are the part of the mean errors that no place of the joint
    explains; what neighbouring frames have in common is the variance of errors that last, for the degrees of freedom that the joint's place leaves.
    """
    views, frames, joints = recording.is_seen.shape
    if views == 1:
        return np.zeros((1, joints, 2)), 0.0
    rows, errors = _asterism._pose_residuals(points, recording.sights, recording.cameras)
    share = probability / np.maximum(probability.sum(1, keepdims=True), 1e-300)
    slope = np.einsum("vtj,vtjkd->jvkd", share, rows).reshape(joints, 2 * views, recording.dim)
    mean = np.einsum("vtj,vtjk->jvk", share, errors).reshape(joints, 2 * views)
    is_present = np.repeat(probability.sum(1).T > 0, 2, 1)
    unexplained = is_present[:, :, None] * np.eye(2 * views) - slope @ np.linalg.pinv(slope, rcond=1e-6)
    offset = -(unexplained @ mean[..., None])[..., 0]
    freedom = np.trace(unexplained, axis1=1, axis2=2).sum()
    both = probability[:, 1:] * probability[:, :-1]
    shared = (both * (errors[:, 1:] * errors[:, :-1]).sum(-1)).sum(1) / np.maximum(both.sum(1), 1e-9)
    lasting = float(np.sqrt(max(float(shared.sum()), float((offset**2).sum())) / freedom)) if freedom > 0.5 else 0.0
    return np.ascontiguousarray(offset.reshape(joints, views, 2).transpose(1, 0, 2)), lasting


def _systematic(recording: _Recording, points: _Floats, disagreement: float) -> _Floats:
    """Covariance of the points (T, J, entries) if each view is off by the disagreement in all frames."""
    row, column = np.triu_indices(recording.dim)
    if disagreement == 0:
        return np.zeros((*points.shape[:2], len(row)))
    is_used = np.repeat(recording.is_seen.any(1, keepdims=True), len(recording.times), 1).astype(float)
    information, _ = _asterism._pose_evidence(
        points, recording.sights, recording.cameras, is_used, np.zeros((len(is_used), is_used.shape[2], 2)), False
    )
    matrices = _matrices(information)
    scale = np.trace(matrices, axis1=-2, axis2=-1) / recording.dim
    is_flat = ~(np.linalg.det(matrices) > 1e-12 * scale**recording.dim)  # one view: what is across its ray
    found = np.empty_like(matrices)
    found[is_flat] = np.linalg.pinv(matrices[is_flat], rcond=1e-9, hermitian=True)
    found[~is_flat] = np.linalg.inv(matrices[~is_flat])
    return disagreement**2 * found[..., row, column]


def _pooled(parts: list[tuple[npt.NDArray[np.bool_], _Estimate]], views: int, joints: int) -> _Scales:
    """The scales of a recording, of those of its parts and the joints which they see."""

    def mean(values: list[_Floats], shape: tuple[int, ...], axis: int) -> _Floats:
        total, count = np.zeros(shape), np.zeros(joints)
        for (is_seen, _), value in zip(parts, values):
            total[(slice(None),) * axis + (is_seen,)] += value
            count += is_seen
        return total / count.reshape(-1, *[1] * (len(shape) - axis - 1))

    scales = [part.scales for _, part in parts]
    return _Scales(
        np.exp(mean([np.log(s.noise) for s in scales], (views, joints), 1)),
        mean([s.motion for s in scales], (joints,), 0),
        mean([s.offset for s in scales], (views, joints, 2), 1),
        float(np.sqrt(np.mean([s.disagreement**2 for s in scales]))),
        max(s.extent for s in scales),
    )


def _matrices(entries: _Floats) -> _Floats:
    """(..., D, D) of upper triangles (..., entries)."""
    dim = 2 if entries.shape[-1] == 3 else 3
    row, column = np.triu_indices(dim)
    found = np.empty((*entries.shape[:-1], dim, dim))
    found[..., row, column] = found[..., column, row] = entries
    return found


def _limb_lengths(points: _Floats, covariance: _Floats, limbs: npt.NDArray[np.intp]) -> tuple[_Floats, _Floats]:
    """Length and deviation of each limb (L,), by maximum likelihood: frames in which a limb is known better count more."""
    lengths, deviations = np.zeros(len(limbs)), np.zeros(len(limbs))
    for limb, (a, b) in enumerate(limbs):
        offset = points[:, a] - points[:, b]
        found = np.linalg.norm(offset, axis=-1)
        direction = offset / np.maximum(found, 1e-300)[:, None]
        error = np.einsum("td,tde,te->t", direction, _matrices(covariance[:, a] + covariance[:, b]), direction)
        mean, variance = float(np.median(found)), float(np.var(found))
        for _ in range(50):
            kept = variance / np.maximum(variance + error, 1e-300)
            weight = 1 / np.maximum(variance + error, 1e-300)
            mean = float((weight * found).sum() / weight.sum())
            variance = float(np.mean((kept * (found - mean)) ** 2 + kept * error))
        lengths[limb], deviations[limb] = mean, np.sqrt(variance)
    return lengths, deviations


@dataclasses.dataclass(frozen=True, eq=False)
class Detections:
    """The key-points of one file."""

    #: Of the joints.
    joints: list[str]
    #: (T, J, 2), or (T, J, 3) for points in space; NaN where a joint was not seen.
    points: _Floats
    #: (T, J), in [0, 1]; 1 where the file has none.
    confidence: _Floats
    #: What the first column says, one a frame.
    frames: list[str]

    __repr__ = inputs.brief


def read_cameras(path: str | os.PathLike[str]) -> list[Camera]:
    """The cameras of aniposelib's TOML, in the order of the file. OSError if it cannot be read; ValueError that names the file and the camera."""
    import tomllib

    try:
        tables = tomllib.loads(pathlib.Path(path).read_bytes().decode())
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ValueError(f"{os.fspath(path)}: {error}") from None
    cameras = []
    for key, table in tables.items():
        if not isinstance(table, dict) or key == "metadata":
            continue
        try:
            if table.get("fisheye"):
                raise ValueError("fisheye lenses are not supported")
            missing = [field for field in ("matrix", "rotation", "translation") if field not in table]
            if missing:
                raise ValueError(f"no {missing[0]}")
            cameras.append(
                Camera(table["matrix"], table["rotation"], table["translation"], table.get("distortions", ()), table.get("size"), str(table.get("name", key)))
            )
        except (ValueError, TypeError) as error:
            raise ValueError(f"{os.fspath(path)}: {key}: {error}") from None
    if not cameras:
        raise ValueError(f"{os.fspath(path)}: no cameras")
    return cameras


def read_detections(path: str | os.PathLike[str]) -> Detections:
    """Key-points of one view: a table as DeepLabCut writes it (.csv, .h5), SLEAP's analysis file (.h5, .hdf5), or a plain table.

    Two or three header lines of the first are scorer, bodyparts and coords; a plain table has one line, NAME_x, NAME_y and perhaps NAME_likelihood or
    NAME_z. HDF5 needs h5py: ImportError without it. OSError if the file cannot be read, ValueError with file and line if it is no such table.
    """
    if pathlib.Path(path).suffix.lower() in (".h5", ".hdf5"):
        return _read_hdf5(path)
    name = os.fspath(path)
    with open(path, newline="", encoding="utf-8-sig") as file:
        reader = csv.reader(file)
        numbered = [(reader.line_num, row) for row in reader if row]
    rows = [row for _, row in numbered]
    if not rows:
        raise ValueError(f"{name}: empty")
    head = {row[0].strip().lower(): row[1:] for row in rows[:3]}
    if "coords" in head and "bodyparts" in head:
        first = 1 + next(line for line, row in enumerate(rows) if row[0].strip().lower() == "coords")
        columns = list(zip(head["bodyparts"], head["coords"]))
    else:
        first, columns = 1, [tuple(title.rsplit("_", 1)) if "_" in title else (title, "") for title in rows[0][1:]]
    joints = list(dict.fromkeys(joint for joint, _ in columns))
    place = {column: k for k, column in enumerate(columns)}
    if len(place) < len(columns) or not columns:
        raise ValueError(f"{name}: expected columns x, y and likelihood for each joint, once each")
    axes = ["x", "y"] + (["z"] if any(kind == "z" for _, kind in columns) else [])
    for joint in joints:
        for axis in axes:
            if (joint, axis) not in place:
                raise ValueError(f"{name}: joint {joint} has no column {axis}")
    values = np.full((len(rows) - first, len(columns)), np.nan)
    for found, (number, row) in zip(values, numbered[first:]):
        if len(row) != len(columns) + 1:
            raise ValueError(f"{name}:{number}: expected {len(columns) + 1} cells, found {len(row)}")
        for k, cell in enumerate(row[1:]):
            try:
                found[k] = float(cell) if cell.strip() else np.nan
            except ValueError:
                raise ValueError(f"{name}:{number}: not a number: {cell!r}") from None
    if not len(values):
        raise ValueError(f"{name}: no frames")
    points = np.stack([values[:, [place[joint, axis] for joint in joints]] for axis in axes], -1)
    points[np.isnan(points).any(-1)] = np.nan
    confidence = np.ones(points.shape[:2])
    for j, joint in enumerate(joints):
        if (joint, "likelihood") in place:
            confidence[:, j] = values[:, place[joint, "likelihood"]]
    return Detections(joints, points, np.where(np.isnan(confidence), 1.0, confidence), [row[0] for row in rows[first:]])


def _read_hdf5(path: str | os.PathLike[str]) -> Detections:
    try:
        import h5py
    except ImportError:
        raise ImportError(f"{os.fspath(path)}: HDF5 needs the package h5py (Debian: python3-h5py)") from None
    with h5py.File(path, "r") as file:
        if "tracks" not in file or "node_names" not in file:
            raise ValueError(f"{os.fspath(path)}: expected SLEAP's analysis file, with tracks and node_names; export DeepLabCut's tables as CSV")
        tracks = np.array(file["tracks"], float)  # (tracks, 2, nodes, frames)
        if tracks.ndim != 4 or len(tracks) != 1:
            raise ValueError(f"{os.fspath(path)}: expected one animal, found tracks of shape {tracks.shape}")
        joints = [n.decode() if isinstance(n, bytes) else str(n) for n in file["node_names"]]
        points = tracks[0].transpose(2, 1, 0)
        confidence = np.array(file["point_scores"], float)[0].T if "point_scores" in file else np.ones(points.shape[:2])
    points[np.isnan(points).any(-1)] = np.nan
    return Detections(joints, points, np.clip(np.where(np.isnan(confidence), 1.0, confidence), 0, 1), [str(t) for t in range(len(points))])


def write_points(path: str | os.PathLike[str], points: npt.ArrayLike, joints: Sequence[str], frames: Sequence[str] | None = None) -> None:
    """Points (T, J, 2) or (T, J, 3) as a table that read_detections reads, in DeepLabCut's form; NaN becomes an empty cell."""
    values = inputs.numbers(points, "points", missing=np.nan)
    if values.ndim != 3 or values.shape[2] not in (2, 3):
        raise ValueError(f"points: expected shape (frames, joints, 2 or 3), found {values.shape}")
    if len(joints) != values.shape[1] or len(set(joints)) != len(joints):
        raise ValueError(f"joints: expected {values.shape[1]} different names")
    titles = [str(t) for t in range(len(values))] if frames is None else list(frames)
    if len(titles) != len(values):
        raise ValueError(f"frames: expected {len(values)}, found {len(titles)}")
    axes = "xyz"[: values.shape[2]]
    with open(path, "w", newline="", encoding="utf-8") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(["bodyparts", *(joint for joint in joints for _ in axes)])
        table.writerow(["coords", *(axis for _ in joints for axis in axes)])
        for title, row in zip(titles, values.reshape(len(values), -1)):
            table.writerow([title, *("" if np.isnan(value) else repr(float(value)) for value in row)])
