"""A solver of your own beside the library's, on random systems whose global minima are proven.

    def my_solver(problem):                       # problem.system, problem.start (N, dim)
        x = problem.start.copy()
        for _ in range(500):
            x -= 0.01 * problem.gradient(x)       # evaluations are counted
        return x

    print(asterism.bench.compare(my_solver, kinds=["lit"], sizes=[4]))

All solvers get the same systems and starts.
"""

from __future__ import annotations

import dataclasses
import statistics
import time
from collections.abc import Callable, Iterable, Sequence

import numpy as np
import numpy.typing as npt

from . import _asterism, inputs

__all__ = ["Comparison", "Problem", "Row", "compare"]

_Floats = npt.NDArray[np.float64]


class Problem:
    """A system and its start, whose evaluations are counted."""

    def __init__(self, system: _asterism.SpringSystem, start: _Floats) -> None:
        #: the system; its energy is to be evaluated by the functions below, to be counted
        self.system = system
        #: (N, dim); every solver starts here
        self.start = start
        #: how often energy, gradient or Hessian were asked for
        self.evaluations = 0

    def __repr__(self) -> str:
        return f"<asterism.bench.Problem: {self.system.topology.nodes} nodes, {self.evaluations} evaluations>"

    def energy(self, x: npt.ArrayLike) -> float:
        """E(x) for x (N, dim)."""
        self.evaluations += 1
        return _asterism.energy(self.system, x)

    def gradient(self, x: npt.ArrayLike) -> _Floats:
        """dE/dx, (N, dim)."""
        self.evaluations += 1
        return _asterism.gradient(self.system, x)

    def hessian(self, x: npt.ArrayLike) -> _Floats:
        """d2E/dx2, (dim N, dim N)."""
        self.evaluations += 1
        return _asterism.hessian(self.system, x)


@dataclasses.dataclass(frozen=True)
class Row:
    """A solver's results on the systems of a kind and size."""

    kind: str
    nodes: int
    solver: str
    systems: int  #: number of systems
    converged: int  #: of these, how many results meet the tolerance of the library's stopping rule
    lowest: int  #: how many are within the gap of the lowest energy known
    proven: int  #: for how many systems that energy is proven to be the least, to within the gap
    failed: int  #: how many results are not a placement: an exception, another shape, or numbers that are not finite
    evaluations: float  #: of energy, gradient or Hessian, mean
    seconds: float  #: wall-clock time of a solve, median [s]


@dataclasses.dataclass(frozen=True)
class Comparison:
    """The rows of compare(); printed as a table."""

    rows: Sequence[Row]
    gap: float
    errors: Sequence[str]  #: the first exception of your solver on each kind and size

    def __str__(self) -> str:
        head = f"{'kind':6} {'nodes':>5} {'solver':18} {'systems':>7} {'converged':>9} {'lowest':>7} {'evaluations':>11} {'time [us]':>10}"
        lines = [
            f"{row.kind:6} {row.nodes:5} {row.solver:18} {row.systems:7} {row.converged:9} {row.lowest:7} {row.evaluations:11.1f} "
            f"{row.seconds * 1e6:10.1f}"
            for row in self.rows
        ]
        proven = {(row.kind, row.nodes): f"{row.kind} {row.nodes}: {row.proven} of {row.systems}" for row in self.rows}
        note = f"lowest: within {self.gap:g} of the lowest energy known, which is proven to be the least for " + ", ".join(proven.values())
        return "\n".join([head, *lines, note, *self.errors])


