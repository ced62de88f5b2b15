"""The energy of asterism.pose: scales, weights and points by expectation-maximisation, which pose_estimate.hpp does."""

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
    """Detections as the energy sees them, as arrays and for the compiled functions."""

    def __init__(
        self, sights: _Floats, is_seen: npt.NDArray[np.bool_], belief: _Floats, times: _Floats, cameras: _Floats, area: _Floats,
        deviation: _Floats | None = None,
    ):
        # Of all estimates the unit of time is that of a typical frame, as the least motion is one in a frame.
        self.frame_time = float(np.median(np.diff(times))) if len(times) > 1 else 1.0
        self.times = (times - times[0]) / self.frame_time
        self.is_seen, self.belief, self.deviation = is_seen, belief, deviation
        self.dim = 3 if len(cameras) else 2

        def about(origin: _Floats) -> _asterism._PoseRecording:
            return _asterism._PoseRecording(sights, is_seen, belief, self.times, _moved(cameras, origin), area, deviation)

        # That of the points, near which numbers are small, wherever the world has its own.
        self.origin = np.zeros(2)
        if self.dim == 3:
            self.origin = _places(cameras).mean(0)
            self.origin = self.origin + about(self.origin).centre()
        self.compiled = about(self.origin)


def _places(cameras: _Floats) -> _Floats:
    """Of cameras (V, 12), in the world (V, 3)."""
    return -np.einsum("vrc,vr->vc", cameras[:, :9].reshape(-1, 3, 3), cameras[:, 9:])


def _moved(cameras: _Floats, origin: _Floats) -> _Floats:
    """Cameras (V, 12) in a world whose origin is there."""
    if not len(cameras):
        return cameras
    return np.concatenate([cameras[:, :9], cameras[:, 9:] + cameras[:, :9].reshape(-1, 3, 3) @ origin], 1)


@dataclasses.dataclass
class _Estimate:
    """The scales that explain a recording best."""

    scales: _Scales
    points: _Floats  # (T, J, D)
    covariance: _Floats  # (T, J, entries)
    probability: _Floats  # (V, T, J): that a detection is not an outlier
    weight: _Floats  # (V, T, J): of each detection
    curvature: _Floats  # (V, T, J): what takes its place in the covariance
    stiffness: _Floats  # (T - 2, J): the weight of each change of velocity


#: The frames of a part of a long recording, and how many its neighbours share with it on each side.
_PART = 500
_OVERLAP = 100
#: Steps end when they change the points and their deviations by less than this share of these, and at the latest after _EM_STEPS.
_SETTLED = 0.05
_EM_STEPS = 30
#: The least change of velocity in a frame, in sizes of the scene.
_STILL = 1e-5


def _estimate(recording: _Recording, begin: int, end: int) -> tuple[npt.NDArray[np.intp], _Estimate] | None:
    """Of some frames: the joints that they see, and the estimate of these; None if there are none."""
    found = recording.compiled.estimate(begin, end, _SETTLED, _EM_STEPS)
    return None if found is None else (found[0], _Estimate(_Scales(*found[1]), *found[2:]))


def _lasting(recording: _Recording, found: _Estimate) -> _Floats:
    """Covariance of the points (T, J, entries) if each view is off by its deviation, alike in frames near each other.

    Such an error is not noise that frames average out: the path follows it as it follows a motion.
    """
    return recording.compiled.lasting(found.points, found.weight, found.stiffness, found.scales.extent, inputs.processors())


def _systematic(recording: _Recording, points: _Floats, disagreement: float) -> _Floats:
    """Covariance of the points (T, J, entries) if each view is off by the disagreement in all frames."""
    return recording.compiled.systematic(points, disagreement, inputs.processors())


def _estimate_by_parts(recording: _Recording) -> _Estimate:
    """Estimates a long recording: parts that overlap give the weights and the scales, in several threads; the path is that of all frames at once."""
    views, frames, joints = recording.is_seen.shape
    starts = range(0, frames - _PART // 2, _PART)

    def estimate(start: int) -> tuple[npt.NDArray[np.intp], _Estimate] | None:
        return _estimate(recording, max(start - _OVERLAP, 0), min(end(start) + _OVERLAP, frames))

    def end(start: int) -> int:
        return frames if start == starts[-1] else start + _PART

    with concurrent.futures.ThreadPoolExecutor(inputs.processors()) as pool:
        parts = list(pool.map(estimate, starts))
    # A joint that a part does not see has the scales that it has in the others.
    scales = _pooled([part for part in parts if part is not None], views, joints)
    centre = recording.compiled.centre()
    points = np.broadcast_to(centre, (frames, joints, recording.dim)).copy()
    probability, weight, curvature = np.zeros((3, views, frames, joints))
    stiffness = np.broadcast_to(1 / scales.motion, (frames - 2, joints)).copy()
    for start, found in zip(starts, parts):
        if found is None:
            continue
        joints_seen, part = found
        to, of = slice(start, end(start)), slice(start - max(start - _OVERLAP, 0), None)
        size = end(start) - start
        points[to, joints_seen] = part.points[of][:size]
        for whole, piece in ((probability, part.probability), (weight, part.weight), (curvature, part.curvature)):
            whole[:, to, joints_seen] = piece[:, of][:, :size]
        changes = stiffness[to]  # those that begin in the part
        changes[:, joints_seen] = part.stiffness[of][: len(changes)]
    stiffness = np.minimum(stiffness, 16 / (_STILL * scales.extent) ** 2)  # a part of which the joints rest knows a smaller scene
    points, covariance = recording.compiled.path(points, weight, curvature, stiffness, scales.offset, centre, scales.extent, inputs.processors())
    return _Estimate(scales, points, covariance, probability, weight, curvature, stiffness)


def _pooled(parts: list[tuple[npt.NDArray[np.intp], _Estimate]], views: int, joints: int) -> _Scales:
    """The scales of a recording, of those of its parts and the joints which they see."""

    def mean(values: list[_Floats], shape: tuple[int, ...], axis: int) -> _Floats:
        total, count = np.zeros(shape), np.zeros(joints)
        for (joints_seen, _), value in zip(parts, values):
            total[(slice(None),) * axis + (joints_seen,)] += value
            count[joints_seen] += 1
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
