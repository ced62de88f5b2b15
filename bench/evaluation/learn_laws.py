#!/usr/bin/env python3
"""Learns the laws of the springs' stiffness from annotated video, by gradients through the solution.

    bench/evaluation/learn_laws.py RECORDS FOLDS OUT

RECORDS is a folder with SEQUENCE.jsonl for each sequence: what `asterism-track SEQUENCE --tracker dpt --record-systems` writes where
the ground truth is known, by one tracker for all sequences. FOLDS has a line FOLD<tab>SEQUENCE... for each sequence; lines that begin
with # are comments. OUT is written: the candidates of cross_validation.py, with the laws that were fitted without each fold.

The laws have five parameters, which are those of StiffnessLaw (dpt's option `stiffness`):

    k_i  = w^a / sigma^(2b)                      peak_exponent a, variance_exponent b
    k_ij = beta (strain^2 + f^2)^(c/2)           link_scale beta, strain_exponent c, strain_floor f

The error of a frame is e^2 / (e^2 + 0.2^2), in [0, 1], so that a frame in which all parts are lost does not dominate. There are two:

    box          e^2 = |distance of the centres|^2 / area + (difference of the logarithms of size)^2, of the annotated box and the box
                 that follows from the solution x: the box of the start, moved and scaled by the least-squares similarity from the
                 start to x, as dpt with its default `transform` does
    placement    e^2 = mean of |x_i - p_i|^2 / area, p the annotated placement; it also counts how the constellation is deformed

Every sequence has the same weight, shared by its frames. A frame counts if it is annotated and the tracker was on the object in the
frame before, with an overlap of at least 0.5. For each fold in turn, L-BFGS-B minimises the mean error on the other folds, from the
paper's law with f = 0.02 (at the paper's f = 0 the error does not depend on f to first order), within a, b in [0, 4], c in [0, 8],
beta in [1e-6, 1e6] and f in [1e-4, 1]. The gradient is that of the solution
(asterism.sensitivity), chained to the parameters. A system without a solution counts with its start, and a system without derivatives
has the gradient 0; their numbers are printed.

The program is in Python because NumPy, SciPy's L-BFGS-B and the module asterism are there, and solves and gradients are the library's
own. Needs NumPy, SciPy and asterism (PYTHONPATH=build/release/solver/python).

Prints a table in Markdown of the errors on each fold under the paper's law and under the laws that were fitted on the others.
"""

import json
import sys
from pathlib import Path

import asterism
import numpy as np
from scipy.optimize import minimize

from cross_validation import BadInput, read_folds

NAMES = ("peak_exponent", "variance_exponent", "link_scale", "strain_exponent", "strain_floor")
# The search is over (a, b, log beta, c, log f).
PAPER = np.array([1, 1, 0, 2, -np.inf])
START = np.array([1, 1, 0, 2, np.log(0.02)])
BOUNDS = ((0, 4), (0, 4), (np.log(1e-6), np.log(1e6)), (0, 8), (np.log(1e-4), 0))
LOSSES = ("box", "placement")
RADIUS = 0.2     # of the robust error
ON_OBJECT = 0.5  # least overlap with the truth in the frame before
TOLERANCE = 1e-10
RESAMPLES = 10_000


def law_of(theta):
    """The options of StiffnessLaw."""
    a, b, log_beta, c, log_f = theta
    return dict(zip(NAMES, map(float, (a, b, np.exp(log_beta), c, np.exp(log_f)))))


def overlap(p, q):
    """Intersection over union of boxes (..., 4): x, y, width, height."""
    p, q = np.asarray(p, float), np.asarray(q, float)
    sides = np.minimum(p[..., :2] + p[..., 2:], q[..., :2] + q[..., 2:]) - np.maximum(p[..., :2], q[..., :2])
    common = np.prod(np.maximum(sides, 0), axis=-1)
    return common / (np.prod(p[..., 2:], axis=-1) + np.prod(q[..., 2:], axis=-1) - common)


def complex_of(points):
    return points[..., 0] + 1j * points[..., 1]


def centres(boxes):
    """Of boxes, which are in pixels' edges, in pixels' centres like the placements; complex."""
    return complex_of(boxes[:, :2] + boxes[:, 2:] / 2 - 0.5)


