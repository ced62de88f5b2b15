"""Positions, and paths, from ranges to beacons."""

from __future__ import annotations

import dataclasses
import functools
from typing import Any

import numpy as np
import numpy.typing as npt

from . import _asterism, inputs

_Floats = npt.NDArray[np.float64]


@dataclasses.dataclass(frozen=True, eq=False)
class PositionMinimum:
    """A local minimum of the energy: a place that fits the ranges."""

    #: (dim,) [m].
    x: _Floats
    #: (dim, dim), the inverse of the Hessian: Laplace's approximation [m^2].
    covariance: _Floats
    #: 1/2 sum ((|x - beacon| - range) / sigma)^2, where no term exceeds cutoff^2 / 2.
    energy: float
    #: The part of the posterior probability of all listed minima, by Laplace's approximation.
    weight: float

    __repr__ = inputs.brief


@dataclasses.dataclass(frozen=True, eq=False)
class PositionFix:
    """The result of locate: of one tag, or of each tag of a batch along a leading axis (tags, ...)."""

    #: The most probable position: (dim,) [m].
    x: _Floats
    #: Its covariance: (dim, dim) [m^2].
    covariance: _Floats
    #: The energy there.
    energy: Any
    #: Whether it is proven that x is the global minimum and that `minima` is complete, up to `within` above its energy.
    proven: Any
    #: That of the call, or less where that would be more than 32 minima.
    within: Any
    #: (M,): which ranges have a residual of the cutoff or more at x.
    outliers: npt.NDArray[np.bool_]
    #: What the geometry cannot tell, why nothing is proven, or that no position fits the ranges; "" if there is nothing to say. Of a batch a list.
    message: Any
    _all: tuple[npt.NDArray[np.int32], _Floats, _Floats, _Floats, _Floats] = dataclasses.field(repr=False)
    _is_batch: bool = dataclasses.field(repr=False)

    __repr__ = inputs.brief

    @functools.cached_property
    def minima(self) -> list[Any]:
        """All minima within the given energy, the lowest first: a list of PositionMinimum; of a batch, a list of such lists."""
        counts, *values = self._all
        made = [PositionMinimum(x, covariance, float(energy), float(weight)) for x, covariance, energy, weight in zip(*values)]
        ends = np.cumsum(counts)
        tags = [made[end - count : end] for end, count in zip(ends, counts)]
        return tags if self._is_batch else tags[0]


