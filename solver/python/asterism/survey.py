"""Where devices are, from the ranges between them."""

from __future__ import annotations

import dataclasses
from typing import Callable

import numpy as np
import numpy.typing as npt

from . import embedding, inputs
from .ranges import doubt, joined, locate

_Floats = npt.NDArray[np.float64]


@dataclasses.dataclass(frozen=True, eq=False)
class Survey:
    """The result of survey, for N devices: their places up to a rigid motion and a mirror image."""

    #: (N, dim) [m], centred on the origin.
    x: _Floats
    #: (N, dim, dim) [m^2]: Laplace's approximation where the mean and the rotation of all places are held (a free network).
    covariance: _Floats
    #: (N,) [m]: what each device adds to its ranges; 0 without the argument `bias`.
    bias: _Floats
    #: (N,) [m]: its standard deviation, by Laplace's approximation.
    bias_sigma: _Floats
    #: 1/2 sum ((|x_i - x_j| + bias_i + bias_j - range) / sigma)^2 over the measured pairs, plus 1/2 sum (bias_i / bias)^2; cutoff^2 / 2 for each outlier.
    energy: float
    #: No places have less energy than this; 0 if nothing is proven, as where biases are estimated or there is a cutoff.
    lower_bound: float
    #: Whether it is proven that no places have less energy.
    proven: bool
    #: (N, N): what the places and biases leave of each range [sigma]; NaN where none was measured.
    residuals: _Floats
    #: (N, N): which residuals are as large as the cutoff or larger; none without one.
    outliers: npt.NDArray[np.bool_]
    #: What else the ranges cannot tell, or that no places fit them; "" if nothing.
    message: str

    __repr__ = inputs.brief