class Frames:
    """The systems of the frames that count, and what their laws and their errors are computed from."""

    def __init__(self, records):
        """records: {sequence: [asterism.StoredSystem, ...] in the order of the frames}."""
        used, sequence = [], []
        self.trackers = sorted({stored.origin["tracker"] for systems in records.values() for stored in systems})
        for name, systems in records.items():
            before = None
            for stored in systems:
                origin = stored.origin
                # The first system follows the start, which is on the object.
                on_object = before is None or (before["frame"] == origin["frame"] - 1 and "true_box" in before
                                               and overlap(before["box"], before["true_box"]) >= ON_OBJECT)
                if on_object and "true_box" in origin:
                    used.append(stored)
                    sequence.append(name)
                before = origin
        if not used:
            raise BadInput("no system has the annotation of its frame (true_box)")
        if len({str(stored.system.topology.links.tolist()) for stored in used}) > 1:
            raise BadInput("the systems must have the same links")
        self.sequence = np.array(sequence)
        self.systems = [stored.system.copy() for stored in used]
        self.start = np.array([stored.start for stored in used])
        self.box, self.start_box, self.true_box, self.true_placement = (
            np.array([stored.origin[key] for stored in used], float) for key in ("box", "start_box", "true_box", "true_placement"))
        self.peak = np.array([stored.origin["peak"] for stored in used], float)
        self.variance = np.trace(np.array([stored.origin["covariance"] for stored in used], float), axis1=2, axis2=3)
        anchors = np.array([system.anchors for system in self.systems])
        rest = np.array([system.rest_length for system in self.systems])
        i, j = np.array(self.systems[0].topology.links).reshape(-1, 2).T
        self.has_length = rest > 0
        distance = np.linalg.norm(anchors[:, i] - anchors[:, j], axis=2)
        self.strain = np.where(self.has_length, rest - distance, 0) / np.where(self.has_length, rest, 1)
        # Of the similarity: placements about the start's mean, and the box's centre about it.
        start = complex_of(self.start)
        self.mean = start.mean(axis=1)
        self.spokes = start - self.mean[:, None]
        self.inertia = np.sum(abs(self.spokes) ** 2, axis=1)
        self.arm = centres(self.start_box) - self.mean

    def of(self, sequences):
        """The indices of these sequences' frames, and their weights, whose sum is 1."""
        here = np.flatnonzero(np.isin(self.sequence, list(sequences)))
        if not len(here):
            raise BadInput("no frame of these sequences counts: " + ", ".join(sequences))
        names, inverse, counts = np.unique(self.sequence[here], return_inverse=True, return_counts=True)
        return here, 1 / (counts[inverse] * len(names))

    def stiffness(self, here, theta):
        """(T, N) of the anchors and (T, L) of the links, and the derivatives of their logarithms by theta, (T, N, 5) and (T, L, 5)."""
        a, b, log_beta, c, log_f = theta
        peak, variance, strain = self.peak[here], self.variance[here], self.strain[here]
        with np.errstate(divide="ignore", invalid="ignore"):
            weight = np.maximum(peak**a, 1e-12)
            anchors = weight / variance**b
            square = strain**2 + np.exp(2 * log_f)
            links = np.where(self.has_length[here], np.exp(log_beta) * square ** (c / 2), 0)
            by_anchors, by_links = np.zeros((*anchors.shape, 5)), np.zeros((*links.shape, 5))
            by_anchors[..., 0] = np.where(weight > 1e-12, np.log(peak), 0)
            by_anchors[..., 1] = -np.log(variance)
            by_links[..., 2] = 1
            by_links[..., 3] = np.where(square > 0, np.log(square) / 2, 0)
            by_links[..., 4] = np.where(square > 0, c * np.exp(2 * log_f) / square, 0)
        return anchors, links, by_anchors, by_links

    def solve(self, here, anchors, links):
        """The solutions (T, N, 2), and which systems have none: these stay at their start."""
        solver = asterism.Solver("newton", tolerance=TOLERANCE)
        x, failed = self.start[here].copy(), np.zeros(len(here), bool)
        for t, index in enumerate(here):
            system = self.systems[index]
            system.anchor_stiffness, system.link_stiffness = anchors[t], links[t]
            if not solver.solve(system, x[t], check=False).usable:
                x[t], failed[t] = self.start[index], True
        return x, failed

    def boxes(self, here, x):
        """The centres (complex) and logarithms of growth of the boxes, the complex factors of the similarities."""
        z = complex_of(x)
        factor = np.ones(len(here), complex)  # stays 1 where the start does not determine it
        known = self.inertia[here] > 0
        factor[known] = np.sum(self.spokes[here].conj() * z, axis=1)[known] / self.inertia[here][known]
        return z.mean(axis=1) + factor * self.arm[here], np.log(abs(factor)), factor

    def box_squares(self, here, x):
        """e^2 of the box of each frame, and half of its derivative by x (T, N, 2)."""
        centre, growth, factor = self.boxes(here, x)
        truth, start = self.true_box[here], self.start_box[here]
        area = np.prod(truth[:, 2:], axis=1)
        off = (centre - centres(truth)) / area
        size = growth + np.log(np.prod(start[:, 2:], axis=1) / area) / 2
        # The factor is sum conj(p_i) z_i / sum |p_i|^2, linear in z; the centre is mean(z) + factor * arm.
        inertia = self.inertia[here]
        share = self.spokes[here] / np.where(inertia > 0, inertia, 1)[:, None]
        by_z = (1 / x.shape[1] + share * self.arm[here].conj()[:, None]) * off[:, None]
        by_z = by_z + share * (size * factor / abs(factor) ** 2)[:, None]
        return abs(off) ** 2 * area + size**2, np.stack([by_z.real, by_z.imag], axis=2)

    def placement_squares(self, here, x):
        """e^2 of the placement of each frame, and half of its derivative by x (T, N, 2)."""
        off = x - self.true_placement[here]
        by_x = off / (x.shape[1] * np.prod(self.true_box[here][:, 2:], axis=1))[:, None, None]
        return np.sum(off * by_x, axis=(1, 2)), by_x

    def errors(self, here, x, loss):
        """The error of each frame, and its derivative by x (T, N, 2)."""
        square, by_x = self.box_squares(here, x) if loss == "box" else self.placement_squares(here, x)
        return square / (square + RADIUS**2), by_x * (2 * RADIUS**2 / (square + RADIUS**2) ** 2)[:, None, None]

    def evaluate(self, here, theta, loss):
        """The error of each frame, its gradient by theta (T, 5), and the numbers of systems without solution and without derivatives."""
        anchors, links, by_anchors, by_links = self.stiffness(here, theta)
        x, failed = self.solve(here, anchors, links)
        error, by_x = self.errors(here, x, loss)
        gradient, without = np.zeros((len(here), 5)), 0
        for t in np.flatnonzero(~failed):
            try:
                by = asterism.sensitivity(self.systems[here[t]], x[t], by_x[t])
            except np.linalg.LinAlgError:
                without += 1
                continue
            gradient[t] = (by.anchor_stiffness * anchors[t]) @ by_anchors[t] + (by.link_stiffness * links[t]) @ by_links[t]
        return error, gradient, int(failed.sum()), without

    def fit(self, sequences, loss):
        """The theta of the least mean error on these sequences, and SciPy's result."""
        here, weights = self.of(sequences)

        def objective(theta):
            error, gradient, _, _ = self.evaluate(here, theta, loss)
            return weights @ error, weights @ gradient

        result = minimize(objective, START, jac=True, method="L-BFGS-B", bounds=BOUNDS, options={"maxiter": 100})
        return result.x, result

    def score(self, sequences, theta, loss):
        """By sequence: mean error and mean overlap of the boxes with the truth; and the number of systems without solution."""
        here, _ = self.of(sequences)
        anchors, links, _, _ = self.stiffness(here, theta)
        x, failed = self.solve(here, anchors, links)
        error, _ = self.errors(here, x, loss)
        overlaps = overlap(self.modelled(here, x), self.true_box[here])
        names = self.sequence[here]
        return {name: (error[names == name].mean(), overlaps[names == name].mean()) for name in dict.fromkeys(names)}, int(failed.sum())

    def modelled(self, here, x):
        """The boxes (T, 4) that follow from placements x."""
        centre, growth, _ = self.boxes(here, x)
        sides = self.start_box[here][:, 2:] * np.exp(growth)[:, None]
        middle = np.stack([centre.real, centre.imag], axis=1) + 0.5
        return np.hstack([middle - sides / 2, sides])

    def reproduced(self):
        """Of all frames: the share whose modelled box under the paper's law overlaps the tracker's own box by 0.99."""
        here = np.arange(len(self.systems))
        x, _ = self.solve(here, *self.stiffness(here, PAPER)[:2])
        return np.mean(overlap(self.modelled(here, x), self.box) >= 0.99)


