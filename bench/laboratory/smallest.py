#!/usr/bin/env python3
"""The smallest systems with several minima, for each kind: checks the stored ones and prints their table.

    smallest.py [--file FILE] [--search N] [--make]

FILE (bench/problems/smallest/systems.jsonl) has a system a line. Its `origin` has the kind, the minima, the lowest first, each with a start
from which a solve ends there, and a lower bound of all energies with the way it was proven. Everything is computed again: a solve from each
start has to end in the minimum, where the gradient is zero and the least eigenvalue of the Hessian is more than CURVED times the largest;
the bound is proven by a certificate, or, if the energy depends on one point only, by an exhaustive search of boxes, or it is zero, as no
energy here is negative.
--search draws N systems with fewer nodes or elements for each kind, and kinds that never have several minima, and looks for several. This
proves nothing, but can refute the proofs of docs/smallest-systems.md. --make writes FILE. Needs the Python module of Asterism.
"""

import argparse
import itertools
import json
import pathlib
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import asterism
import numpy as np

FILE = pathlib.Path(__file__).resolve().parents[1] / "problems/smallest/systems.jsonl"
CURVED = 2e-3  # least eigenvalue of the Hessian at a minimum, over the largest
APART = 0.05  # distance of two minima, over the size of the system
LOWER = 1e-9  # difference of two energies that counts, over the larger
PROVEN = {"certificate": 1e-6, "boxes": 1e-4, "zero": 0.0}  # gap between the least energy and its bound
ZERO = 1e-20  # energy that is rounding only

Array = np.ndarray
AnySystem = asterism.SpringSystem | asterism.System
rng = np.random.default_rng(1)


# Systems. Each function returns one, and where its nodes are at first, (nodes, dim): fixed ones stay there.

PATH = [[0, 1], [1, 2]]
ENDS = np.array([[0, 0], [0.5, 0.2], [1, 0]])  # anchors of a path, the middle one weak
STAR = [[0.3, 0.3, 0.2], [0, 0, 0], [1, 0, 0], [0, 1, 0]]
TALL = [[0, 0], [3, 4], [6, 0]]  # with sides of 5
OBTUSE = 2 * np.arctan(0.5 / 0.2)  # the angle at the middle
Made = tuple[AnySystem, Array]


def springs(anchors: Any, stiffness: Any, links: Any, lengths: Any, link_stiffness: Any = 1, offsets: Any = None) -> Made:
    anchors = np.asarray(anchors, float)
    system = asterism.SpringSystem(asterism.Topology.from_links(len(anchors), links), dim=anchors.shape[1])
    system.anchors, system.anchor_stiffness = anchors, stiffness
    system.rest_length, system.link_stiffness = lengths, link_stiffness
    if offsets is not None:
        system.rest_offset = offsets
    return system, anchors


def terms(anchors: Any, stiffness: Any, *added: tuple[Any, ...], **loss: Any) -> Made:
    """Anchors, and terms: the name of each without add_, its arguments, and its choices."""
    anchors = np.asarray(anchors, float)
    system = asterism.System(len(anchors), dim=anchors.shape[1])
    system.add_anchors(anchors, stiffness, **loss)
    for name, *arguments, choices in added:
        getattr(system, f"add_{name}")(*arguments, **choices)
    return system, anchors


def path(name: str, *arguments: Any, **choices: Any) -> Made:
    return terms(ENDS, [1, 0.1, 1], (name, *arguments, choices))


def common_length() -> Made:
    return terms(TALL, [1, 0.05, 1], ("common_length", PATH, 1, {"lengths": 4, "prior": 1, "prior_stiffness": 5}))


def anchors_of_one(positions: Any, stiffness: Any, **loss: Any) -> Made:
    positions = np.asarray(positions, float)
    system = asterism.System(1, dim=positions.shape[1])
    system.add_anchors(positions, stiffness, nodes=[0] * len(positions), **loss)
    return system, positions[:1]