def locate(
    beacons: npt.ArrayLike,
    ranges: npt.ArrayLike,
    sigma: npt.ArrayLike,
    *,
    cutoff: float | None = None,
    within: float = 5.0,
    max_cells: int = 1_000_000,
    threads: int = 1,
) -> PositionFix:
    """The most probable position of a tag from its ranges to M known beacons, proven to be the global minimum.

    It minimises 1/2 sum ((|x - beacon| - range) / sigma)^2 in the plane or in space by closed forms and branch and bound, and lists
    all other minima up to `within` above the least energy, at most 32: see docs/locate.md. All minima hold to 1e-6 in energy.

    beacons: (M, dim), dim 2 or 3 [m]. ranges: (M,), >= 0 [m]; NaN, or masked, where a beacon was not heard. sigma: their standard
    deviation, a number or (M,), > 0 [m]. For a batch ranges are (tags, M), sigma may be (tags, M) and beacons (tags, M, dim), and all
    results have the leading axis. cutoff: from this residual on [sigma], > 0, a range counts as an outlier, which costs cutoff^2 / 2
    wherever the tag is; None: least squares, where no range is an outlier. max_cells: where the search needs more, the result is not
    proven. threads: of a batch; 0 for as many as the machine runs at once.

    ValueError, which names the tag of a batch, for bad input, and where ranges cannot tell a position: fewer than dim of them,
    beacons in one place, or on one line in space, or, with a cutoff, no place that agrees with dim ranges.
    """
    given = inputs.numbers(ranges, "ranges", missing=np.nan)
    is_batch = given.ndim == 2
    if given.ndim not in (1, 2):
        raise ValueError(f"ranges: expected shape (M,) or (tags, M), found {given.shape}")
    places = inputs.numbers(beacons, "beacons")
    if places.ndim not in (2, 3) or places.shape[-1] not in (2, 3) or (places.ndim == 3 and not is_batch):
        raise ValueError(
            f"beacons: expected shape (M, 2) or (M, 3){', or with the leading axis of the tags' if is_batch else ''}, found {places.shape}"
        )
    all_ranges = given.reshape(1, -1) if not is_batch else given
    tags, count = all_ranges.shape
    dim = places.shape[-1]
    if places.shape not in ((count, dim), (tags, count, dim)):
        raise ValueError(f"beacons: expected shape {(count, dim)} for ranges of shape {given.shape}, found {places.shape}")
    deviations = inputs.numbers(sigma, "sigma")
    if deviations.shape not in ((), (count,), given.shape):
        raise ValueError(f"sigma: expected a number or shape {(count,)} for ranges of shape {given.shape}, found {deviations.shape}")
    of_each = np.ascontiguousarray(np.broadcast_to(deviations, (count,))) if deviations.ndim < 2 else deviations
    limit, depth, most = _limit(cutoff), inputs.number(within, "within"), inputs.count(max_cells, "max_cells")
    if depth < 0:
        raise ValueError(f"within: expected a finite number >= 0, found {depth}")
    try:
        texts, proven, listed, counts, *values = _asterism._locate(places, all_ranges, of_each, depth, limit, most, threads)
    except ValueError:
        _check_measured(given, deviations)
        raise
    firsts = np.cumsum(counts) - counts
    x, covariance, energy = (value[firsts] for value in values[:3])
    with np.errstate(invalid="ignore"):
        outliers = np.abs(np.linalg.norm(x[:, None] - places, axis=-1) - all_ranges) >= limit * of_each
    if cutoff is None and (energy > _NO_NOISE**2 * dim / 2).any():
        heard = np.maximum((~np.isnan(all_ranges)).sum(1), 1)
        texts = [joined(text, doubt(np.sqrt(2 * e / n), _OF_RANGES)) for text, e, n in zip(texts, energy, heard)]
    everything = (counts, *values)
    if is_batch:
        return PositionFix(x, covariance, energy, proven, listed, outliers, texts, everything, True)
    return PositionFix(x[0], covariance[0], float(energy[0]), bool(proven[0]), float(listed[0]), outliers[0], texts[0], everything, False)


def _check_measured(ranges: _Floats, sigma: _Floats) -> None:
    """ValueError with the value. The solver refuses the same, but knows the number of the range only."""
    is_heard = ~np.isnan(ranges)
    with np.errstate(invalid="ignore"):
        inputs.check_each(ranges, "ranges", ~is_heard | (ranges >= 0) & np.isfinite(ranges), "finite numbers >= 0, or NaN where nothing was heard")
        is_used = is_heard.any(tuple(range(ranges.ndim - sigma.ndim)))
        inputs.check_each(sigma, "sigma", ~is_used | (sigma > 0) & np.isfinite(sigma), "finite numbers > 0")


#: Residuals of more than so many sigma, in the root mean square, come from no noise of that size.
_NO_NOISE = 10.0
_OF_RANGES = "are beacons, ranges and sigma in one unit? A cutoff leaves out wrong ranges"


def doubt(size: float, question: str) -> str:
    """What residuals of that root mean square [sigma] say; "" where it is noise, or nothing was measured."""
    return f"the residuals are {size:.3g} sigma (root mean square): {question}" if size > _NO_NOISE else ""


def joined(*texts: str) -> str:
    return "; ".join(filter(None, texts))


def _limit(cutoff: float | None) -> float:
    if cutoff is None:
        return np.inf
    found = float(inputs.numbers(cutoff, "cutoff", ()))
    if not found > 0:
        raise ValueError(f"cutoff: expected a number > 0, found {found}")
    return found


