"""How far off one of several networks is, for asterism.pose."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from . import inputs

_Floats = npt.NDArray[np.float64]


def network_deviation(networks: npt.ArrayLike) -> _Floats:
    """The standard deviation [px], in each coordinate, of one network's detection from what the other networks say, for fuse's deviation.

    networks: (N, .., T, J, 2), what N >= 2 networks detected in the same images; NaN where none. Returns (.., T, J), which holds for any one of
        them.

    A network's errors last over frames, so its own path does not show them; the paths of other networks do. In a frame, N networks give a variance
    with 2 (N - 1) degrees of freedom, which are few. The frames of a joint therefore share a distribution of variances, an inverse chi-square one
    whose two parameters maximise the evidence, and each frame has the mean of its posterior (Smyth 2004). The variance of a network about the
    mean of the others is N / (N - 1) times the variance about the mean of all. Errors that all networks share do not show. ValueError for other
    shapes, and for a joint that no two networks see in one frame.
    """
    points = inputs.numbers(networks, "networks", missing=np.nan)
    if points.ndim < 4 or points.shape[-1] != 2 or len(points) < 2:
        raise ValueError(f"networks: expected shape (networks, .., frames, joints, 2) of two networks or more, found {points.shape}")
    if np.isinf(points).any():
        raise ValueError("networks: expected finite numbers, or NaN")
    is_seen = np.isfinite(points).all(-1)
    number = is_seen.sum(0)
    known = np.where(is_seen[..., None], points, 0)
    mean = known.sum(0) / np.maximum(number, 1)[..., None]
    square = (np.where(is_seen[..., None], points - mean, 0) ** 2).sum((0, -1))
    freedom = 2.0 * (number - 1)
    frames, joints = number.shape[-2:]
    extent = np.ptp(points[is_seen], 0).max() if is_seen.any() else 0.0
    least = float(1e-10 * extent or 1.0) ** 2  # of a variance, where networks agree
    found = np.empty((number.size // (frames * joints), frames, joints))
    for view, (squares, freedoms) in enumerate(zip(square.reshape(found.shape), freedom.reshape(found.shape))):
        for joint in range(joints):
            is_known = freedoms[:, joint] > 0
            if not is_known.any():
                raise ValueError(f"networks: no two networks see joint {joint} in one frame")
            prior, variance = _variances(squares[is_known, joint], freedoms[is_known, joint], least)
            total = prior + np.where(is_known, freedoms[:, joint], 0)
            found[view, :, joint] = (prior * variance + np.where(is_known, squares[:, joint], 0)) / np.maximum(total - 2, 0.5)
    return np.sqrt(found.reshape(number.shape) * len(points) / (len(points) - 1))


def _variances(square: _Floats, freedom: _Floats, least: float) -> tuple[float, float]:
    """Degrees of freedom and scale of the inverse chi-square distribution of variances, of which sums of squares with these degrees of freedom are."""
    square = np.maximum(square, max(1e-8 * float(square.mean()), least))
    different, which = np.unique(freedom, return_inverse=True)
    best = -np.inf, 1.0, 1.0
    for prior in np.logspace(-0.5, 2.5, 25):
        scale = float(np.median(square / freedom))
        for _ in range(100):  # of maximum likelihood, given the degrees of freedom
            before, scale = scale, float(np.mean((prior + freedom) * square / freedom / (prior + square / scale)))
            if abs(scale - before) < 1e-6 * scale:
                break
        constant = np.array([math.lgamma((prior + d) / 2) - math.lgamma(d / 2) - math.lgamma(prior / 2) for d in different])[which]
        evidence = constant - freedom / 2 * np.log(prior * scale / square) - (prior + freedom) / 2 * np.log1p(square / (prior * scale))
        best = max(best, (float(evidence.sum()), float(prior), scale))
    return best[1], best[2]
