#!/usr/bin/env python3
"""Optimisers that Python users have at hand, on the systems of a file, as `asterism-bench solve` prints them.

    peers.py FILE

reads JSON or JSON lines as in docs/system-json.md. Compare energies and iterations, not times: these are mostly
the interpreter's overhead and say little about the algorithms. Needs python3-numpy; python3-scipy and
python3-sklearn add their solvers if installed.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # one thread, as in asterism-bench, whose times are CPU times
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import json
import math
import statistics
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

try:
    import numpy as np
except ImportError:
    sys.exit("peers.py: needs numpy (Debian package python3-numpy)")
try:
    from scipy import optimize
except ImportError:
    optimize = None
try:
    from sklearn import manifold
except ImportError:
    manifold = None

Points = np.ndarray  # nodes x dim [px]


class BadInput(Exception):
    """What is wrong with a file, in one line."""


# ------------------------------------------------------------------------------------------- spring systems


@dataclass
class System:
    """E(x) = 1/2 sum_i k_i (x_i - a_i)' S_i (x_i - a_i) + 1/2 sum_ij k_ij (mu_ij - |x_i - x_j|)^2, as in
    docs/solver.md; S_i is the identity unless anchors are anisotropic."""

    name: str
    anchors: Points
    anchor_stiffness: np.ndarray
    anchor_shape: np.ndarray  # nodes x dim x dim
    links: np.ndarray  # links x 2
    rest_length: np.ndarray  # [px]
    link_stiffness: np.ndarray
    free: np.ndarray  # whether each node moves
    start: Points

    def springs(self, x: Points) -> tuple[np.ndarray, np.ndarray]:
        """Length and direction of each link; for coincident nodes the direction of their anchors, or else the
        first axis."""
        i, j = self.links.T
        difference = x[i] - x[j]
        length = np.linalg.norm(difference, axis=1)
        if (length == 0).any():
            difference = np.where(length[:, None] > 0, difference, self.anchors[i] - self.anchors[j])
            difference[~difference.any(axis=1), 0] = 1
        return length, difference / np.linalg.norm(difference, axis=1)[:, None]

    def energy(self, x: Points) -> float:
        length, _ = self.springs(x)
        d = x - self.anchors
        of_anchors = np.einsum("n,nd,nde,ne", self.anchor_stiffness, d, self.anchor_shape, d)
        return 0.5 * float(of_anchors + self.link_stiffness @ (self.rest_length - length) ** 2)

    def gradient(self, x: Points) -> Points:
        """Zero at fixed nodes."""
        length, direction = self.springs(x)
        pull = (self.link_stiffness * (length - self.rest_length))[:, None] * direction
        result = np.einsum("n,nde,ne->nd", self.anchor_stiffness, self.anchor_shape, x - self.anchors)
        np.add.at(result, self.links[:, 0], pull)
        np.add.at(result, self.links[:, 1], -pull)
        result[~self.free] = 0
        return result

    def residuals(self, x: Points) -> np.ndarray:
        """r with E = |r|^2 / 2: first the springs to the anchors, then the links."""
        length, _ = self.springs(x)
        of_anchors = np.einsum("nde,nd->ne", self.anchor_root(), x - self.anchors)
        return np.concatenate(
            [of_anchors.ravel(), np.sqrt(self.link_stiffness) * (length - self.rest_length)]
        )

    def jacobian(self, x: Points) -> np.ndarray:
        """dr / dx of the free nodes."""
        n, dim = x.shape
        _, direction = self.springs(x)
        rows = np.sqrt(self.link_stiffness)[:, None] * direction
        of_links = np.zeros((len(self.links), n, dim))
        of_links[np.arange(len(rows)), self.links[:, 0]] = rows
        of_links[np.arange(len(rows)), self.links[:, 1]] = -rows
        of_anchors = np.zeros((n, dim, n, dim))
        of_anchors[np.arange(n), :, np.arange(n), :] = self.anchor_root().transpose(0, 2, 1)
        both = np.concatenate([of_anchors.reshape(n * dim, n, dim), of_links])
        return both[:, self.free].reshape(len(both), -1)

    def hessian(self, x: Points) -> np.ndarray:
        """d2E / dx2 of the free nodes; of a link whose ends coincide the curvature along its direction alone."""
        n, dim = x.shape
        length, direction = self.springs(x)
        across = np.zeros(len(length))
        np.divide(length - self.rest_length, length, out=across, where=length > 0)
        axis = direction[:, :, None] * direction[:, None, :]
        blocks = axis + across[:, None, None] * (np.eye(dim) - axis)
        blocks *= self.link_stiffness[:, None, None]
        result = np.zeros((n, n, dim, dim))
        i, j = self.links.T
        for at, sign in (((i, i), 1), ((j, j), 1), ((i, j), -1), ((j, i), -1)):
            np.add.at(result, at, sign * blocks)
        result[np.arange(n), np.arange(n)] += self.anchor_stiffness[:, None, None] * self.anchor_shape
        size = dim * int(self.free.sum())
        return result[np.ix_(self.free, self.free)].transpose(0, 2, 1, 3).reshape(size, size)

    def anchor_root(self) -> np.ndarray:
        """R_i with R_i R_i' = k_i S_i."""
        values, vectors = np.linalg.eigh(self.anchor_shape)
        return np.sqrt(self.anchor_stiffness[:, None, None] * values[:, None, :].clip(0)) * vectors

    def node_stiffness(self) -> np.ndarray:
        """A_ii = k_i + sum_j k_ij."""
        result = self.anchor_stiffness.copy()
        np.add.at(result, self.links.ravel(), np.repeat(self.link_stiffness, 2))
        return result

    def length(self) -> float:
        """Characteristic length [px]: root mean square of rest lengths and of anchors about their centroid,
        weighted by stiffness up to a ten-thousandth of the greatest."""
        linked = self.free & (self.node_stiffness() > self.anchor_stiffness)
        centroid = np.zeros(self.anchors.shape[1])
        for counted in (linked, np.ones(len(linked), dtype=bool)):  # all anchors, if the first gives 0
            stiffness = np.concatenate([self.anchor_stiffness * counted, self.link_stiffness])
            full = 1e-4 * stiffness.max(initial=0) or 1.0
            weights, of_rest = np.split(np.minimum(stiffness / full, 1), [len(linked)])
            if weights.any():
                centroid = np.average(self.anchors, axis=0, weights=weights)
            square = weights @ ((self.anchors - centroid) ** 2).sum(axis=1) + of_rest @ self.rest_length**2
            if square > 0:
                return math.sqrt(square / (weights.sum() + of_rest.sum()))
        return math.sqrt(((self.start - centroid) ** 2).sum() / len(self.start)) or 1.0

    def stationarity(self, x: Points) -> float:
        """The library's stopping rule: max_i |g_i| / (A_ii L)."""
        stiffness = self.node_stiffness()
        moved = stiffness > 0
        forces = np.linalg.norm(self.gradient(x), axis=1)
        return float((forces[moved] / stiffness[moved]).max(initial=0)) / self.length()


