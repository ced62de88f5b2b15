"""Where devices are, from the ranges between them."""

from __future__ import annotations

import dataclasses

import numpy as np
import numpy.typing as npt

from . import embedding, inputs

_Floats = npt.NDArray[np.float64]
_Modes = tuple[_Floats, _Floats]


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
    #: 1/2 sum ((|x_i - x_j| + bias_i + bias_j - range) / sigma)^2 over the measured pairs, plus 1/2 sum (bias_i / bias)^2.
    energy: float
    #: No places have less energy than this; 0 if nothing is proven, as where biases are estimated.
    lower_bound: float
    #: Whether it is proven that no places have less energy.
    proven: bool
    #: (N, N): what the places and biases leave of each range [sigma]; NaN where none was measured.
    residuals: _Floats
    #: What else the ranges cannot tell; "" if nothing.
    message: str

    __repr__ = inputs.brief


def survey(ranges: npt.ArrayLike, sigma: npt.ArrayLike = 1.0, *, bias: float = 0.0, dim: int = 2) -> Survey:
    """Places of N devices from the ranges that they measure to each other, such as those of radio beacons (UWB) before any is known.

    It minimises 1/2 sum ((|x_i - x_j| + c_i + c_j - range_ij) / sigma_ij)^2 + 1/2 sum (c_i / bias)^2. Places come from mds; with
    biases, Newton's method then finds both together. Without biases, a certificate may prove the result: see docs/locate.md.

    ranges: (N, N), >= 0 [m]; NaN, or masked, where none was measured; the diagonal is not read. [i, j] and [j, i] are two
    measurements of one distance if they differ. sigma: their standard deviation, a number or (N, N), > 0 [m]. bias: the standard
    deviation of what each device adds to its ranges [m], such as a delay that was not calibrated; 0 if they add nothing. A delay that
    all devices have is to be subtracted before. dim: 2 or 3.

    ValueError for bad input, and where a device, or a part of them, can move without changing a range.
    """
    given = inputs.numbers(ranges, "ranges", missing=np.nan)
    count = len(given)
    if given.shape != (count, count):
        raise ValueError(f"ranges: expected shape (N, N), found {given.shape}")
    if dim not in (2, 3):
        raise ValueError(f"dim: expected 2 or 3, found {dim}")
    if not (bias >= 0 and np.isfinite(bias)):
        raise ValueError(f"bias: expected a finite number >= 0, found {bias}")
    if count <= dim:
        raise ValueError(f"ranges: expected those of {dim + 1} devices or more in {dim} dimensions, found {count}")
    deviation = inputs.numbers(sigma, "sigma")
    if deviation.shape not in ((), given.shape):
        raise ValueError(f"sigma: expected a number or shape {given.shape}, found {deviation.shape}")
    is_measured = ~np.isnan(given) & ~np.eye(count, dtype=bool)
    heard, spread = given[is_measured], np.broadcast_to(deviation, given.shape)[is_measured]
    if not ((heard >= 0) & np.isfinite(heard)).all():
        raise ValueError("ranges: expected finite numbers >= 0, or NaN")
    if not ((spread > 0) & np.isfinite(spread)).all():
        raise ValueError("sigma: expected finite numbers > 0")
    measured = np.zeros_like(given)
    measured[is_measured] = spread**-2.0
    weight = measured + measured.T
    is_pair = weight > 0
    weighted = measured * np.where(is_measured, given, 0)
    range_of = np.divide(weighted + weighted.T, weight, where=is_pair, out=np.zeros_like(given))
    # Where all pairs are measured, classical scaling, the first start, is near the best places.
    options = {"starts": 4} if is_pair.sum() == count * (count - 1) else {}
    placed = embedding.mds(np.where(is_pair, range_of, np.nan), np.where(is_pair, weight, 0), dim=dim, **options)
    if not placed:
        raise ValueError(f"ranges: {placed.summary.message}")
    network = _Network(range_of, weight, bias)
    x, added, modes = network.solve(placed.x)
    covariance, bias_sigma, message = network.uncertainty(x, modes)
    energy = network.energy(x, added)
    x = x - x.mean(0)
    apart = np.linalg.norm(x[:, None] - x[None], axis=-1)
    residuals = (apart + added[:, None] + added[None] - given) / deviation
    residuals[~is_measured] = np.nan
    lower_bound = placed.lower_bound / 2 if bias == 0 else 0.0
    return Survey(x, covariance, added, bias_sigma, energy, lower_bound, bias == 0 and placed.certified, residuals, message)