def read_records(folder, folds):
    records = {}
    for name in (name for names in folds.values() for name in names):
        path = Path(folder) / f"{name}.jsonl"
        try:
            records[name] = asterism.read_systems(path)
        except (OSError, ValueError) as error:
            raise BadInput(f"{path}: {error}") from error
        for stored in records[name]:
            if missing := {"tracker", "frame", "peak", "covariance", "start_box", "box"} - stored.origin.keys():
                raise BadInput(f"{path}: {stored.name}: no {', '.join(sorted(missing))} in origin: recorded by an older asterism-track")
    return records


def with_law(tracker, law):
    """The description of a tracker, as an object, with this law; None for the paper's."""
    name, brace, rest = tracker.partition("{")
    described = ({"tracker": name} if name.strip() else {}) | (json.loads(brace + rest) if brace else {})
    described.pop("stiffness", None)
    return described if law is None else described | {"stiffness": law}


def interval(differences):
    """Mean and 95 % interval of a bootstrap over sequences."""
    differences = np.array(differences)
    draws = np.random.default_rng(1).integers(0, len(differences), (RESAMPLES, len(differences)))
    return differences.mean(), *np.quantile(differences[draws].mean(axis=1), [0.025, 0.975])


def learn(frames, folds, loss):
    """{fold: theta}, and the lines to print."""
    sequences = [name for names in folds.values() for name in names]
    thetas, differences = {}, []
    lines = [f"### Fitted to the error of the {loss}", "",
             "| fold | error, paper | error, learned | overlap, paper | overlap, learned | " + " | ".join(NAMES) + " |",
             "|---" * (5 + len(NAMES)) + "|"]
    for fold, held_out in folds.items():
        theta, result = frames.fit([name for name in sequences if name not in held_out], loss)
        thetas[fold] = theta
        (paper, failed), (learned, failed_learned) = (frames.score(held_out, law, loss) for law in (PAPER, theta))
        differences += [np.subtract(learned[name], paper[name]) for name in paper]
        means = np.transpose([np.mean(list(scores.values()), axis=0) for scores in (paper, learned)]).ravel()
        lines.append(f"| {fold} | " + " | ".join(f"{value:.4f}" for value in means) + " | "
                     + " | ".join(f"{value:.3g}" for value in law_of(theta).values()) + " |")
        print(f"{loss}, fold {fold}: {result.nit} iterations, {result.nfev} evaluations, {result.message}; without a solution: {failed} "
              f"under the paper's law, {failed_learned} under the learned one", file=sys.stderr)
    theta, result = frames.fit(sequences, loss)
    _, _, failed, without = frames.evaluate(frames.of(sequences)[0], theta, loss)
    lines += ["", f"Fitted on all folds: {json.dumps(law_of(theta))}",
              f"At it, {failed} systems have no solution and {without} no derivatives.", ""]
    for name, column in (("error", 0), ("overlap", 1)):
        value, low, high = interval([difference[column] for difference in differences])
        lines.append(f"{name} out of fold, learned - paper: {value:+.4f} ({low:+.4f} to {high:+.4f}, 95 %, over sequences)")
    return thetas, [*lines, ""]


def main():
    if len(sys.argv) != 4:
        sys.exit(__doc__)
    records, folds_file, out = sys.argv[1:]
    try:
        folds = read_folds(folds_file)
        frames = Frames(read_records(records, folds))
        if len(frames.trackers) > 1:
            raise BadInput("the systems are of several trackers: " + ", ".join(frames.trackers))
        lines = [f"{len(frames.systems)} frames of {len(set(frames.sequence))} sequences count; under the paper's law, "
                 f"{frames.reproduced():.1%} of the modelled boxes are the tracker's own.", ""]
        candidates = {"paper": with_law(frames.trackers[0], None)}
        for loss in LOSSES:
            thetas, table = learn(frames, folds, loss)
            candidates[loss] = {"by_fold": {fold: with_law(frames.trackers[0], law_of(theta)) for fold, theta in thetas.items()}}
            lines += table
    except BadInput as error:
        sys.exit(str(error))
    result = {"about": "The paper's laws of stiffness, and laws that learn_laws.py fitted to the other folds.", "candidates": candidates}
    try:
        Path(out).write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")
    except OSError as error:
        sys.exit(f"{out}: {error.strerror}")
    print("\n".join(lines[:-1]))


if __name__ == "__main__":
    main()