def system_of(entry: Any, index: int) -> System:
    """The system of a JSON entry; KeyError, TypeError or ValueError if it is not one."""
    if entry["asterism_system"] != 1:
        raise ValueError("asterism_system is not 1")

    def array(name: str, *shape: int) -> np.ndarray:
        result = np.array(entry[name], dtype=float)
        if result.shape != shape and not (result.size == 0 and 0 in shape):
            raise ValueError(f"{name} has the wrong size")
        if not np.isfinite(result).all():
            raise ValueError(f"{name} has a value that is not a number")
        return result.reshape(shape)

    dim, n, count = int(entry["dim"]), len(entry["anchors"]), len(entry["links"])
    links = array("links", count, 2).astype(int)
    fixed = np.array(entry.get("fixed", []), dtype=int)
    if (
        n == 0
        or ((links < 0) | (links >= n)).any()
        or (links[:, 0] == links[:, 1]).any()
        or not set(fixed) <= set(range(n))
    ):
        raise ValueError("links or fixed name nodes that are none")
    stiffness = array("anchor_stiffness", n), array("link_stiffness", count), array("rest_length", count)
    if any((values < 0).any() for values in stiffness):
        raise ValueError("a stiffness or rest length is negative")
    anchors = array("anchors", n, dim)
    start = array("start", n, dim) if "start" in entry else anchors.copy()
    # Without stiffness these values have no effect, but their squares may overflow.
    anchors[stiffness[0] == 0] = start[stiffness[0] == 0]
    stiffness[2][stiffness[1] == 0] = 0
    return System(
        name=str(entry.get("name") or f"system {index}"),
        anchors=anchors,
        anchor_stiffness=stiffness[0],
        anchor_shape=array("anchor_shape", n, dim, dim)
        if "anchor_shape" in entry
        else np.tile(np.eye(dim), (n, 1, 1)),
        links=links,
        rest_length=stiffness[2],
        link_stiffness=stiffness[1],
        free=~np.isin(np.arange(n), fixed),
        start=start,
    )