@dataclasses.dataclass(frozen=True, eq=False)
class PathEstimate:
    """The path that locate_path finds: a local minimum of its energy."""

    #: (poses, 2) [m].
    x: _Floats
    #: (poses,) in (-pi, pi] [rad].
    heading: _Floats
    #: (poses, 2, 2), by Laplace's approximation [m^2].
    covariance: _Floats
    #: (M, 2): the known ones as they were given [m].
    beacons: _Floats
    #: (M, 2, 2): zero for known ones [m^2].
    beacon_covariance: _Floats
    #: (R,) distance - range, in units of sigma; NaN where nothing was heard.
    residuals: _Floats
    #: (R,): which residuals are as large as the cutoff or larger.
    outliers: npt.NDArray[np.bool_]
    #: At the minimum.
    energy: float
    #: No path with this scale has a lower energy; with a cutoff, of the energy in which every range keeps the weight that it has at the minimum.
    lower_bound: float
    #: The logarithm of the evidence for turn_sigma, by Laplace's approximation, up to a constant.
    evidence: float
    #: As it was given or estimated.
    turn_sigma: float
    #: The odometry's steps times this are the robot's. It stays at 1 if it differs from it by less than 1.5 deviations.
    scale: float
    #: By Laplace's approximation; 0 where the scale stays at 1.
    scale_deviation: float
    #: Whether the descent has ended at a stationary point.
    converged: bool
    #: What the beacons do not determine, or that no path fits the ranges; "" if there is nothing to say.
    message: str

    __repr__ = inputs.brief