def one_robust_anchor() -> Made:
    system = asterism.System(2)
    system.add_anchors([[0, 0]], 1, nodes=[0], loss="geman-mcclure", scale=1)
    system.add_anchors([[5, 0]], 0.5, nodes=[1])
    system.add_links([[0, 1]], 1, 0.06)
    return system, np.array([[0.0, 0], [5, 0]])


def held(fixed: Any, *added: tuple[Any, ...]) -> Made:
    """Node 0 has an anchor, which is weak; the others are fixed."""
    x = np.vstack([np.zeros_like(np.asarray(fixed, float)[:1]) + 0.3, fixed])
    system = asterism.System(len(x), dim=x.shape[1])
    system.add_anchors(x[:1], 0.1, nodes=[0])
    for name, *arguments, choices in added:
        getattr(system, f"add_{name}")(*arguments, **choices)
    for node in range(1, len(x)):
        system.fix(node)
    return system, x


def ranges(dim: int) -> Made:
    beacons = np.vstack([np.zeros(dim), np.eye(dim)])[:dim]
    return held(beacons, ("links", [[0, k] for k in range(1, dim + 1)], 1, 1, {}))


def drawn_ranges(beacons: Array, links: list[list[int]]) -> Made:
    return held(beacons, ("links", links, rng.uniform(0.2, 2, len(links)), rng.uniform(0.1, 5, len(links)), {}))