def survey(ranges: npt.ArrayLike, sigma: npt.ArrayLike = 1.0, *, bias: float = 0.0, dim: int = 2, cutoff: float | None = None) -> Survey:
    """Places of N devices from the ranges that they measure to each other, such as those of radio beacons (UWB) before any is known.

    It minimises 1/2 sum ((|x_i - x_j| + c_i + c_j - range_ij) / sigma_ij)^2 + 1/2 sum (c_i / bias)^2. Places come from mds; with
    biases, Newton's method then finds both together. Without biases, a certificate may prove the result: see docs/locate.md.
    With a cutoff, no term exceeds cutoff^2 / 2, and outliers are found by graduated non-convexity and by locating one device after the other.

    ranges: (N, N), >= 0 [m]; NaN, or masked, where none was measured; the diagonal is not read. [i, j] and [j, i] are two
    measurements of one distance, unless the matrix is symmetric. sigma: their standard deviation, a number or (N, N), > 0 [m]. bias: the standard
    deviation of what each device adds to its ranges [m], such as a delay that was not calibrated; 0 if they add nothing. A delay that
    all devices have is to be subtracted before. dim: 2 or 3. cutoff: from this residual on [sigma], > 0, a range counts as an outlier, such
    as one that a reflection made too long, and costs cutoff^2 / 2. Nothing is proven then.

    ValueError for bad input, and where a device, or a part of them, can move without changing a range, or, with a cutoff, one that is no outlier.
    """
    given = inputs.numbers(ranges, "ranges", missing=np.nan)
    count = len(given) if given.ndim == 2 else 0
    if given.shape != (count, count):
        raise ValueError(f"ranges: expected shape (N, N), found {given.shape}")
    dim, bias = inputs.choice(dim, "dim", (2, 3)), inputs.number(bias, "bias")
    if bias < 0:
        raise ValueError(f"bias: expected a finite number >= 0, found {bias}")
    limit = np.inf if cutoff is None else inputs.number(cutoff, "cutoff")
    if not limit > 0:
        raise ValueError(f"cutoff: expected a number > 0, found {cutoff}")
    if cutoff is not None and not 1e-100 < limit < 1e100:
        raise ValueError("cutoff: its square is out of range")
    if count <= dim:
        raise ValueError(f"ranges: expected those of {dim + 1} devices or more in {dim} dimensions, found {count}")
    deviation = inputs.numbers(sigma, "sigma")
    if deviation.shape not in ((), given.shape):
        raise ValueError(f"sigma: expected a number or shape {given.shape}, found {deviation.shape}")
    is_measured = ~np.isnan(given) & ~np.eye(count, dtype=bool)
    spread = np.broadcast_to(deviation, given.shape)[is_measured]
    with np.errstate(invalid="ignore"):
        inputs.check_each(given, "ranges", ~is_measured | ((given >= 0) & np.isfinite(given)), "finite numbers >= 0, or NaN where none was measured")
        is_needed = is_measured if deviation.ndim else is_measured.any()
        inputs.check_each(deviation, "sigma", ~is_needed | ((deviation > 0) & np.isfinite(deviation)), "finite numbers > 0")
    measured = np.zeros_like(given)
    measured[is_measured] = _weights(spread, "sigma")
    both = is_measured & is_measured.T
    if (given == given.T)[both].all():  # the lower triangle is a copy, not a second measurement
        measured[both] /= 2
    given = np.where(is_measured, given, 0)

    def network_of(trust: _Floats) -> _Network:
        return _Network(*_pairs(given, measured * trust), bias)

    def residuals_of(x: _Floats, added: _Floats) -> _Floats:
        apart = np.linalg.norm(x[:, None] - x[None], axis=-1)
        return np.where(is_measured, (apart + added[:, None] + added[None] - given) / deviation, 0.0)

    range_of, weight = _pairs(given, measured)
    is_pair, is_proof = weight > 0, bias == 0 and limit == np.inf
    # Where all pairs are measured, classical scaling, the first start, is near the best places.
    options = {"starts": 4} if is_pair.sum() == count * (count - 1) else {}
    i, j = pairs = np.nonzero(np.triu(is_pair))
    known = embedding.Known(list(range(count)), np.zeros((count, dim)), np.zeros(count))  # no anchors
    placed = embedding.embed(known, np.column_stack(pairs), range_of[i, j], weight[i, j], "multi-start", options, prove=is_proof)
    x, trust = placed.x, np.ones_like(given)
    if limit < np.inf:
        x, added = _graduated(x, network_of, residuals_of, limit)
        for _ in range(_SWEEPS):
            if not _located(x, added, given, np.where(is_measured, deviation, np.inf), limit):
                break
            trust = np.where(np.abs(residuals_of(x, added)) < limit, 1.0, _DOUBTED)
            x, added, _ = network_of(trust).descend(x, added)
        trust = np.where(np.abs(residuals_of(x, added)) < limit, 1.0, 0.0)
    for _ in range(_SWEEPS):
        few = np.flatnonzero((_pairs(given, measured * trust)[1] > 0).sum(1) < dim)
        if limit < np.inf and few.size:
            raise ValueError(f"cutoff: no places were found that agree with ranges of device {few[0]} to {dim} others")
        network = network_of(trust)
        if limit < np.inf:
            x = network.descend(x, added)[0]
        x, added, inverse = network.solve(x)
        residuals = residuals_of(x, added)
        is_outlier = np.abs(residuals) >= limit
        if (is_outlier == (trust == 0)).all():
            break
        trust = np.where(is_outlier, 0.0, 1.0)
    covariance, bias_sigma, message = network.uncertainty(x, inverse)
    if cutoff is None:
        size = float(np.sqrt(np.mean(residuals[is_measured] ** 2)))
        message = joined(message, doubt(size, "are ranges and sigma in one unit? A cutoff leaves out wrong ranges, and a bias explains constant errors"))
    energy = network.energy(x, added) + (measured * np.square(deviation))[trust == 0].sum() * min(limit, 1e150) ** 2 / 2
    residuals[~is_measured] = np.nan
    lower_bound = placed.lower_bound / 2 if is_proof else 0.0
    return Survey(x - x.mean(0), covariance, added, bias_sigma, energy, lower_bound, is_proof and placed.certified, residuals, is_outlier, message)


def _pairs(given: _Floats, measured: _Floats) -> tuple[_Floats, _Floats]:
    """Of the measurements of a pair [i, j] and [j, i]: the mean, and the weights together."""
    weight = measured + measured.T
    weighted = measured * given
    return np.divide(weighted + weighted.T, weight, where=weight > 0, out=np.zeros_like(given)), weight


#: With a cutoff: at most so many times, devices are located again, one after the other.
_SWEEPS = 10
#: The weight of an outlier while they are sought: no device loses all its ranges.
_DOUBTED = 1e-6


def _graduated(
    x: _Floats, network_of: Callable[[_Floats], _Network], residuals_of: Callable[[_Floats, _Floats], _Floats], limit: float
) -> tuple[_Floats, _Floats]:
    """Places and biases: graduated non-convexity with truncated least squares (Yang et al. 2020), from the places x."""
    x, added, _ = network_of(np.ones((len(x), len(x)))).descend(x, np.zeros(len(x)))
    square = residuals_of(x, added) ** 2
    control = limit**2 / max(2 * float(square.max()) - limit**2, 1e-300)
    while 0 < control < 1e3:
        between = limit * np.sqrt(control * (control + 1) / np.maximum(square, 1e-300)) - control
        x, added, _ = network_of(np.clip(between, _DOUBTED, 1)).descend(x, added)
        square = residuals_of(x, added) ** 2
        control *= 1.4
    return x, added


