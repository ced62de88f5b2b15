"""The energy of asterism.pose: scales, weights and points by expectation-maximisation."""

from __future__ import annotations

import concurrent.futures
import dataclasses
import functools

import numpy as np
import numpy.typing as npt

from . import _asterism, inputs

_Floats = npt.NDArray[np.float64]


@dataclasses.dataclass
class _Scales:
    """Estimates from the data besides the points."""

    noise: _Floats  # (V, J)
    motion: _Floats  # (J,), a variance
    offset: _Floats  # (V, J, 2): what the views are off by in all frames
    disagreement: float
    extent: float  # of the scene


class _Recording:
    """Detections as the energy sees them: sights, and the frames' second differences."""

    def __init__(
        self, sights: _Floats, is_seen: npt.NDArray[np.bool_], belief: _Floats, times: _Floats, cameras: _Floats, area: _Floats,
        deviation: _Floats | None = None,
    ):
        self.sights, self.is_seen, self.belief = sights, is_seen, belief
        #: (V, T, J), of errors that last over frames, if known; and the variance of a detection as a multiple of that of its view and joint.
        self.deviation, self.doubt = deviation, np.ones(1)
        if deviation is not None:
            level = np.where(is_seen, np.log(deviation), 0).sum(1) / np.maximum(is_seen.sum(1), 1)
            self.doubt = deviation**2 / np.exp(2 * level)[:, None]
        self.times, self.cameras, self.area = times, cameras, area
        self.dim = 3 if len(cameras) else 2
        # Of the change of velocity at a frame between two others, divided by the square root of the time it has.
        step = np.diff(times)
        before, after = 1 / step[:-1], 1 / step[1:]
        self.difference = np.stack([before, -before - after, after], 1) / np.sqrt((step[:-1] + step[1:]) / 2)[:, None]

    def part(self, frames: slice) -> _Recording:
        return _Recording(
            np.ascontiguousarray(self.sights[:, frames]), self.is_seen[:, frames], self.belief[:, frames], self.times[frames], self.cameras, self.area,
            None if self.deviation is None else self.deviation[:, frames],
        )

    def of_joints(self, which: npt.NDArray[np.bool_]) -> _Recording:
        return _Recording(
            np.ascontiguousarray(self.sights[:, :, which]), self.is_seen[..., which], self.belief[..., which], self.times, self.cameras, self.area,
            None if self.deviation is None else self.deviation[..., which],
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


@dataclasses.dataclass
class _Estimate:
    """The scales that explain a recording best."""

    scales: _Scales
    points: _Floats  # (T, J, D)
    covariance: _Floats  # (T, J, entries)
    probability: _Floats  # (V, T, J): that a detection is no outlier
    weight: _Floats  # (V, T, J): of each detection
    stiffness: _Floats  # (T - 2, J): the weight of each change of velocity


#: The frames of a part of a long recording, and how many its neighbours share with it on each side.
_PART = 500
_OVERLAP = 100
#: Steps end when they change the points and their deviations by less than this share of these, and at the latest after _EM_STEPS.
_SETTLED = 0.05
_EM_STEPS = 30
#: The variance of motion converges slowly, a few percent in a step: so many steps of its logarithm at once.
_OVERRELAXED = 3.0
#: Degrees of freedom of Student's t distribution of detections in the plane, and of changes of velocity: animals rest, and start suddenly.
_DETECTION = 4.0
_MOTION = 1.0
#: Sudden motions come in bursts: so many neighbouring changes of velocity, an odd number, share a variance.
_BURST = 5
#: How probable an outlier is beforehand. An estimate instead takes sudden motions for outliers, and then finds many.
_OUTLIERS = 0.01
#: The least change of velocity in a frame, in sizes of the scene: that of a joint which rests, or is seen once.
_STILL = 1e-5


def _estimate(recording: _Recording) -> _Estimate:
    """By expectation-maximisation, until the points and their covariance settle."""
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
        before = points, covariance
        square = _asterism._pose_squares(points, covariance, recording.sights, recording.cameras, scales.offset)
        # Expectation: which detections are no outliers.
        variance = np.maximum(scales.noise[:, None], width) ** 2 * recording.doubt
        probability, trust = _trust(recording, square, covariance, used, variance)
        # Maximisation: the scales.
        if width < 4 * target:
            total, count = (trust * square / recording.doubt).sum(1), 2 * probability.sum(1)
            common = total.sum() / max(count.sum(), 1e-9)
            scales.noise = np.maximum(np.sqrt((total + _PRIOR_COUNT * common) / (count + _PRIOR_COUNT)), smallest)
        if width < 30 * target:
            scales.offset, scales.disagreement = _disagreement(recording, points, probability)
        if frames > 2:
            change = (recording.differences(points) ** 2).sum(-1) + spread
            calm = _calmness(change / scales.motion, recording.dim)
            if not is_wide:
                step = (calm * change).mean(0) / recording.dim / scales.motion
                scales.motion = np.maximum(scales.motion * step**_OVERRELAXED, (_STILL * extent) ** 2)
        variance = np.maximum(scales.noise[:, None], width) ** 2 * recording.doubt
        used = trust / variance
        points, covariance, spread = _posterior(recording, points, used, calm / scales.motion, scales, centre, width > 30 * target)
        width, remaining = width / 2, remaining - (not is_wide)
        if not is_wide and _is_settled(before, points, covariance):
            break
    return _Estimate(scales, points, covariance, probability, used, calm / scales.motion)


def _is_settled(before: tuple[_Floats, _Floats], points: _Floats, covariance: _Floats) -> bool:
    """Whether a step moved the points by less than _SETTLED standard deviations, and changed these by less than that share (root mean squares).

    The scales themselves are not asked: those of a joint that moves little change long after they have stopped to matter.
    """
    _, _, diagonal = _upper(points.shape[2])
    variance = covariance[..., diagonal].sum(-1)
    moved = ((points - before[0]) ** 2).sum(-1) / variance
    change = np.log(variance / before[1][..., diagonal].sum(-1)) / 2
    return bool(max(moved.mean(), (change**2).mean()) < _SETTLED**2)


def _trust(recording: _Recording, square: _Floats, covariance: _Floats, used: _Floats, variance: _Floats) -> tuple[_Floats, _Floats]:
    """For each detection (V, T, J) the probability that it is no outlier, and that times its weight in Student's t distribution.

    square: the expected square of its error; covariance: of the points, for which the weights used were; variance: of a detection, in each coordinate.
    """
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
    return probability, probability * ((1 + 2 / _DETECTION) / base)


def _calmness(change: _Floats, dim: int) -> _Floats:
    """The weight of each change of velocity, of the expected squares in units of the variance (T - 2, J)."""
    near, count = _sums_of_neighbours(change)
    return (_MOTION + dim * count) / (_MOTION + near)


def _sums_of_neighbours(change: _Floats) -> tuple[_Floats, _Floats]:
    """Sums of _BURST neighbouring rows, fewer at the ends, and how many they are, as a column."""
    half, count = min(_BURST // 2, len(change) - 1), np.ones((len(change), 1))
    total, number = change.copy(), count.copy()
    for k in range(1, half + 1):
        for to, of in ((slice(k, None), slice(None, -k)), (slice(None, -k), slice(k, None))):
            total[to] += change[of]
            number[to] += count[of]
    return total, number


def _posterior(
    recording: _Recording, points: _Floats, weight: _Floats, stiffness: _Floats, scales: _Scales, centre: _Floats, along_ray: bool = False
) -> tuple[_Floats, _Floats, _Floats]:
    """Points and their covariance, given the weights, and the covariance's share in the square of each change of velocity."""
    weak = (100 * scales.extent) ** -2  # the prior of a point, which holds where nothing else does
    information, right = _asterism._pose_evidence(points, recording.sights, recording.cameras, weight, scales.offset, along_ray)
    information[..., _upper(recording.dim)[2]] += weak
    right += weak * centre
    return _asterism._difference_chains(information, right, recording.difference, stiffness)[:3]


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
    """The offset of each view for each joint in all frames (V, J, 2) [px], and the standard deviation of errors that last.

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
    row, column, _ = _upper(recording.dim)
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
    if is_flat.any():
        found[is_flat] = np.linalg.pinv(matrices[is_flat], rcond=1e-9, hermitian=True)
    found[~is_flat] = np.linalg.inv(matrices[~is_flat])
    return disagreement**2 * found[..., row, column]


def _lasting(recording: _Recording, found: _Estimate) -> _Floats:
    """Covariance of the points (T, J, entries) if each view is off by its deviation, alike in frames near each other.

    Such an error is no noise that frames average out: the path follows it as it follows a motion.
    """
    (views, frames, joints), dim = recording.is_seen.shape, recording.dim
    none = np.zeros((views, joints, 2))
    information, _ = _asterism._pose_evidence(found.points, recording.sights, recording.cameras, found.weight, none, False)
    row, column, diagonal = _upper(dim)
    information[..., diagonal] += (100 * found.scales.extent) ** -2
    rows, _ = _asterism._pose_residuals(found.points, recording.sights, recording.cameras)
    covariance = np.zeros((frames, joints, len(row)))
    for view in range(views):
        size = (found.weight[view] * recording.deviation[view])[..., None]
        for axis in range(2):
            shift = _asterism._difference_chains(information, rows[view, :, :, axis] * size, recording.difference, found.stiffness, False)[0]
            covariance += shift[..., row] * shift[..., column]
    return covariance


def _estimate_by_parts(recording: _Recording) -> _Estimate:
    """Estimates a long recording: parts that overlap give the weights and the scales, in several threads; the path is that of all frames at once."""
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


@functools.cache
def _upper(dim: int) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp], npt.NDArray[np.bool_]]:
    """Of the entries of a symmetric matrix's upper triangle: rows, columns, and which are on the diagonal."""
    row, column = np.triu_indices(dim)
    return row, column, row == column


def _matrices(entries: _Floats) -> _Floats:
    """(..., D, D) of upper triangles (..., entries)."""
    dim = 2 if entries.shape[-1] == 3 else 3
    row, column, _ = _upper(dim)
    found = np.empty((*entries.shape[:-1], dim, dim))
    found[..., row, column] = found[..., column, row] = entries
    return found