def of_laboratory(kind: str, nodes: int = 3) -> Made:
    """A system of the kinds of asterism/testing/random_system.hpp, all of its nodes linked."""
    pairs = np.array(list(itertools.combinations(range(nodes), 2)))

    def lengths(x: Array) -> Array:
        return np.linalg.norm(x[pairs[:, 0]] - x[pairs[:, 1]], axis=1)

    if kind == "track":
        grid = 30.0 * np.array([[k % 2, k // 2] for k in range(nodes)])
        moved = grid + rng.uniform(-10, 10, 2)
        drifted = rng.random(nodes) < 0.1
        anchors = moved + np.where(drifted, 20, 3)[:, None] * rng.normal(size=(nodes, 2))
        weight = np.where(drifted, rng.uniform(0.1, 0.4, nodes), rng.uniform(0.3, 1, nodes))
        variance = np.where(drifted, rng.uniform(50, 200, nodes), rng.uniform(10, 60, nodes))
        strain = 1 - lengths(anchors) / lengths(grid)
        return springs(anchors, weight / variance, pairs, lengths(grid), strain**2)
    x = rng.uniform(0, 1, (nodes, 2))
    displaced = x + rng.uniform(-0.5, 0.5, x.shape)
    anchors = (x if kind == "orig" else displaced) + rng.uniform(-0.25, 0.25, x.shape)
    stiffness = (0.1 * lengths(displaced if kind == "disp" else x)) ** -2.0
    return springs(anchors, 0.5 + rng.uniform(0, 1, nodes) * stiffness.mean(), pairs, lengths(x), stiffness)


@dataclass
class Kind:
    name: str
    nodes: int  # that may move
    elements: int  # beside one anchor per node
    make: Callable[[], Made]
    smaller: Callable[[], Made] | None = None  # a random system that is smaller, of which the page proves that it has one minimum
    is_drawn: bool = False  # make draws until there are several


def few(dim: int, nodes: int, links: list[list[int]], name: str = "links", **choices: Any) -> Callable[[], Made]:
    """Random systems with plain anchors."""

    def make() -> Made:
        x = rng.uniform(-1, 1, (nodes, dim))
        arguments = [np.exp(rng.uniform(-1, 1, len(links)))] * (name in ("links", "bendings"))
        stiffness = np.exp(rng.uniform(-2, 3, len(links)))
        if choices.get("law") == "interval":
            choices["upper"] = 1.2 * arguments[0]
        if name in ("areas", "angles"):
            arguments = [stiffness, rng.uniform(0.1, 2, len(links))]
            arguments = [arguments[1], arguments[0]]
        else:
            arguments.append(stiffness)
        if name == "offsets":
            arguments = [rng.uniform(-1, 1, (len(links), dim)), stiffness]
        if name == "common_length":
            choices.update(lengths=np.exp(rng.uniform(-1, 1, len(links))), prior=0.1, prior_stiffness=1)
        return terms(x, np.exp(rng.uniform(-3, 1, nodes)), (name, links, *arguments, choices))

    return make


TWO = [[0, 1], [0, 1]]  # two links of the same nodes
KINDS = [
    Kind("springs on a line", 2, 1, lambda: terms([[0.0], [0.2]], 1, ("links", [[0, 1]], 1, 1, {})), few(1, 1, [])),
    Kind("springs", 3, 2, lambda: springs(ENDS, [1, 0.1, 1], PATH, 1), few(2, 2, TWO)),
    Kind("springs in space", 4, 3, lambda: springs(STAR, [0.1, 1, 1, 1], [[0, 1], [0, 2], [0, 3]], 1), few(3, 3, [[0, 1], [0, 2], [1, 2]])),
    *(Kind(f"{kind}, all nodes linked", 3, 3, lambda kind=kind: of_laboratory(kind), is_drawn=True) for kind in ("lit", "orig", "disp", "track")),
    Kind("springs with offsets", 2, 2, lambda: springs([[0.5, 0.2], [0, 0]], 0.2, TWO, 1, 1, [[0, 0], [1, 0]]), few(2, 2, TWO, offsets=[[0.3, 0.1]] * 2)),
    Kind("repulsion", 3, 2, lambda: path("links", PATH, 1, 1, law="repulsion"), few(2, 2, TWO, law="repulsion")),
    Kind("interval", 3, 2, lambda: path("links", PATH, 0.9, 1, law="interval", upper=1.1), few(2, 2, TWO, law="interval")),
    Kind("common length", 3, 2, common_length, few(2, 2, TWO, "common_length")),
    Kind("bendings", 3, 2, lambda: terms(ENDS, [5, 0.2, 5], ("bendings", [[0, 1, 2], [1, 2, 0]], [1, 1.6], 1, {})), few(2, 3, [[0, 1, 2]], "bendings")),
    Kind("angles", 3, 1, lambda: path("angles", [[0, 1, 2]], OBTUSE, 0.5)),
    Kind("logarithm", 2, 1, lambda: terms([[0, 0], [31, 0]], 0.024, ("links", [[0, 1]], 1, 1, {"law": "logarithm"}))),
    Kind("robust lengths", 2, 1, lambda: terms([[0, 0], [6, 0]], 0.2, ("links", [[0, 1]], 1, 4, {"loss": "geman-mcclure", "scale": 0.5}))),
    Kind("robust offsets", 2, 1, lambda: terms([[0, 0], [6, 0]], 0.2, ("offsets", [[1, 0]], [1, 0], 4, {"loss": "geman-mcclure", "scale": 0.5}))),
    Kind("robust differences", 3, 1, lambda: terms([[0, 0], [1, 4], [2, 0]], 0.2, ("differences", [[0, 1, 2]], 4, {"loss": "geman-mcclure", "scale": 0.5}))),
    Kind("robust anchor", 2, 1, one_robust_anchor, lambda: terms([rng.uniform(-1, 1, 2)], 1, loss="geman-mcclure", scale=1)),
    Kind("two robust anchors of a node", 1, 1, lambda: anchors_of_one([[0, 0], [4, 1]], [1, 1.5], loss="geman-mcclure", scale=1)),
    Kind("two truncated anchors of a node", 1, 1, lambda: anchors_of_one([[0, 0], [1.6, 0.4]], [1, 1.5], loss="truncated", scale=0.8, sharpness=4)),
    Kind("ranges on a line", 1, 1, lambda: ranges(1), few(1, 1, [])),
    Kind("ranges", 1, 2, lambda: ranges(2), lambda: drawn_ranges(rng.uniform(-1, 1, (1, 2)), [[0, 1]] * 2)),
    Kind("ranges in space", 1, 3, lambda: ranges(3), lambda: drawn_ranges(rng.uniform(-1, 1, (2, 3)), [[0, 1], [0, 2]])),
    Kind("strengths of a signal", 1, 1, lambda: held([[31, 0.3]], ("links", [[0, 1]], 1, 8, {"law": "logarithm"}))),
    Kind("angle at a node", 1, 1, lambda: held([[-0.2, 0], [0.8, 0]], ("angles", [[1, 0, 2]], 2.4, 0.5, {}))),
]
NEVER = {
    "ropes": few(2, 4, [[0, 1], [1, 2], [2, 3], [0, 2]], law="rope"),
    "offsets": few(2, 4, [[0, 1], [1, 2], [2, 3], [0, 2]], "offsets"),
    "Huber's offsets": few(2, 4, [[0, 1], [1, 2], [2, 3], [0, 2]], "offsets", loss="huber", scale=0.3),
    "one area": few(2, 3, [[0, 1, 2]], "areas"),
}


# Minima.


def energy(system: AnySystem, x: Array) -> float:
    return system.energy(x) if isinstance(system, asterism.System) else asterism.energy(system, x)


def gradient(system: AnySystem, x: Array) -> Array:
    return system.gradient(x) if isinstance(system, asterism.System) else asterism.gradient(system, x)


def solve(system: AnySystem, x: Array, method: str = "auto", **options: float) -> asterism.Summary:
    run = system.solve if isinstance(system, asterism.System) else lambda *some, **more: asterism.solve(system, *some, **more)
    return run(x, method, check=False, **options)


def free_nodes(system: AnySystem) -> Array:
    return np.array([not system.is_fixed(node) for node in range(system.nodes)])


def curvatures(system: AnySystem, x: Array) -> Array:
    """Eigenvalues of the Hessian of the nodes that may move, by central differences of the gradient."""
    free = np.flatnonzero(np.repeat(free_nodes(system), x.shape[1]))
    step = 1e-5 * np.ptp(x, axis=0).max() if len(x) > 1 else 1e-5
    hessian = np.empty((len(free), len(free)))
    for row, unknown in enumerate(free):
        moved = [x.copy(), x.copy()]
        for sign, y in zip((1, -1), moved):
            y.reshape(-1)[unknown] += sign * step
        hessian[row] = (gradient(system, moved[0]) - gradient(system, moved[1])).reshape(-1)[free] / (2 * step)
    return np.linalg.eigvalsh((hessian + hessian.T) / 2)


@dataclass
class Minimum:
    x: Array
    energy: float
    start: Array


def minimum_from(system: AnySystem, start: Array) -> Minimum | None:
    """The strict minimum in which a solve ends, or None if it ends elsewhere."""
    x = start.copy()
    summary = solve(system, x, tolerance=1e-13)
    if not summary.usable:
        return None
    along = curvatures(system, x)
    return Minimum(x, energy(system, x), start) if along[0] > CURVED * along[-1] else None


def minima_of(system: AnySystem, about: Array, starts: int) -> list[Minimum]:
    """The different strict minima that random starts lead to, the lowest first."""
    size = max(1.0, np.ptp(about, axis=0).max())
    free = free_nodes(system)
    found: list[Minimum] = []
    for _ in range(starts):
        start = about.copy()
        start[free] += size * rng.uniform(-1, 1, start[free].shape).round(2)
        minimum = minimum_from(system, start)
        if minimum and all(np.abs(minimum.x - other.x).max() > APART * size for other in found):
            found.append(minimum)
    return sorted(found, key=lambda minimum: minimum.energy)


# Lower bounds.

Radial = tuple[Array, Callable[[Array], Array], float, float]  # centre, energy by the distance r to it, least between these r


@dataclass
class PointProblem:
    """An energy that depends on one point, and the function from the nodes to that point."""

    radial: list[Radial]
    angles: list[tuple[Array, Array, float, float]]  # between two places: angle at rest, stiffness
    dim: int
    point: Callable[[Array], Array]

    def least(self, centres: Array, radius: float) -> Array:
        """Lower bounds of the energy within `radius` of the centres; its values for a radius of 0."""
        total = np.zeros(len(centres))
        for at, value, low, high in self.radial:
            r = np.linalg.norm(centres - at, axis=1)
            total += value(np.where(r - radius > high, r - radius, np.where(r + radius < low, r + radius, low if low == high else np.clip(r, low, high))))
        for one, other, rest, stiffness in self.angles:
            to = [centres - one, centres - other]
            r = [np.linalg.norm(d, axis=1) for d in to]
            angle = np.arccos(np.clip((to[0] * to[1]).sum(axis=1) / np.maximum(r[0] * r[1], 1e-300), -1, 1))
            slack = sum(np.where(distance > radius, np.arcsin(np.minimum(1, radius / np.maximum(distance, 1e-300))), np.pi) for distance in r)
            total += stiffness / 2 * np.maximum(0, np.abs(angle - rest) - slack) ** 2
        return total

    def prove(self, best: float) -> float:
        """A lower bound close to the energy `best`, or minus infinity: boxes are halved until none of them can have less."""
        bound = best * (1 - PROVEN["boxes"] / 2) - 1e-12 * abs(best)
        half = max(np.abs(at).max() for at, *_ in self.radial) + 1.0
        while sum(float(value(np.maximum(high, half - np.linalg.norm(at)))) for at, value, _, high in self.radial) < best:
            half *= 2
            if half > 1e6:
                return -np.inf
        corners = np.array(list(itertools.product((-0.5, 0.5), repeat=self.dim)))
        boxes = np.zeros((1, self.dim))
        while len(boxes):
            if len(boxes) > 3_000_000 or self.least(boxes, 0).min() < bound:
                return -np.inf
            boxes = boxes[self.least(boxes, half * np.sqrt(self.dim)) < bound]
            boxes = (boxes[:, None] + half * corners).reshape(-1, self.dim)
            half /= 2
        return bound


def loss_of(term: dict[str, Any]) -> Callable[[Array], Array]:
    """rho of a squared distance."""
    square, mu = term.get("scale", 1) ** 2, term.get("sharpness", 1)
    return {
        "quadratic": lambda s: s,
        "geman-mcclure": lambda s: s / (1 + s / square),
        "truncated": lambda s: np.where(
            s <= mu / (mu + 1) * square, s, np.where(s >= (mu + 1) / mu * square, square, 2 * np.sqrt(square * mu * (mu + 1) * s) - mu * (square + s))
        ),
    }[term.get("loss", "quadratic")]


def radial(at: Any, term: dict[str, Any], stiffness: float) -> Radial:
    """An element's energy by a distance: an anchor, a link or an offset."""
    length, rho = term.get("length", 0), loss_of(term)
    stretch = (lambda r: np.log(np.maximum(r, 1e-300) / length)) if term.get("law") == "logarithm" else (lambda r: r - length)
    return np.asarray(at, float), lambda r: stiffness / 2 * rho(stretch(r) ** 2), length, length


def point_problem(record: dict[str, Any]) -> PointProblem | None:
    """Of a system in a file, if its least energy depends on one point. Reads the numbers of the file, not those of the library."""
    start, fixed = np.array(record["start"], float), set(record.get("fixed", ()))
    dim, (anchors, *others) = record["dim"], record["terms"]

    def rows(term: dict[str, Any], key: str) -> list[Any]:
        count, value = len(term["nodes"]), term[key]
        return value if isinstance(value, list) and len(value) == count else [value] * count

    def element(term: dict[str, Any], e: int = 0) -> tuple[dict[str, Any], float]:
        """With its own numbers, and its stiffness."""
        return {**term, **{key: rows(term, key)[e] for key in ("length", "scale", "sharpness") if key in term}}, rows(term, "stiffness")[e]

    places = list(zip([np.atleast_1d(p) for p in rows(anchors, "position")], rows(anchors, "stiffness")))
    free = [node for node in range(len(start)) if node not in fixed]
    if len(free) == 1:  # one node among fixed ones
        parts, angles = [radial(p, *element(anchors, e)) for e, (p, _) in enumerate(places)], []
        for term in others:
            for e, nodes in enumerate(term["nodes"]):
                if term["kind"] == "angles":
                    angles.append((start[nodes[0]], start[nodes[2]], rows(term, "rest")[e], rows(term, "stiffness")[e]))
                else:
                    parts.append(radial(start[max(nodes)], *element(term, e)))
        return PointProblem(parts, angles, dim, lambda x: x[free[0]])
    if anchors.get("loss") and len(others) == 2:  # a robust anchor, and a node with a plain one at the end of a spring: two springs in series
        link, stiffness = element(others[1])
        in_series = 1 / (1 / rows(others[0], "stiffness")[0] + 1 / stiffness)
        far = np.ravel(others[0]["position"])
        return PointProblem([radial(places[0][0], *element(anchors)), radial(far, link, in_series)], [], dim, lambda x: x[0])
    if len(others) == 1 and len(others[0]["nodes"]) == 1 and others[0]["kind"] != "angles":  # one element: of d = sum c_i x_i
        term = others[0]
        c = np.array([1, -1] if len(term["nodes"][0]) == 2 else [rows(term, name)[0] for name in "abc"], float)
        nodes = term["nodes"][0]
        softness = sum(c[e] ** 2 / places[node][1] for e, node in enumerate(nodes))
        middle = sum(c[e] * places[node][0] for e, node in enumerate(nodes))
        rest = np.ravel(term.get("offset", term.get("target", 0))) * np.ones(dim)
        return PointProblem([radial(middle, {}, 1 / softness), radial(rest, *element(term))], [], dim, lambda x: c @ x[nodes])
    return None


def lower_bound(system: AnySystem, lowest: Minimum, record: dict[str, Any]) -> tuple[str, float]:
    """The way of a proof, and the bound that it gives."""
    if lowest.energy < ZERO:
        return "zero", 0.0
    certificate = system.certify(lowest.x) if isinstance(system, asterism.System) else asterism.certify(system, lowest.x)
    if certificate.certified:
        return "certificate", certificate.lower_bound
    problem = point_problem(record) if isinstance(system, asterism.System) else None
    if problem:
        at = problem.point(lowest.x)[None]
        if abs(problem.least(at, 0)[0] - lowest.energy) > 1e-6 * abs(lowest.energy):
            raise ValueError("the energy of the point is not that of the system")
        return "boxes", problem.prove(lowest.energy)
    return "none", -np.inf


# The file.


@dataclass
class Checked:
    kind: Kind
    minima: list[Minimum]
    curvature: float  # least over largest eigenvalue, at the minimum where this is least
    proof: str
    bound: float

    def row(self) -> str:
        """Of the table."""
        energies = ", ".join("0" if minimum.energy < ZERO else f"{minimum.energy:.4g}" for minimum in self.minima)
        return f"| {self.kind.name} | {self.kind.nodes} | {self.kind.elements} | {energies} | {self.curvature:.2g} | {self.proof} |"


def check(stored: asterism.StoredSystem, record: dict[str, Any]) -> Checked:
    """Of a system of the file. ValueError says what does not hold."""
    kind = next((kind for kind in KINDS if kind.name == stored.name), None)
    if kind is None:
        raise ValueError(f"{stored.name}: no kind of this name")
    system, origin = stored.system, stored.origin

    def need(condition: bool, what: str) -> None:
        if not condition:
            raise ValueError(f"{stored.name}: {what}")

    minima, curvature = [], np.inf
    for known in origin["minima"]:
        start, x = np.array(known["start"], float), np.array(known["x"], float)
        found = minimum_from(system, start)
        need(found is not None, "a start does not lead to a strict minimum")
        size = max(1.0, np.ptp(x, axis=0).max())
        need(np.abs(found.x - x).max() < 1e-6 * size, "a start leads elsewhere")
        need(abs(found.energy - known["energy"]) <= LOWER * max(1, abs(found.energy)), "an energy differs")
        along = curvatures(system, x)
        free = free_nodes(system)
        need(np.abs(gradient(system, x)[free]).max() < 1e-7 * along[-1] * size, "a gradient is not zero")
        need(all(np.abs(x - other.x).max() > APART * size for other in minima), "two minima are the same")
        curvature = min(curvature, along[0] / along[-1])
        minima.append(found)
    need(len(minima) > 1, "one minimum only")
    need(all(a.energy <= b.energy * (1 + LOWER) for a, b in zip(minima, minima[1:])), "the first minimum is not the lowest")
    need(int(free_nodes(system).sum()) == kind.nodes, "another number of nodes")
    proof, bound = lower_bound(system, minima[0], record)
    need(proof == origin["proof"] and bound >= minima[0].energy * (1 - PROVEN.get(proof, 0)) - 1e-12, "the least energy is not proven")
    need(bound <= minima[0].energy * (1 + 1e-9) + 1e-12, "the bound is above an energy")
    return Checked(kind, minima, curvature, proof, bound)


def stored_systems(path: pathlib.Path) -> Iterator[tuple[asterism.StoredSystem, dict[str, Any]]]:
    return zip(asterism.read_systems(path), map(json.loads, path.read_text().splitlines()))


def make(path: pathlib.Path) -> None:
    made = []
    for kind in KINDS:
        while True:
            system, about = kind.make()
            minima = minima_of(system, about, 100 if kind.is_drawn else 1000)
            differ = len(minima) > 1 and np.abs(minima[0].x - minima[1].x).max() > 0.3 * np.ptp(about, axis=0).max()
            if not kind.is_drawn or (differ and minima[1].energy > 1.02 * minima[0].energy and asterism.certify(system, minima[0].x).certified):
                break
        if len(minima) < 2:
            raise ValueError(f"{kind.name}: {len(minima)} minima")
        origin: dict[str, Any] = {"minima": [{"x": m.x.tolist(), "energy": m.energy, "start": m.start.tolist()} for m in minima]}
        stored = asterism.StoredSystem(system, minima[-1].start, kind.name, origin)
        asterism.write_systems(path, [stored])
        origin["proof"], origin["lower_bound"] = lower_bound(system, minima[0], json.loads(path.read_text()))
        made.append(stored)
        print(f"{kind.name}: {len(minima)} minima, {origin['proof']}, {minima[0].energy:.9g} >= {origin['lower_bound']:.9g}", flush=True)
    asterism.write_systems(path, made)


def search(count: int) -> int:
    """Random systems that are smaller, and kinds that never have several: how many have minima of different energies."""
    refuted = 0
    for name, draw in itertools.chain(((f"{k.name}, smaller", k.smaller) for k in KINDS if k.smaller), NEVER.items()):
        several = 0
        for _ in range(count):
            minima = minima_of(*draw(), 20)
            several += len(minima) > 1 and minima[-1].energy > minima[0].energy + 1e-6 * abs(minima[-1].energy)
        print(f"{name}: {several} of {count} random systems have minima of different energies", flush=True)
        refuted += several
    return refuted


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--file", type=pathlib.Path, default=FILE)
    parser.add_argument("--search", type=int, default=0, metavar="N")
    parser.add_argument("--make", action="store_true")
    options = parser.parse_args()
    if options.make:
        make(options.file)
    print("| kind | nodes | elements | energies of the minima | curvature | the least is proven by |\n|---|---|---|---|---|---|")
    for stored, record in stored_systems(options.file):
        found = check(stored, record)
        print(found.row(), flush=True)
    if options.search:
        print()
        sys.exit(search(options.search) > 0)


if __name__ == "__main__":
    try:
        main()
    except (OSError, ValueError) as error:
        sys.exit(f"smallest.py: {error}")