def _located(x: _Floats, added: _Floats, given: _Floats, deviation: _Floats, limit: float) -> bool:
    """Each device goes to where its ranges to the others have the least energy of all places, in x; whether one has moved."""
    is_moved = False
    for i in range(len(x)):
        sigma = np.concatenate([deviation[i], deviation[:, i]])
        is_heard = np.isfinite(sigma)
        beacons = np.concatenate([x, x])[is_heard]
        ranges = (np.concatenate([given[i] - added, given[:, i] - added]) - added[i])[is_heard]

        def energy(at: _Floats) -> float:
            error = (np.linalg.norm(beacons - at, axis=1) - ranges) / sigma[is_heard]
            return float(np.minimum(error**2, limit**2).sum()) / 2

        try:
            found = locate(beacons, np.maximum(ranges, 0), sigma[is_heard], cutoff=limit, within=0, max_cells=20_000)
        except ValueError:  # no place agrees with enough ranges
            continue
        if energy(found.x) < energy(x[i]) - 1e-6 * (1 + energy(x[i])):
            x[i], is_moved = found.x, True
    return is_moved


def _weights(deviations: _Floats, name: str) -> _Floats:
    with np.errstate(over="ignore", under="ignore"):
        weights = deviations**-2.0
    if not ((weights > 0) & np.isfinite(weights)).all():
        raise ValueError(f"{name}: its square is out of range: another unit is needed")
    return weights


class _Network:
    """The energy of places x (N, dim) and biases c (N,), and its minimum."""

    def __init__(self, range_of: _Floats, weight: _Floats, bias: float):
        self._range, self._weight = range_of, weight
        self._has_bias = bias > 0
        self._prior = float(_weights(np.array(bias), "bias")) if bias > 0 else 0.0
        # The unit of the biases in steps and derivatives [m]: a narrow prior alone is no ill condition.
        self._unit = float(np.sqrt(1 / (1 + self._prior * len(weight) / weight.sum()))) if bias > 0 else 1.0

    def energy(self, x: _Floats, c: _Floats) -> float:
        stretch = np.linalg.norm(x[:, None] - x[None], axis=-1) + c[:, None] + c[None] - self._range
        return float((self._weight * stretch**2).sum() / 4 + self._prior * (c**2).sum() / 2)

    def derivatives(self, x: _Floats, c: _Floats, clamp: bool) -> tuple[_Floats, _Floats]:
        """Gradient and Hessian, by the coordinates of all places and then, if there are any, the biases in their unit; clamp: without negative
        curvature.
        """
        count, dim = x.shape
        offset = x.T[:, :, None] - x.T[:, None]
        apart = np.sqrt((offset**2).sum(0))
        direction = offset / np.maximum(apart, 1e-300)
        tension = self._weight * (apart + c[:, None] + c[None] - self._range)
        across = np.divide(tension, apart, where=apart > 0, out=np.zeros_like(apart))
        across = np.maximum(across, 0) if clamp else across
        along = self._weight - across
        places = count * dim
        size = places + count * self._has_bias
        gradient, hessian, diagonal = np.zeros(size), np.zeros((size, size)), np.arange(count)
        for a in range(dim):
            of_a = slice(a, places, dim)
            gradient[of_a] = (tension * direction[a]).sum(1)
            for b in range(a + 1):
                ends = along * direction[a] * direction[b] + (across if a == b else 0)
                hessian[of_a, b:places:dim] = hessian[b:places:dim, of_a] = np.diag(ends.sum(1)) - ends
            if self._has_bias:
                mixed = self._weight * direction[a]  # by x_i and c_j
                mixed[diagonal, diagonal] = mixed.sum(1)
                hessian[of_a, places:], hessian[places:, of_a] = mixed, mixed.T
        if self._has_bias:
            gradient[places:] = (tension.sum(1) + self._prior * c) * self._unit
            hessian[places:, places:] = (self._weight + np.diag(self._weight.sum(1) + self._prior)) * self._unit
            hessian[places:] *= self._unit
            hessian[:places, places:] *= self._unit
        return gradient, hessian

    def solve(self, x: _Floats) -> tuple[_Floats, _Floats, _Floats]:
        """A minimum: Newton's method, and from a saddle down along its negative curvature; and the inverse of the Hessian across
        the rigid motions. ValueError if places can move."""
        c = np.zeros(len(x))
        for _ in range(10):
            if self._has_bias:  # otherwise mds has found it
                x, c, energy = self.descend(x, c)
            hessian = self.derivatives(x, c, False)[1]
            inverse = _inverse(hessian, x)
            if inverse is not None:
                return x, c, inverse
            size, axes = np.linalg.eigh(hessian)
            if not self._has_bias or size[0] >= -1e-9 * size[-1]:
                break
            reach = np.abs(x - x.mean(0)).max()
            for share in 0.5 ** np.arange(2, 20):
                step = share * reach * axes[:, 0]
                there, biases = x + step[: x.size].reshape(x.shape), c + self._unit * step[x.size :]
                if self.energy(there, biases) < energy:
                    x, c = there, biases
                    break
        motions = x.shape[1] * (x.shape[1] + 1) // 2
        least = 1e-9 * size[-1]
        if size[motions] <= least:
            free = axes[: x.size, size <= least]
            rigid = _rigid_motions(x)
            bends = (free - rigid @ (rigid.T @ free)).reshape(len(x), -1)
            moved = int(np.argmax(np.linalg.norm(bends, axis=1)))
            raise ValueError(f"ranges: they do not determine the places: device {moved} can move without changing a range")
        return x, c, (axes[:, motions:] / size[motions:]) @ axes[:, motions:].T

    def descend(self, x: _Floats, c: _Floats) -> tuple[_Floats, _Floats, float]:
        """To a stationary point, damped where the energy would rise, which also holds the rigid motions."""
        count, dim = x.shape
        energy, damping, clamp = self.energy(x, c), 1e-9, True
        size = float(self._weight.sum()) / count
        for _ in range(200):
            gradient, hessian = self.derivatives(x, c, clamp)
            step = np.linalg.solve(hessian + damping * size * np.eye(len(gradient)), -gradient)
            change = self._unit * step[count * dim :] if self._has_bias else 0.0
            decrease = -gradient @ step
            if clamp and decrease <= 1e-18 * (1 + energy):
                break
            is_last = not clamp and 0 <= decrease <= 1e-10 * (1 + energy)  # the next one is its square
            for share in (1.0,) if clamp or is_last else (1.0, 0.5, 0.25, 0.125):
                there, biases = x + share * step[: count * dim].reshape(x.shape), c + share * change
                next_energy = self.energy(there, biases)
                if next_energy <= energy:
                    break
            if is_last:  # where the energy may rise by rounding
                return there, biases, next_energy
            if decrease > 0 and next_energy <= energy:
                x, c, energy, damping = there, biases, next_energy, max(damping / 10, 1e-12)
                clamp = decrease > 0.01 * (1 + energy)  # near a minimum the true Hessian leads to it
            elif not clamp:
                clamp = True
            elif damping > 1e6:
                break
            else:
                damping = max(damping, 1e-9) * 10
        return x, c, energy

    def uncertainty(self, x: _Floats, inverse: _Floats) -> tuple[_Floats, _Floats, str]:
        """Covariances of the places, standard deviations of the biases, and what the ranges cannot tell."""
        count, dim = x.shape
        blocks = inverse[: count * dim, : count * dim].reshape(count, dim, count, dim)
        diagonal = np.arange(count)
        spread = self._unit * np.sqrt(np.diag(inverse)[count * dim :]) if self._has_bias else np.zeros(count)
        partners = (self._weight > 0).sum(1)
        few = [str(i) for i in np.flatnonzero(partners == dim)]
        message = ""
        if few:
            subject = f"device {few[0]} has" if len(few) == 1 else f"devices {', '.join(few)} have"
            message = f"{subject} ranges to {dim} others alone: a mirror image about these fits as well"
        return blocks[diagonal, :, diagonal, :], spread, message