def locate_path(
    steps: npt.ArrayLike,
    beacons: npt.ArrayLike,
    pose: npt.ArrayLike,
    beacon: npt.ArrayLike,
    ranges: npt.ArrayLike,
    sigma: npt.ArrayLike,
    *,
    times: npt.ArrayLike | None = None,
    cutoff: float | None = None,
    turn_sigma: float | None = None,
    step_sigma: float = 0.1,
    scale_sigma: float = 0.1,
    shortest: float | None = None,
    start: npt.ArrayLike | None = None,
    start_sigma: npt.ArrayLike | None = None,
    lower_bound: bool = True,
    max_iterations: int = 200,
) -> PathEstimate:
    """The path of a robot in the plane from its odometry and from ranges to beacons, known or unknown: see docs/locate.md.

    Positions are a chain in which each step is the step before, turned by the odometry; headings are not among the unknowns. It takes time
    linear in the number of poses.

    steps: (poses - 1, 3): how far the robot moves from each pose to the next, in the frame of the former (x forward, y to the left) [m], and
    by how much it turns [rad].
    beacons: (M, 2) [m]; NaN where the place is unknown.
    pose: (R,) at which pose each range was measured; 3.25 is a quarter of the way from pose 3 to pose 4. With times, the time of each range.
    beacon: (R,) to which beacon.
    ranges: (R,), >= 0 [m]; NaN, or masked, where nothing was heard.
    sigma: their standard deviation, a number or (R,), > 0 [m].
    times: (poses,) of the poses, which rise.
    cutoff: the energy of a range never exceeds cutoff^2 / 2 (Geman and McClure's loss); None: least squares.
    turn_sigma: the standard deviation of a step's difference from the turned step before, relative to its length; None: estimated from the
    evidence, with a weak prior.
    step_sigma: that of a step's length, relative to it.
    scale_sigma: that of the odometry's scale about 1: of how many metres the robot goes for each that the odometry counts; 0: the scale is 1.
    shortest: steps are joined until they are so long [m]; None: half of the median step.
    start: x, y [m] and heading [rad] of the first pose: where the search starts, and the frame of the result where beacons do not determine it.
    start_sigma: standard deviations of the first position [m] and heading [rad]; None: the start has no energy.
    lower_bound: whether to compute it, which takes most of the time.
    max_iterations: of each descent.

    ValueError for bad input, which is named: shapes, numbers that are not finite, negative ranges, times that do not rise, a range at no pose
    or to no beacon, a robot that does not move, unknown beacons with fewer than two ranges, and measurements that do not determine the path.
    """
    odometry = inputs.numbers(steps, "steps")
    if odometry.ndim != 2 or odometry.shape[1] != 3:
        raise ValueError(f"steps: expected shape (poses - 1, 3), found {odometry.shape}")
    places = inputs.numbers(beacons, "beacons", missing=np.nan)
    if places.ndim != 2 or places.shape[1] != 2:
        raise ValueError(f"beacons: expected shape (M, 2), found {places.shape}")
    if (half := np.flatnonzero(np.isnan(places).sum(1) == 1)).size:
        raise ValueError(f"beacons: row {half[0]} is {places[half[0]].tolist()}; expected finite numbers, or NaN in both where the place is unknown")
    lengths = inputs.numbers(ranges, "ranges", missing=np.nan)
    if lengths.ndim != 1:
        raise ValueError(f"ranges: expected shape (R,), found {lengths.shape}")
    at = inputs.numbers(pose, "pose", lengths.shape)
    to = inputs.numbers(beacon, "beacon", lengths.shape)
    index = to.astype(np.int32) if np.all(np.abs(to) < 2**31) else None
    if index is None or np.any(index != to):
        raise ValueError("beacon: expected whole numbers")
    inputs.check_each(index, "beacon", (index >= 0) & (index < len(places)), f"the number of a beacon, 0 to {len(places) - 1}")
    deviations = inputs.numbers(sigma, "sigma")
    if deviations.shape not in ((), lengths.shape):
        raise ValueError(f"sigma: expected a number or shape {lengths.shape}, found {deviations.shape}")
    _check_measured(lengths, deviations)
    deviations = np.ascontiguousarray(np.broadcast_to(deviations, lengths.shape))
    if times is not None:
        clock = inputs.numbers(times, "times", (len(odometry) + 1,))
        inputs.check_each(clock, "times", np.isfinite(clock), "finite numbers")
        if (falls := np.flatnonzero(~(np.diff(clock) > 0))).size:
            raise ValueError(f"times: expected rising numbers, found {clock[falls[0]]} before {clock[falls[0] + 1]} at pose {falls[0] + 1}")
        inputs.check_each(at, "pose", (at >= clock[0]) & (at <= clock[-1]), f"the time of each range, {clock[0]} to {clock[-1]} as the times are")
        at = np.interp(at, clock, np.arange(len(clock), dtype=float))
    else:
        inputs.check_each(at, "pose", (at >= 0) & (at <= len(odometry)), f"the number of a pose, 0 to {len(odometry)}")
    first_pose = inputs.numbers([np.nan] * 3 if start is None else start, "start", (3,))
    if start is not None and not np.all(np.isfinite(first_pose)):
        raise ValueError("start: expected finite numbers")
    spread = inputs.numbers([np.inf] * 2 if start_sigma is None else start_sigma, "start_sigma", (2,))
    turn, least = (0.0 if value is None else inputs.positive(value, name) for name, value in (("turn_sigma", turn_sigma), ("shortest", shortest)))
    limit = _limit(cutoff)
    step_sigma = inputs.positive(step_sigma, "step_sigma")
    if (scale := inputs.number(scale_sigma, "scale_sigma")) < 0:
        raise ValueError(f"scale_sigma: expected a finite number >= 0, found {scale}")
    max_iterations = inputs.count(max_iterations, "max_iterations")
    found = _asterism._locate_path(
        odometry, places, at, index, lengths, deviations, limit, turn, step_sigma, scale, least, list(first_pose),
        list(spread), lower_bound, max_iterations,
    )
    residuals = found["residuals"]
    with np.errstate(invalid="ignore"):
        outliers = np.abs(residuals) >= limit
    turns = np.abs(odometry[:, 2])
    if (turns > 2 * np.pi).any():
        found["message"] = joined(found["message"], f"step {turns.argmax()} turns by {odometry[turns.argmax(), 2]:.3g}: are turns in radians?")
    heard = residuals[~np.isnan(residuals)]
    if cutoff is None and heard.size:
        question = "are steps, beacons, ranges and sigma in one unit? A cutoff leaves out wrong ranges"
        found["message"] = joined(found["message"], doubt(float(np.sqrt(np.mean(heard**2))), question))
    return PathEstimate(outliers=outliers, **found)
