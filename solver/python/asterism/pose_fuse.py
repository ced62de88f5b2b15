"""fuse, for asterism.pose: what it takes and gives, and limbs."""

from __future__ import annotations

import dataclasses
from typing import Any, Iterable

import numpy as np
import numpy.typing as npt

from . import _asterism, inputs
from .cameras import Camera
from .pose_estimate import _PART, _Estimate, _estimate, _estimate_by_parts, _Floats, _lasting, _matrices, _Recording, _systematic, _upper
from .pose_swaps import exchanged, swaps_by_paths


@dataclasses.dataclass(frozen=True, eq=False)
class FusedPose:
    """The result of fuse, for T frames, J joints and V views, in D = 2 or 3 dimensions."""

    #: (T, J, D): pixels, or the cameras' unit of length.
    points: _Floats
    #: Of each point: (T, J, D, D). Of one view alone it has only errors that change from frame to frame, and is too small where a network's errors last.
    covariance: _Floats
    #: (V, T, J): the detections that belong to no path, after swapped ones are exchanged. A missing one is not an outlier.
    outliers: npt.NDArray[np.bool_]
    #: (V, T, P): where the joints of a pair were swapped.
    swapped: npt.NDArray[np.bool_]
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
    #: (V, J, 2): what each view is off by in all frames [px], which is added to its errors; 0 with one view.
    offsets: _Floats
    #: Standard deviation of the errors of a view that last over frames, as a calibration's do [px]; 0 with one view, which cannot show them.
    disagreement: float

    __repr__ = inputs.brief


def fuse(
    detections: npt.ArrayLike,
    confidence: npt.ArrayLike | None = None,
    cameras: Iterable[Camera] | None = None,
    skeleton: Iterable[tuple[int, int]] | None = None,
    times: npt.ArrayLike | None = None,
    pairs: Iterable[tuple[int, int]] | None = None,
    deviation: npt.ArrayLike | None = None,
) -> FusedPose:
    """The paths of J joints over T frames that explain what V views detected, with covariance and outliers; nothing has to be tuned.

    detections: (V, T, J, 2) [px], or (T, J, 2) for one view; NaN, or a mask, where a joint was not seen. confidence: (V, T, J), or (T, J), in [0, 1]:
    the probability that the detection is not an outlier, relative to the greatest one; 1 if left out. cameras: one for each view, for points in
    space; without them the views are several detectors' results for one image. skeleton: pairs of joints. times: (T,), rising; frame numbers if left
    out. pairs: joints that the detector may have taken for each other, left and right, which are put right beforehand, by the paths of both joints and
    exchange_back; it takes three to twelve times as long.
    deviation: (V, T, J), or (T, J) for one view: the standard deviation of each detection in each coordinate [px], such as network_deviation
    estimates it from several networks. It covers errors that last over frames, and decides how much each detection counts.

    The points minimise a sum of squares, each in units of its variance: errors of the detections in the image, less a constant offset of each view,
    and changes of velocity along the path of each joint, both with Student's t distribution. Then, frame by frame, limbs are springs of a length
    that all frames share, as firm as the lengths turned out to be. Outliers have no weight: a detection may also be a point anywhere in the image.
    The solve goes from a wide distribution to a narrow one (graduated non-convexity). The variances maximise the evidence
    (expectation-maximisation with the exact covariances). A joint without detections in a frame is interpolated, and its covariance says so.
    Errors that last over frames are found where views disagree, and are part of the covariance. A single view cannot show them, and no data
    show errors that all views share.

    ValueError, which names the input, for other shapes, infinite numbers, a joint that is never seen, cameras two of which are the
    same or which do not belong to the detections, one camera, and times that do not rise.
    """
    cameras = None if cameras is None else inputs.items(cameras, "cameras", "a Camera for each view")
    recording, limbs, pixels = _checked(detections, confidence, cameras, skeleton, times, deviation)
    couples = inputs.joint_pairs(() if pairs is None else pairs, "pairs", pixels.shape[2])
    swapped = np.zeros((*recording.is_seen.shape[:2], len(couples)), bool)
    if len(couples):
        belief, known = None if confidence is None else recording.belief, recording.deviation

        def fused(where: npt.NDArray[np.bool_]) -> FusedPose:
            return fuse(exchanged(pixels, where, couples), exchanged(belief, where, couples), cameras, None, times, None, exchanged(known, where, couples))

        area = np.array([_area(view) for view in pixels]) if cameras is None else _calibration(cameras, pixels)[1]
        when = np.arange(len(recording.times)) if times is None else inputs.array(times, "times", recording.times.shape)
        swapped = swaps_by_paths(pixels, couples, when, cameras, area, fused)
        recording, limbs, pixels = _checked(
            exchanged(pixels, swapped, couples), exchanged(belief, swapped, couples), cameras, skeleton, times, exchanged(known, swapped, couples)
        )
    frames = len(recording.times)
    found = _estimate(recording, 0, frames)[1] if frames <= 2 * _PART else _estimate_by_parts(recording)
    scales, points = found.scales, found.points
    disagreement = scales.disagreement
    covariance = found.covariance
    if recording.deviation is not None:  # of what views disagree in, the rest
        covariance = covariance + _lasting(recording, found)
        disagreement = np.sqrt(max(disagreement**2 - float(np.mean(recording.deviation[recording.is_seen] ** 2)), 0.0))
    covariance = covariance + _systematic(recording, points, disagreement)
    lengths, deviations = _limb_lengths(points, covariance, limbs)
    if len(limbs):
        points, covariance = _with_limbs(found, covariance, limbs, lengths, deviations)
    points = points + recording.origin
    image = np.array([camera.project(points) for camera in cameras]) if recording.dim == 3 else np.array([points] * len(recording.is_seen))
    return FusedPose(
        points, _matrices(covariance), ~np.isnan(pixels[..., 0]) & (found.probability < 0.5), swapped, lengths, deviations, image,
        scales.noise, np.sqrt(scales.motion) / recording.frame_time**1.5, scales.offset, scales.disagreement,
    )


