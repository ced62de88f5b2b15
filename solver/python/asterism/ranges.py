"""Positions from ranges to known beacons."""

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


@dataclasses.dataclass(frozen=True, eq=False)
class PositionFix:
    """What locate finds: of one tag, or of each tag of a batch along a leading axis (tags, ...)."""

    #: The most probable position: (dim,) [m].
    x: _Floats
    #: Its covariance: (dim, dim) [m^2].
    covariance: _Floats
    #: The energy there.
    energy: Any
    #: Whether it is proven that x is the global minimum and that `minima` is complete.
    proven: Any
    #: (M,): which ranges have a residual of the cutoff or more at x.
    outliers: npt.NDArray[np.bool_]
    #: What the geometry cannot tell, or why nothing is proven; "" if there is nothing to say. Of a batch a list.
    message: Any
    _all: tuple[npt.NDArray[np.int32], _Floats, _Floats, _Floats, _Floats] = dataclasses.field(repr=False)
    _is_batch: bool = dataclasses.field(repr=False)

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
    all other minima up to `within` above the least energy: see docs/locate.md. All minima hold to 1e-6 in energy.

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
    if deviations.ndim < 2:
        deviations = np.ascontiguousarray(np.broadcast_to(deviations, (count,)))
    limit = np.inf if cutoff is None else cutoff
    texts, proven, counts, *values = _asterism._locate(places, all_ranges, deviations, within, limit, max_cells, threads)
    firsts = np.cumsum(counts) - counts
    x, covariance, energy = (value[firsts] for value in values[:3])
    with np.errstate(invalid="ignore"):
        outliers = np.abs(np.linalg.norm(x[:, None] - places, axis=-1) - all_ranges) >= limit * deviations
    everything = (counts, *values)
    if is_batch:
        return PositionFix(x, covariance, energy, proven, outliers, texts, everything, True)
    return PositionFix(x[0], covariance[0], float(energy[0]), bool(proven[0]), outliers[0], texts[0], everything, False)