def read(path: str) -> list[System]:
    """The systems of a file: one object, an array of them, or one per line."""
    try:
        with open(path, encoding="utf-8") as file:
            text = file.read()
    except (OSError, UnicodeDecodeError) as error:
        raise BadInput(f"{path}: {getattr(error, 'strerror', None) or 'not UTF-8'}") from error
    try:
        whole = json.loads(text)
        entries = [("", entry) for entry in (whole if isinstance(whole, list) else [whole])]
    except ValueError:
        entries = []
        for number, line in enumerate(text.split("\n"), 1):
            if line.strip():
                try:
                    entries.append((f":{number}", json.loads(line)))
                except ValueError as error:
                    raise BadInput(f"{path}:{number}: not JSON") from error
    systems = []
    for index, (where, entry) in enumerate(entries):
        try:
            systems.append(system_of(entry, index))
        except KeyError as error:
            raise BadInput(f"{path}{where}: system {index} has no {error.args[0]}") from error
        except (TypeError, ValueError, AttributeError) as error:
            raise BadInput(f"{path}{where}: system {index}: {error}") from error
    if not systems:
        raise BadInput(f"{path}: no systems")
    return systems


# -------------------------------------------------------------------------------------------------- solvers


@dataclass
class Limits:
    tolerance: float
    iterations: int


@dataclass
class Solution:
    x: Points
    iterations: int
    evaluations: int  # of the energy or of the residuals, those of finite differences too
    note: str = ""  # why it stopped


def ida(system: System, limits: Limits) -> Solution:
    """The paper's Algorithm 1 in its gradient form, x <- x - K_dyn^-1 g (docs/solver.md). With anisotropic
    anchors k_i bounds k_i S_i, so the step still never raises the energy."""
    n = len(system.start)
    matrix = np.diag(system.anchor_stiffness)
    i, j = system.links.T
    for at, sign in (((i, i), 1), ((j, j), 1), ((i, j), -1), ((j, i), -1)):
        np.add.at(matrix, at, sign * system.link_stiffness)
    moved = np.ix_(system.free, system.free)
    inverse = np.zeros((n, n))
    inverse[moved] = np.linalg.inv(matrix[moved])
    scale = 1 / (np.maximum(system.node_stiffness(), 1e-300) * system.length())
    x = system.start.copy()
    for iteration in range(limits.iterations + 1):
        g = system.gradient(x)
        if (np.linalg.norm(g, axis=1) * scale).max() <= limits.tolerance or iteration == limits.iterations:
            break
        x -= inverse @ g
    return Solution(x, iteration, iteration + 1)


class Arrived(Exception):
    """Raised when the stopping rule is met, to leave a minimiser that has other rules."""


class Objective:
    """A system in SciPy's form: a function of the free coordinates, scaled to unit stiffness and length to suit
    SciPy's constants, with the library's stopping rule."""

    def __init__(self, system: System, limits: Limits):
        self.system, self.limits = system, limits
        self.unit = system.length()
        self.stiffness = system.node_stiffness().max() or 1.0
        self.start = system.start[system.free].ravel() / self.unit
        self.best, self.best_energy = system.start, system.energy(system.start)
        self.evaluations = self.iterations = 0

    def points(self, numbers: np.ndarray) -> Points:
        x = self.system.start.copy()
        x[self.system.free] = self.unit * numbers.reshape(-1, x.shape[1])
        return x

    def see(self, x: Points, energy: float) -> None:
        if energy < self.best_energy:
            self.best, self.best_energy = x, energy

    def value(self, numbers: np.ndarray) -> float:
        self.evaluations += 1
        x = self.points(numbers)
        energy = self.system.energy(x)
        self.see(x, energy)
        return energy / (self.stiffness * self.unit**2)

    def gradient(self, numbers: np.ndarray) -> np.ndarray:
        g = self.system.gradient(self.points(numbers))[self.system.free]
        return g.ravel() / (self.stiffness * self.unit)

    def hessian(self, numbers: np.ndarray) -> np.ndarray:
        return self.system.hessian(self.points(numbers)) / self.stiffness

    def residuals(self, numbers: np.ndarray) -> np.ndarray:
        self.evaluations += 1
        x = self.points(numbers)
        r = self.system.residuals(x)
        self.see(x, 0.5 * float(r @ r))
        return r / (math.sqrt(self.stiffness) * self.unit)

    def jacobian(self, numbers: np.ndarray) -> np.ndarray:
        """Called once an iteration."""
        self.check()
        self.iterations += 1
        return self.system.jacobian(self.points(numbers)) / math.sqrt(self.stiffness)

    def after_iteration(self, numbers: np.ndarray) -> None:
        self.iterations += 1
        self.check()

    def check(self) -> None:
        if (
            self.system.stationarity(self.best) <= self.limits.tolerance
            or self.iterations >= self.limits.iterations
        ):
            raise Arrived

    def solution(self, note: str) -> Solution:
        return Solution(self.best, self.iterations, self.evaluations, note)