class _Network:
    """The energy of places x (N, dim) and biases c (N,), and its minimum."""

    def __init__(self, range_of: _Floats, weight: _Floats, bias: float):
        self._range, self._weight = range_of, weight
        self._has_bias = bias > 0
        self._prior = bias**-2.0 if bias > 0 else 0.0

    def energy(self, x: _Floats, c: _Floats) -> float:
        stretch = np.linalg.norm(x[:, None] - x[None], axis=-1) + c[:, None] + c[None] - self._range
        return float((self._weight * stretch**2).sum() / 4 + self._prior * (c**2).sum() / 2)

    def derivatives(self, x: _Floats, c: _Floats, clamp: bool) -> tuple[_Floats, _Floats]:
        """Gradient and Hessian, by the coordinates of all places and then, if there are any, the biases; clamp: without negative curvature."""
        count, dim = x.shape
        offset = x[:, None] - x[None]
        apart = np.linalg.norm(offset, axis=-1)
        direction = offset / np.maximum(apart, 1e-300)[..., None]
        stretch = apart + c[:, None] + c[None] - self._range
        tension = self._weight * stretch
        across = np.divide(tension, apart, where=apart > 0, out=np.zeros_like(apart))
        across = np.maximum(across, 0) if clamp else across
        block = (self._weight - across)[..., None, None] * direction[..., :, None] * direction[..., None, :]
        block += across[..., None, None] * np.eye(dim)
        diagonal = np.arange(count)
        ends = -block
        ends[diagonal, diagonal] = block.sum(1)
        hessian = ends.transpose(0, 2, 1, 3).reshape(count * dim, count * dim)
        gradient = (tension[..., None] * direction).sum(1).ravel()
        if not self._has_bias:
            return gradient, hessian
        mixed = self._weight[..., None] * direction  # by x_i and c_j
        mixed[diagonal, diagonal] = mixed.sum(1)
        mixed = mixed.transpose(0, 2, 1).reshape(count * dim, count)
        of_bias = self._weight + np.diag(self._weight.sum(1) + self._prior)
        return np.concatenate([gradient, tension.sum(1) + self._prior * c]), np.block([[hessian, mixed], [mixed.T, of_bias]])

    def solve(self, x: _Floats) -> tuple[_Floats, _Floats, _Modes]:
        """A minimum: Newton's method, and from a saddle down along its negative curvature."""
        c = np.zeros(len(x))
        if not self._has_bias:  # mds has found it
            return x, c, self._modes(x, c)
        for _ in range(10):
            x, c, energy = self._descend(x, c)
            size, axes = self._modes(x, c)
            if size[0] >= -1e-9 * size[-1]:
                return x, c, (size, axes)
            reach = np.abs(x - x.mean(0)).max()
            for share in 0.5 ** np.arange(2, 20):
                step = share * reach * axes[:, 0]
                there, biases = x + step[: x.size].reshape(x.shape), c + step[x.size :]
                if self.energy(there, biases) < energy:
                    x, c = there, biases
                    break
        return x, c, self._modes(x, c)

    def _modes(self, x: _Floats, c: _Floats) -> _Modes:
        """Eigenvalues of the Hessian, the least first, and its eigenvectors."""
        return np.linalg.eigh(self.derivatives(x, c, False)[1])

    def _descend(self, x: _Floats, c: _Floats) -> tuple[_Floats, _Floats, float]:
        """To a stationary point, damped where the energy would rise, which also holds the rigid motions."""
        count, dim = x.shape
        energy, damping = self.energy(x, c), 1e-9
        size = float(self._weight.sum()) / count
        for _ in range(200):
            gradient, hessian = self.derivatives(x, c, True)
            step = np.linalg.solve(hessian + damping * size * np.eye(len(gradient)), -gradient)
            if -gradient @ step <= 1e-18 * (1 + energy):
                break
            there, biases = x + step[: count * dim].reshape(x.shape), c + step[count * dim :]
            next_energy = self.energy(there, biases)
            if next_energy <= energy:
                x, c, energy, damping = there, biases, next_energy, max(damping / 10, 1e-12)
            elif damping > 1e6:
                break
            else:
                damping = max(damping, 1e-9) * 10
        return x, c, energy

    def uncertainty(self, x: _Floats, modes: _Modes) -> tuple[_Floats, _Floats, str]:
        """Covariances of the places, standard deviations of the biases, and what the ranges cannot tell. ValueError if places can move."""
        count, dim = x.shape
        size, axes = modes
        motions = dim * (dim + 1) // 2
        least = 1e-9 * size[-1]
        if size[motions] <= least:
            free = axes[: count * dim, size <= least]
            rigid = _rigid_motions(x)
            bends = (free - rigid @ (rigid.T @ free)).reshape(count, -1)
            moved = int(np.argmax(np.linalg.norm(bends, axis=1)))
            raise ValueError(f"ranges: they do not determine the places: device {moved} can move without changing a range")
        inverse = (axes[:, motions:] / size[motions:]) @ axes[:, motions:].T
        blocks = inverse[: count * dim, : count * dim].reshape(count, dim, count, dim)
        diagonal = np.arange(count)
        spread = np.sqrt(np.diag(inverse)[count * dim :]) if self._has_bias else np.zeros(count)
        partners = (self._weight > 0).sum(1)
        few = [str(i) for i in np.flatnonzero(partners == dim)]
        message = ""
        if few:
            subject = f"device {few[0]} has" if len(few) == 1 else f"devices {', '.join(few)} have"
            message = f"{subject} ranges to {dim} others alone: a mirror image about these fits as well"
        return blocks[diagonal, :, diagonal, :], spread, message


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