def _checked(
    detections: Any, confidence: Any, cameras: list[Camera] | None, skeleton: Any, times: Any, deviation: Any
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
        greatest = belief[~is_missing[..., 0]].max(initial=0)
        belief = belief / greatest if greatest > 0 else np.ones_like(belief)  # the same for all says nothing
    when = np.arange(frames, dtype=float) if times is None else inputs.array(times, "times", (frames,))
    if not np.isfinite(when).all():
        raise ValueError("times: expected finite numbers")
    if (np.diff(when) <= 0).any():
        t = int(np.argmax(np.diff(when) <= 0))
        raise ValueError(f"times: expected rising times, found {when[t]} before {when[t + 1]} at frame {t + 1}")
    if frames > 1 and not (np.diff(when).min() > 1e-150 and np.ptp(when) < 1e150):
        raise ValueError(f"times: another unit is needed for {frames} times between {when[0]} and {when[-1]}")
    limbs = inputs.joint_pairs(() if skeleton is None else skeleton, "skeleton", joints)
    if cameras is None:
        sights = np.zeros((views, frames, joints, 6))
        sights[..., :2], sights[..., 2], sights[..., 5] = pixels, 1, 1
        poses = np.zeros((0, 12))
        area = np.full(views, _area(pixels))
    else:
        poses, area = _calibration(cameras, pixels)
        sights = _sights(cameras, pixels)
    is_seen = np.isfinite(sights).all(-1)
    if not is_seen.any((0, 1)).all():
        raise ValueError(f"detections: joint {int(np.argmin(is_seen.any((0, 1))))} is never seen")
    sights[~is_seen] = 0
    for sight, seen in zip(sights, is_seen):  # errors that last are there without a detection as well: the pixels for a unit
        if seen.any():
            sight[~seen, 2:] = np.median(sight[seen, 2:], 0)
    known = None if deviation is None else _deviation(deviation, is_seen)
    return _Recording(sights, is_seen, np.clip(belief, 0.01, 1), when, poses, area, known), limbs, pixels


def _area(pixels: _Floats) -> float:
    """Of what is seen (.., 2) [px^2], in which an outlier may be anywhere. Detections on a line have a narrow one."""
    seen = pixels[~np.isnan(pixels[..., 0])]
    size = np.ptp(seen, 0) if len(seen) else np.zeros(2)
    if not size.max() < 1e150:  # of which the square is a number
        raise ValueError("detections: numbers that are too large")
    return float(np.prod(np.maximum(size, 1e-3 * size.max()))) if size.any() else 1.0


def _sights(cameras: list[Camera], pixels: _Floats) -> _Floats:
    """(V, T, J, 6): see Camera.undistort."""
    matrices, distortions = np.array([c.matrix for c in cameras]), np.array([c.distortions for c in cameras])
    return _asterism._pose_sights(pixels, matrices, distortions, inputs.processors())


def _deviation(deviation: Any, is_seen: npt.NDArray[np.bool_]) -> _Floats:
    """(V, T, J); a joint's mean where it was not seen."""
    known = inputs.numbers(deviation, "deviation", missing=np.nan)
    known = known[None] if known.ndim == 2 else known
    if known.shape != is_seen.shape:
        raise ValueError(f"deviation: expected shape {is_seen.shape}, found {known.shape}")
    if not (np.isfinite(known) & (known > 0))[is_seen].all():
        v, t, j = np.argwhere(is_seen & ~(np.isfinite(known) & (known > 0)))[0]
        raise ValueError(f"deviation: expected positive numbers, found {known[v, t, j]} in view {v}, frame {t}, joint {j}")
    mean = np.where(is_seen, known, 0).sum(1, keepdims=True) / np.maximum(is_seen.sum(1, keepdims=True), 1)
    return np.where(is_seen, known, np.where(mean > 0, mean, 1))


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
        if camera.size is None:  # its middle is about where the axis meets it
            area[view] = max(_area(seen), float(4 * np.prod(np.maximum(camera.matrix[:2, 2], 0))))
            continue
        area[view] = np.prod(camera.size)
        is_outside = ((seen < -0.05 * camera.size) | (seen > 1.05 * camera.size)).any(-1)
        if len(seen) and is_outside.mean() > 0.3:
            width, height = camera.size
            raise ValueError(
                f"cameras: {names[view]} is calibrated for an image of {width:g} x {height:g}, but {is_outside.mean():.0%} of its detections are outside of it"
            )
    return poses, area


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


#: In each, the directions of the limbs are those of the step before.
_SPRING_STEPS = 3


def _with_limbs(
    free: _Estimate, covariance: _Floats, limbs: npt.NDArray[np.intp], lengths: _Floats, deviations: _Floats
) -> tuple[_Floats, _Floats]:
    """Points and covariance if limbs are springs, of which the lengths and deviations are those of the estimate without them.

    In each frame a joint is held at the limb's length from where the other one is without limbs, as firmly as that place (covariance) and the length
    are known. If it were held at where the other one is with them, each would take the other's doubt for its own evidence, and the limbs would seem
    rigid. Nor do the limbs of other frames count, as what they are off by is alike. What lasts moves both ends: its covariance is left.
    """
    row, column, _ = _upper(free.points.shape[2])
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