def scipy_minimize(
    method: str, numeric: bool = False, second: bool = False
) -> Callable[[System, Limits], Solution]:
    """With numeric gradients, or with the Hessian beside the gradient."""

    def solve(system: System, limits: Limits) -> Solution:
        objective = Objective(system, limits)
        # SciPy's own stopping rules are off: the library's apply.
        options = {"maxiter": limits.iterations}
        # With 0, Newton-CG would not begin.
        options |= {"xtol": np.finfo(float).tiny} if method == "Newton-CG" else {"gtol": 0.0}
        if method == "L-BFGS-B":
            options |= {"ftol": 0.0, "maxfun": 10**9}
        try:
            objective.check()
            jac = None if numeric else objective.gradient
            end = optimize.minimize(
                objective.value,
                objective.start,
                jac=jac,
                hess=objective.hessian if second else None,
                method=method,
                options=options,
                callback=objective.after_iteration,
            )
            return objective.solution(str(end.message))
        except Arrived:
            return objective.solution("")

    return solve


def scipy_least_squares(method: str) -> Callable[[System, Limits], Solution]:
    def solve(system: System, limits: Limits) -> Solution:
        objective = Objective(system, limits)
        least = np.finfo(float).eps  # the least tolerance that SciPy accepts
        try:
            end = optimize.least_squares(
                objective.residuals,
                objective.start,
                objective.jacobian,
                method=method,
                ftol=least,
                xtol=least,
                gtol=least,
                max_nfev=100 * limits.iterations,
            )
            return objective.solution(str(end.message))
        except Arrived:
            return objective.solution("")

    return solve


def sklearn_smacof(system: System, limits: Limits) -> Solution:
    """SMACOF of the rest lengths alone, moved rigidly onto the anchors. As scikit-learn's has neither anchors
    nor weights, this is only the nearest problem that it can solve."""
    n, dim = system.start.shape
    if n < 2 or not system.anchor_stiffness.any():
        raise NotImplementedError("asks for two nodes and an anchor")
    if len(system.links) != n * (n - 1) // 2 or not system.free.all():
        raise NotImplementedError("asks for all pairs linked and no node fixed")
    lengths = np.zeros((n, n))
    i, j = system.links.T
    lengths[i, j] = lengths[j, i] = system.rest_length
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        shape, _, iterations = manifold.smacof(
            lengths,
            n_components=dim,
            init=system.start,
            n_init=1,
            max_iter=limits.iterations,
            eps=1e-12,
            return_n_iter=True,
        )
    # Weighted rigid alignment (Kabsch); a mirror image fits the rest lengths as well.
    weights = system.anchor_stiffness / system.anchor_stiffness.sum()
    to, of = weights @ system.anchors, weights @ shape
    u, _, v = np.linalg.svd((shape - of).T @ (weights[:, None] * (system.anchors - to)))
    return Solution(
        (shape - of) @ (u @ v) + to, iterations, iterations, "another problem: no anchors, no stiffness"
    )


@dataclass
class Solver:
    name: str
    solve: Callable[[System, Limits], Solution]