def _inverse(hessian: _Floats, x: _Floats) -> _Floats | None:
    """The inverse across the rigid motions of x; None unless the Hessian is positive definite there, and far from singular."""
    motions = np.zeros((len(hessian), x.shape[1] * (x.shape[1] + 1) // 2))
    rigid = _rigid_motions(x)
    motions[: x.size, : rigid.shape[1]] = rigid
    scale = np.trace(hessian) / len(hessian)
    if not scale > 0:
        return None
    held = hessian / scale + motions @ motions.T
    try:
        np.linalg.cholesky(held)
    except np.linalg.LinAlgError:
        return None
    inverse = np.linalg.inv(held)
    if not np.linalg.norm(held) * np.linalg.norm(inverse) < 1e8:
        return None
    return (inverse - motions @ motions.T) / scale


def _rigid_motions(x: _Floats) -> _Floats:
    """An orthonormal basis of the velocities (N dim, ...) of x as one rigid body."""
    count, dim = x.shape
    motions = [np.tile(axis, (count, 1)) for axis in np.eye(dim)]
    for a in range(dim):
        for b in range(a):
            turn = np.zeros((count, dim))
            turn[:, a], turn[:, b] = -x[:, b], x[:, a]
            motions.append(turn)
    basis, size, _ = np.linalg.svd(np.stack([motion.ravel() for motion in motions], axis=1), full_matrices=False)
    return basis[:, size > 1e-9 * size[0]]