def compare(
    solver: Callable[[Problem], npt.ArrayLike],
    *,
    name: str = "mine",
    kinds: Iterable[str] = ("lit", "track"),
    sizes: Iterable[int] = (4, 9),
    systems: int = 50,
    dim: int = 2,
    against: Iterable[str] = ("auto", "ida"),
    tolerance: float = 1e-8,
    gap: float = 1e-6,
    first_seed: int = 0,
    proof_seconds: float = 0.1,
) -> Comparison:
    """Runs a solver of your own and methods of the library on the same random systems.

    solver: takes a Problem and returns x (N, dim). It may raise; the exception is reported and counts as a failure.
    kinds, sizes, dim: of the systems, see random_system; `systems` of each, with seeds from first_seed.
    against: methods of the library, see methods().
    tolerance: a result has converged if its stationarity() is at most this.
    gap: a result is lowest if its energy is within this share of the lowest that any solver or the search found.
    proof_seconds: time for the search for the global minimum of each system [s] ("branch-and-bound").

    The times of a solver in Python include Python's own; evaluations do not depend on it.
    """
    systems, first_seed = inputs.count(systems, "systems"), inputs.count(first_seed, "first_seed", 0)
    kinds, sizes, against = (inputs.items(values, of, f"a list of {of}") for values, of in ((kinds, "kinds"), (sizes, "sizes"), (against, "against")))
    tolerance, gap, proof_seconds = (
        inputs.number(value, of) for value, of in ((tolerance, "tolerance"), (gap, "gap"), (proof_seconds, "proof_seconds"))
    )
    if not isinstance(name, str):
        raise TypeError(f"name: expected a string, found {inputs.shown(name)}")
    methods = {method: _asterism.Solver(method, tolerance=tolerance) for method in against}
    search = _asterism.Solver("branch-and-bound", max_seconds=proof_seconds, gap=gap)
    rows: list[Row] = []
    errors: list[str] = []
    for kind in kinds:
        for nodes in sizes:
            runs: dict[str, list[_Run]] = {solver_name: [] for solver_name in (name, *methods)}
            lowest, proven, error = [], 0, ""
            for seed in range(first_seed, first_seed + systems):
                system, start = _asterism.random_system(kind, nodes, seed, dim)
                run, problem_of_it = _run_own(solver, system, start)
                error = error or problem_of_it
                runs[name].append(run)
                for method, theirs in methods.items():
                    runs[method].append(_run_method(theirs, system, start))
                x = start.copy()
                summary = search.solve(system, x, check=False)
                lowest.append(min([summary.final_energy, *(each[-1].energy for each in runs.values())]))
                proven += summary.lower_bound >= lowest[-1] * (1 - gap)
            if error:
                errors.append(f"{kind}, {nodes} nodes: {error}")
            for solver_name, each in runs.items():
                rows.append(
                    Row(
                        kind,
                        nodes,
                        solver_name,
                        systems,
                        sum(run.stationarity <= tolerance for run in each),
                        sum(run.energy <= least * (1 + gap) for run, least in zip(each, lowest)),
                        proven,
                        sum(not np.isfinite(run.energy) for run in each),
                        statistics.fmean(run.evaluations for run in each),
                        statistics.median(run.seconds for run in each),
                    )
                )
    return Comparison(rows, gap, errors)


@dataclasses.dataclass(frozen=True)
class _Run:
    energy: float  # inf for no placement
    stationarity: float
    evaluations: int
    seconds: float


def _run_own(solver: Callable[[Problem], npt.ArrayLike], system: _asterism.SpringSystem, start: _Floats) -> tuple[_Run, str]:
    problem = Problem(system.copy(), start.copy())
    begin = time.perf_counter()
    try:
        x = inputs.numbers(solver(problem), "the result")
        error = ""
    except Exception as raised:
        x, error = np.empty(0), f"{type(raised).__name__}: {raised}"
    seconds = time.perf_counter() - begin
    if not error and x.shape != start.shape:
        error = f"the solver returned an array of shape {x.shape}, expected {start.shape}"
    if not error and not np.isfinite(x).all():
        error = "the solver returned numbers that are not finite"
    if error:
        return _Run(np.inf, np.inf, problem.evaluations, seconds), error
    # By the given system: the solver may have changed its own.
    return _Run(_asterism.energy(system, x), _asterism.stationarity(system, x), problem.evaluations, seconds), ""


def _run_method(solver: _asterism.Solver, system: _asterism.SpringSystem, start: _Floats) -> _Run:
    x = start.copy()
    begin = time.perf_counter()
    summary = solver.solve(system, x, check=False)
    seconds = time.perf_counter() - begin
    evaluations = max(summary.energy_evaluations, summary.gradient_evaluations)
    if not summary.usable:
        return _Run(np.inf, np.inf, evaluations, seconds)
    return _Run(summary.final_energy, summary.stationarity, evaluations, seconds)