def solvers() -> Iterator[Solver]:
    yield Solver("numpy-ida", ida)
    if optimize is None:
        print("without SciPy's solvers: scipy is not installed (Debian package python3-scipy)")
    else:
        yield Solver("scipy-cg", scipy_minimize("CG"))
        yield Solver("scipy-cg-numeric", scipy_minimize("CG", numeric=True))
        yield Solver("scipy-bfgs", scipy_minimize("BFGS"))
        yield Solver("scipy-lbfgsb", scipy_minimize("L-BFGS-B"))
        yield Solver("scipy-newton-cg", scipy_minimize("Newton-CG", second=True))
        yield Solver("scipy-trust-exact", scipy_minimize("trust-exact", second=True))
        yield Solver("scipy-lm", scipy_least_squares("lm"))
        yield Solver("scipy-trf", scipy_least_squares("trf"))
        yield Solver("scipy-dogbox", scipy_least_squares("dogbox"))
    if manifold is None:
        print("without scikit-learn's SMACOF: sklearn is not installed (Debian package python3-sklearn)")
    else:
        yield Solver("sklearn-smacof*", sklearn_smacof)


# ---------------------------------------------------------------------------------------------------- table


def median_seconds(solve: Callable[[], Any], repeats: int) -> float:
    """Median CPU time of a call [s]; a call of a second or more is made once."""
    seconds = []
    while len(seconds) < repeats and (not seconds or seconds[0] < 1):
        before = time.process_time()
        solve()
        seconds.append(time.process_time() - before)
    return statistics.median(seconds)


def counted(count: int, what: str) -> str:
    """ "1 link", "2 links"."""
    return f"{count} {what}" + "s" * (count != 1)


def print_table(system: System, chosen: list[Solver], limits: Limits, repeats: int) -> None:
    print(
        f"\n{system.name}: {counted(len(system.start), 'node')}, {counted(len(system.links), 'link')},"
        f" energy at the start {system.energy(system.start):.15g}"
    )
    lines = []
    for solver in chosen:
        try:
            solution = solver.solve(system, limits)
            seconds = median_seconds(lambda: solver.solve(system, limits), repeats)
        except (np.linalg.LinAlgError, ValueError, NotImplementedError) as error:
            print(f"{solver.name}: {error}")
            continue
        lines.append(
            (solver.name, solution, system.energy(solution.x), system.stationarity(solution.x), seconds)
        )
    lowest = min((energy for _, _, energy, _, _ in lines), default=0.0)
    print(
        f"{'solver':17} {'status':22} {'energy':>22} {'above':>9} {'iterations':>10} {'evaluations':>11}"
        f" {'stationarity':>12} {'time [us]':>11}"
    )
    for name, solution, energy, stationarity, seconds in lines:
        above = energy / lowest - 1 if lowest > 0 else energy - lowest
        if name.endswith("*"):
            status = "(another problem)"
        elif stationarity <= limits.tolerance:
            status = "converged"
        elif solution.iterations >= limits.iterations:
            status = "maximum of iterations"
        else:
            status = "no progress"
        print(
            f"{name:17} {status:22} {energy:22.15g} {above:9.1e} {solution.iterations:10}"
            f" {solution.evaluations:11} {stationarity:12.1e} {1e6 * seconds:11.4g}"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("file", help="JSON as in docs/system-json.md")
    parser.add_argument("--solvers", help="names, separated by commas (default: all)")
    parser.add_argument(
        "--tolerance", type=float, default=1e-8, help="of the library's stopping rule (default 1e-8)"
    )
    parser.add_argument("--iterations", type=int, default=10000, help="at most (default 10000)")
    parser.add_argument("--repeats", type=int, default=7, help="timings that the median is of (default 7)")
    options = parser.parse_args()

    systems = read(options.file)
    print(
        "For context: solvers in Python, whose time is mostly the interpreter's; energies by the library's"
        " formula."
    )
    chosen = list(solvers())
    if options.solvers:
        wanted = options.solvers.split(",")
        known = {solver.name.rstrip("*"): solver for solver in chosen}
        if unknown := [name for name in wanted if name not in known]:
            raise BadInput(f"no solver is named {unknown[0]}; there are {', '.join(known)}")
        chosen = [known[name] for name in wanted]
    if any(solver.name.endswith("*") for solver in chosen):
        print(
            "* scikit-learn's SMACOF knows neither anchors nor stiffness: it fits the rest lengths"
            " alone, and the"
            " result is moved rigidly onto the anchors."
        )
    for system in systems:
        print_table(system, chosen, Limits(options.tolerance, options.iterations), max(1, options.repeats))


if __name__ == "__main__":
    try:
        main()
        sys.stdout.flush()
    except BadInput as problem:
        sys.exit(f"peers.py: {problem}")
    except OSError as error:  # standard output, as files are BadInput
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # or the flush at exit would fail as well
        sys.exit(f"peers.py: {error.strerror}")
