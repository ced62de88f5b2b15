#!/usr/bin/env python3
"""System: every kind of term against its formula in NumPy, what a term's arrays do, bad input, functions of one's own, files."""

import copy
import json
import pickle
import signal
import tempfile
import threading
import time
import unittest
from pathlib import Path

import asterism
import numpy as np

try:
    import jsonschema
except ImportError:
    jsonschema = None

rng = np.random.default_rng(3)
N = 7


def pairs(count=6):
    return np.array([rng.choice(N, 2, replace=False) for _ in range(count)])


def triples(count=5):
    return np.array([rng.choice(N, 3, replace=False) for _ in range(count)])


def semidefinite(count, dim, rank):
    factor = rng.normal(size=(count, dim, rank))
    return factor @ factor.transpose(0, 2, 1)


def positive(*shape):
    return rng.uniform(0.5, 2, shape)


def rho(loss, square, scale=None, sharpness=None):
    """Huber; Geman and McClure; and the truncated loss of Yang et al., with its quadratic, concave and constant parts."""
    if loss == "quadratic":
        return square
    c2 = scale * scale
    if loss == "huber":
        return np.where(square <= c2, square, 2 * scale * np.sqrt(square) - c2)
    if loss == "geman-mcclure":
        return c2 * square / (c2 + square)
    low, high = c2 * sharpness / (sharpness + 1), c2 * (sharpness + 1) / sharpness
    middle = 2 * np.sqrt(c2 * square * sharpness * (sharpness + 1)) - sharpness * (c2 + square)
    return np.where(square <= low, square, np.where(square >= high, c2, middle))


LOSSES = {"quadratic": {}, "huber": {"scale": 0.7}, "geman-mcclure": {"scale": 1.5}, "truncated": {"scale": 1.2, "sharpness": 3.0}}


def in_norm(d, information):
    return np.einsum("md,mde,me->m", d, information, d)


def of_loss(k, square, loss):
    name, values = loss
    return np.sum(k * rho(name, square, **values)) / 2


# Each kind: adds a term to a system, and returns the term and its energy, written out.


def anchors(system, loss):
    dim = system.dim
    nodes, at, k = rng.integers(0, N, 9), rng.normal(size=(9, dim)), positive(9)
    s = semidefinite(9, dim, 1)
    term = system.add_anchors(at, k, nodes=nodes, information=s, loss=loss[0], **loss[1])
    return term, lambda x: of_loss(k, in_norm(x[nodes] - at, s), loss)


def all_anchors(system, loss):
    at = rng.normal(size=(N, system.dim))
    return system.add_anchors(at, 0.3, loss=loss[0], **loss[1]), lambda x: of_loss(0.3, ((x - at) ** 2).sum(1), loss)


def stretch(law, r, mu, upper):
    if law == "rope":
        return np.maximum(r - mu, 0)
    if law == "repulsion":
        return np.minimum(r - mu, 0)
    if law == "interval":
        return np.where(r < mu, r - mu, np.where(r > upper, r - upper, 0))
    if law == "logarithm":
        return np.log(r / mu)
    return r - mu


def lengths(kind, law):
    def add(system, loss):
        dim = system.dim
        nodes = pairs(8) if kind == "links" else triples(8)
        k, mu, offset, s = positive(8), positive(8), rng.normal(size=(8, dim)), semidefinite(8, dim, dim)
        upper = mu + positive(8)
        add = system.add_links if kind == "links" else system.add_bendings
        term = add(nodes, mu, k, law=law, upper=upper if law == "interval" else None, offsets=offset, information=s, loss=loss[0], **loss[1])
        c = [1, -1] if kind == "links" else [1, -2, 1]

        def energy(x):
            v = sum(factor * x[nodes[:, a]] for a, factor in enumerate(c)) - offset
            return of_loss(k, stretch(law, np.sqrt(in_norm(v, s)), mu, upper) ** 2, loss)

        return term, energy

    return add


def plain_links(system, loss):
    nodes, mu, k = pairs(), positive(6), positive(6)
    term = system.add_links(nodes, mu, k, loss=loss[0], **loss[1])
    return term, lambda x: of_loss(k, (np.linalg.norm(x[nodes[:, 0]] - x[nodes[:, 1]], axis=1) - mu) ** 2, loss)


def offsets(system, loss):
    dim = system.dim
    nodes, m, k, s = pairs(), rng.normal(size=(6, dim)), positive(6), semidefinite(6, dim, 1)
    term = system.add_offsets(nodes, m, k, information=s, loss=loss[0], **loss[1])
    return term, lambda x: of_loss(k, in_norm(x[nodes[:, 0]] - x[nodes[:, 1]] - m, s), loss)


def differences(system, loss):
    dim = system.dim
    nodes, k, t = triples(), positive(5), rng.normal(size=(5, dim))
    a, b, c = 1.5, rng.normal(size=(dim, dim)), rng.normal(size=(5, dim, dim))
    term = system.add_differences(nodes, k, target=t, coefficients=(a, b, c), loss=loss[0], **loss[1])

    def energy(x):
        i, j, l = nodes.T
        d = a * x[i] + x[j] @ b.T + np.einsum("mde,me->md", c, x[l]) - t
        return of_loss(k, (d**2).sum(1), loss)

    return term, energy


def second_differences(system, loss):
    nodes = triples()
    term = system.add_differences(nodes, 2, loss=loss[0], **loss[1])
    return term, lambda x: of_loss(2, ((x[nodes[:, 0]] - 2 * x[nodes[:, 1]] + x[nodes[:, 2]]) ** 2).sum(1), loss)


def angles(system, loss):
    nodes, rest, k = triples(), rng.uniform(0.3, 2.8, 5), positive(5)
    term = system.add_angles(nodes, rest, k, loss=loss[0], **loss[1])

    def energy(x):
        u, v = x[nodes[:, 0]] - x[nodes[:, 1]], x[nodes[:, 2]] - x[nodes[:, 1]]
        cosine = (u * v).sum(1) / np.linalg.norm(u, axis=1) / np.linalg.norm(v, axis=1)
        return of_loss(k, (np.arccos(cosine) - rest) ** 2, loss)

    return term, energy


def areas(system, loss):
    nodes, rest, k = triples(), positive(5), positive(5)
    term = system.add_areas(nodes, rest, k, loss=loss[0], **loss[1])

    def energy(x):
        u, v = x[nodes[:, 1]] - x[nodes[:, 0]], x[nodes[:, 2]] - x[nodes[:, 0]]
        if x.shape[1] == 2:
            area = (u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]) / 2
        else:
            area = np.linalg.norm(np.cross(u, v), axis=1) / 2
        return of_loss(k, (area - rest) ** 2, loss)

    return term, energy


def common_length(system, loss):
    nodes, mu, k = pairs(9), positive(9), positive(9)
    term = system.add_common_length(nodes, k, lengths=mu, prior=0.4, prior_stiffness=0.7, loss=loss[0], **loss[1])

    def energy(x):
        r = np.linalg.norm(x[nodes[:, 0]] - x[nodes[:, 1]], axis=1)

        def at(b):
            return of_loss(k, (r - mu - b) ** 2, loss) + 0.7 * (b - 0.4) ** 2 / 2

        low, high = -20.0, 20.0  # convex in b: a search by thirds
        for _ in range(200):
            first, second = low + (high - low) / 3, high - (high - low) / 3
            low, high = (low, second) if at(first) < at(second) else (first, high)
        return at((low + high) / 2)

    return term, energy


def loads(system, _):
    nodes, f = rng.integers(0, N, 4), rng.normal(size=(4, system.dim))
    return system.add_loads(f, nodes=nodes), lambda x: -np.sum(f * x[nodes])


def quartic(points):
    """|x_i - x_j|^4, with second derivatives."""
    d = points[:, 0] - points[:, 1]
    square, dim = (d**2).sum(1), points.shape[2]
    pull = 4 * square[:, None] * d
    block = 8 * d[:, :, None] * d[:, None, :] + 4 * square[:, None, None] * np.eye(dim)
    return square**2, np.stack([pull, -pull], 1), np.block([[block, -block], [-block, block]])


def softened(r, mu):
    """sqrt(1 + (r - mu)^2) - 1."""
    root = np.sqrt(1 + (r - mu) ** 2)
    return root - 1, (r - mu) / root, 1 / root**3


def elements(system, _):
    nodes = pairs()
    return system.add_elements(nodes, quartic, has_hessian=True), lambda x: (((x[nodes[:, 0]] - x[nodes[:, 1]]) ** 2).sum(1) ** 2).sum()


def own_links(system, _):
    nodes, mu, k = pairs(), positive(6), positive(6)
    term = system.add_links(nodes, mu, k, law=softened)
    return term, lambda x: (k * (np.sqrt(1 + (np.linalg.norm(x[nodes[:, 0]] - x[nodes[:, 1]], axis=1) - mu) ** 2) - 1)).sum()


asterism.add_link_law("softened", softened)


def named_links(system, _):
    nodes, mu, k = pairs(), positive(6), positive(6)
    term = system.add_links(nodes, mu, k, law="softened")
    return term, lambda x: (k * (np.sqrt(1 + (np.linalg.norm(x[nodes[:, 0]] - x[nodes[:, 1]], axis=1) - mu) ** 2) - 1)).sum()


WITH_LOSS = {
    "anchors": anchors, "all anchors": all_anchors, "links": plain_links, "offsets": offsets, "differences": differences,
    "second differences": second_differences, "angles": angles, "areas": areas,
    **{f"{kind}, {law}": lengths(kind, law) for kind in ("links", "bendings") for law in ("hooke", "rope", "repulsion", "interval", "logarithm")},
}
KINDS = [(f"{name}, {loss[0]}", add, loss) for name, add in WITH_LOSS.items() for loss in LOSSES.items()]
KINDS += [(f"common_length, {name}", common_length, (name, LOSSES[name])) for name in ("quadratic", "huber")]
KINDS += [("loads", loads, None)]
OWN = [("elements", elements, None), ("links of one's own", own_links, None), ("links of a law with a name", named_links, None)]


def numeric_gradient(energy, x, step=1e-6):
    result = np.zeros_like(x)
    for index in np.ndindex(x.shape):
        moved = x.copy(), x.copy()
        moved[0][index] += step
        moved[1][index] -= step
        result[index] = (energy(moved[0]) - energy(moved[1])) / (2 * step)
    return result


def state(system):
    """All that a system holds, as objects that compare."""
    terms = []
    for term in system.terms:
        columns = {}
        for name in term.columns:
            values = getattr(term, name)
            columns[name] = None if values is None else (values.shape, values.tobytes())
        terms.append((term.kind, term.nodes.shape, term.nodes.tobytes(), columns, {name: getattr(term, name) for name in term.choices}))
    return system.nodes, system.dim, [system.is_fixed(i) for i in range(system.nodes)], terms


def square(loss="quadratic", **parameters):
    """Four anchored corners and their links, with a term's reference."""
    system = asterism.System(4)
    corners = np.array([[0.0, 0], [40, 0], [0, 40], [40, 40]])
    system.add_anchors(corners, 0.1, loss=loss, **parameters)
    links = system.add_links(asterism.Topology.full(4).links, 40, 1)
    return system, corners, links


class FormulaTest(unittest.TestCase):
    def test_energy_and_gradient(self):
        for name, add, loss in KINDS + OWN:
            for dim in (2, 3):
                with self.subTest(name, dim=dim):
                    system = asterism.System(N, dim)
                    term, energy = add(system, loss)
                    x = rng.normal(scale=2, size=(N, dim))
                    self.assertAlmostEqual(system.energy(x), energy(x), delta=1e-9 * (1 + abs(energy(x))))
                    np.testing.assert_allclose(system.gradient(x), numeric_gradient(energy, x), atol=2e-5 * (1 + abs(energy(x))))
                    self.assertIn(term.kind, name.replace("second ", "").replace("all ", ""))
                    self.assertIs(system.terms[0], term)

    def test_other_numbers_of_coordinates(self):
        for dim in (1, 4):
            system = asterism.System(N, dim)
            at = rng.normal(size=(N, dim))
            system.add_anchors(at, positive(N))
            s = semidefinite(6, dim, dim)
            nodes = pairs()
            system.add_offsets(nodes, rng.normal(size=(6, dim)), 1, information=s)
            np.testing.assert_allclose(system.gradient(at), numeric_gradient(system.energy, at), atol=1e-6)
            x = at.copy()
            self.assertEqual(system.solve(x).status, asterism.Status.CONVERGED)

    def test_agrees_with_spring_systems(self):
        for dim in (2, 3):
            springs, x = asterism.random_system("lit", 12, 4, dim)
            springs.loads = rng.normal(size=(12, dim))
            springs.rest_offset = rng.normal(scale=0.1, size=(springs.link_count, dim))
            springs.fix(3)
            system = asterism.System(12, dim)
            system.add_anchors(springs.anchors, springs.anchor_stiffness)
            system.add_links(springs.topology.links, springs.rest_length, springs.link_stiffness, offsets=springs.rest_offset)
            system.add_loads(springs.loads)
            system.fix(3)
            self.assertAlmostEqual(system.energy(x), asterism.energy(springs, x), delta=1e-9 * abs(system.energy(x)))
            np.testing.assert_allclose(system.gradient(x), asterism.gradient(springs, x), atol=1e-9)
            self.assertAlmostEqual(system.stationarity(x), asterism.stationarity(springs, x), delta=1e-9 * system.stationarity(x))
            y = x.copy()
            self.assertEqual(asterism.solve(springs, y, "newton", tolerance=1e-10).status, asterism.Status.CONVERGED)
            z = y + rng.normal(scale=1e-4, size=y.shape)
            z[3] = x[3]
            summary = system.solve(z, "newton", tolerance=1e-10)
            self.assertEqual(summary.status, asterism.Status.CONVERGED, summary)
            np.testing.assert_allclose(z, y, atol=1e-6)
            solution = system.solution(z)
            np.testing.assert_allclose(solution.covariances, asterism.node_covariances(springs, y), atol=1e-6)
            joint = asterism.covariance(springs, y)
            np.testing.assert_allclose(solution.joint_covariance, joint, atol=1e-6)
            np.testing.assert_allclose(solution.covariance(5), joint[5 * dim : 6 * dim, 5 * dim : 6 * dim], atol=1e-6)
            by_x = rng.normal(size=y.shape)
            mine, theirs = solution.gradients(by_x), asterism.sensitivity(springs, y, by_x)
            for found, expected in [
                (mine[0]["position"], theirs.anchors), (mine[0]["stiffness"], theirs.anchor_stiffness),
                (mine[1]["length"], theirs.rest_length), (mine[1]["stiffness"], theirs.link_stiffness),
                (mine[1]["offset"], theirs.rest_offset), (mine[2]["force"], theirs.loads),
            ]:
                np.testing.assert_allclose(found, expected, atol=1e-5 * (1 + np.abs(expected).max()))
            self.assertIsNone(mine[1]["information"])

    def test_log_determinant(self):
        system = asterism.System(3)
        system.add_anchors(np.zeros((3, 2)), [1, 2, 4])
        self.assertAlmostEqual(system.solution(np.zeros((3, 2))).log_determinant, 2 * np.log(8))

    def test_certify(self):
        system, corners, links = square()
        links.remove([2, 3])  # no diagonals
        links.length = 35  # all are drawn out
        x = corners + 1
        system.solve(x, tolerance=1e-10)
        certificate = system.certify(x)
        self.assertTrue(certificate, certificate)
        system.terms[0].scale, system.terms[0].loss = 3, "geman-mcclure"
        links.loss, links.scale = "huber", 1
        self.assertIn("links", system.certify(x).reason)
        self.assertEqual(system.certify(x).lower_bound, 0)  # of all losses
        pulled, _, _ = square()
        pulled.add_loads([1, 0])
        pulled.add_areas([[0, 1, 2]], 3)
        own, _, _ = square()
        own.add_elements([[0, 1]], lambda points: ((points**2).sum((1, 2)) - 1e6, 2 * points))
        for system in (pulled, own):  # whose energies may be below 0
            certificate = system.certify(corners)
            self.assertEqual((certificate.proof, certificate.lower_bound), ("not applicable", -np.inf))

    def test_turning_offsets(self):
        # In the plane, over x and the numbers (a, b) of a similarity, it is linear least squares.
        shape = rng.normal(size=(5, 2))
        turned = 1.5 * shape @ np.array([[0.6, -0.8], [0.8, 0.6]]).T + rng.normal(size=(5, 2)) / 10 + 7
        links = np.array([(i, j) for i in range(5) for j in range(i)])
        offsets = shape[links[:, 0]] - shape[links[:, 1]]
        system = asterism.System(5)
        system.add_anchors(turned, stiffness=0.3)
        system.add_offsets(links, offsets, stiffness=2)
        x = turned.copy()
        summary, transform = system.solve_turning(x)
        self.assertEqual(summary.status, asterism.Status.CONVERGED)
        rows = np.zeros((2 * (5 + len(links)), 12))
        right = np.zeros(len(rows))
        rows[:10, :10] = np.sqrt(0.3) * np.eye(10)
        right[:10] = np.sqrt(0.3) * turned.ravel()
        for row, ((i, j), m) in enumerate(zip(links, offsets), 5):
            for d in range(2):
                rows[2 * row + d, [2 * i + d, 2 * j + d]] = np.sqrt(2) * np.array([1, -1])
                rows[2 * row + d, 10:] = -np.sqrt(2) * np.array([m[d], -m[1] if d == 0 else m[0]])
        best = np.linalg.lstsq(rows, right, rcond=None)[0]
        np.testing.assert_allclose(x, best[:10].reshape(5, 2), atol=1e-6)
        np.testing.assert_allclose(transform, [[best[10], -best[11]], [best[11], best[10]]], atol=1e-6)
        with self.assertRaisesRegex(ValueError, "no link has an offset"):
            asterism.System(2).solve_turning(np.zeros((2, 2)), hold_floating=True)


class TermTest(unittest.TestCase):
    def test_reads_and_assigns(self):
        system = asterism.System(N, 3)
        term = system.add_links(pairs(), positive(6), 2, information=semidefinite(6, 3, 2))
        self.assertEqual((term.kind, len(term), term.nodes.shape, term.law, term.loss), ("links", 6, (6, 2), "hooke", "quadratic"))
        self.assertEqual((term.stiffness.shape, term.length.shape, term.information.shape, term.upper), ((), (6,), (6, 3, 3), None))
        self.assertEqual(set(term.columns) | set(term.choices), {"length", "upper", "stiffness", "offset", "information", "scale", "sharpness", "law", "loss"})
        self.assertLessEqual(set(term.columns), set(dir(term)))
        with self.assertRaisesRegex(ValueError, "read-only"):
            term.length[0] = 3
        x = rng.normal(size=(N, 3))
        before = system.energy(x)
        term.stiffness = 4
        self.assertAlmostEqual(system.energy(x), 2 * before)
        term.stiffness = [4] * 6
        self.assertEqual(term.stiffness.shape, (6,))
        self.assertAlmostEqual(system.energy(x), 2 * before)
        term.information = None
        term.law, term.upper = "interval", 100
        term.length = 0
        self.assertEqual(system.energy(x), 0)
        term.law = softened
        self.assertIs(term.law, softened)
        self.assertGreater(system.energy(x), 0)
        term.law = "hooke"
        self.assertEqual(term.law, "hooke")

    def test_matrices_are_rows(self):
        turn = np.array([[0.0, -1], [1, 0]])
        system = asterism.System(3)
        term = system.add_differences([[0, 1, 2]], coefficients=(turn, 0, -1))
        np.testing.assert_array_equal(term.a, [turn] if term.a.ndim == 3 else turn)
        self.assertEqual(system.energy([[1, 0], [5, 5], [0, 1]]), 0)  # x_2 is x_0 turned by 90 degrees

    def test_estimate(self):
        system = asterism.System(3)
        term = system.add_common_length([[0, 1], [1, 2]], [1, 3], lengths=[0, 1], prior=5, prior_stiffness=2)
        x = [[0, 0], [3, 4], [3, 14]]
        self.assertAlmostEqual(term.estimate(x), (1 * 5 + 3 * (10 - 1) + 2 * 5) / 6)  # a weighted mean
        with self.assertRaisesRegex(TypeError, "links estimate no length"):
            system.add_links([[0, 1]], 1).estimate(x)
        with self.assertRaisesRegex(ValueError, "x: expected shape"):
            term.estimate([[0, 0]])

    def test_append_and_remove(self):
        system = asterism.System(5)
        anchors = system.add_anchors(np.eye(5, 2), 1)
        links = system.add_links([[0, 1]], 3, 2)
        links.append([[1, 2], [3, 4]], length=[4, 5])  # one stiffness, which held for all
        np.testing.assert_array_equal(links.length, [3, 4, 5])
        np.testing.assert_array_equal(np.broadcast_to(links.stiffness, 3), [2, 2, 2])
        anchors.append([2, 2], position=[[7, 8], [9, 10]])
        self.assertEqual((len(anchors), anchors.stiffness.shape), (7, ()))
        links.remove([1])
        np.testing.assert_array_equal(links.nodes, [[0, 1], [3, 4]])
        np.testing.assert_array_equal(links.length, [3, 5])
        other = asterism.System(5)
        other.add_anchors(np.vstack([np.eye(5, 2), [[7, 8], [9, 10]]]), 1, nodes=[0, 1, 2, 3, 4, 2, 2])
        other.add_links([[0, 1], [3, 4]], [3, 5], 2)
        x = rng.normal(size=(5, 2))
        self.assertAlmostEqual(system.energy(x), other.energy(x))
        for call, message in [
            (lambda: links.append([[0, 2]]), "length is missing"),
            (lambda: links.append([[0, 2]], length=1, stifness=2), "have no 'stifness'"),
            (lambda: anchors.append([0], position=[[0, 0]], stiffness=3), "stiffness is the same for all"),
        ]:
            with self.assertRaisesRegex(TypeError, message):
                call()
        for call, message in [
            (lambda: anchors.append([0], position=[[0, np.nan]]), "position: expected finite numbers, found nan"),
            (lambda: anchors.append([9], position=[[0, 0]]), "nodes: node 9 of element 0 is out of range"),
            (lambda: links.append([[2, 2]], length=[1], stiffness=[1]), "one node twice"),
        ]:
            with self.assertRaisesRegex(ValueError, message):
                call()
        self.assertEqual((len(links), len(anchors)), (2, 7))
        with self.assertRaises(IndexError):
            links.remove([2])
        limbs = system.add_common_length([[0, 1]], 2, prior=3, prior_stiffness=0.5)
        limbs.append([[2, 3]])  # there is one prior for all
        self.assertAlmostEqual(limbs.estimate(x), other.add_common_length([[0, 1], [2, 3]], 2, prior=3, prior_stiffness=0.5).estimate(x))

    def test_append_after_the_last_element(self):
        for count in (1, 3):
            system = asterism.System(5)
            links = system.add_links([[0, 1], [1, 2], [2, 3]][:count], [3, 4, 5][:count], 2)
            anchors = system.add_anchors(np.eye(5, 2)[:count], 1, information=np.tile(np.eye(2), (count, 1, 1)), nodes=range(count))
            for term in links, anchors:
                term.remove(range(count))
                self.assertEqual(len(term), 0)
            with self.assertRaisesRegex(ValueError, "length: expected finite numbers >= 0, found nan"):
                links.append([[0, 4]], length=np.nan)
            links.append([[0, 4], [1, 4]], length=[6, 7])
            anchors.append([1, 2], position=[[1, 2], [3, 4]], information=[[[2, 0], [0, 3]], [[4, 0], [0, 5]]])
            other = asterism.System(5)
            other.add_links([[0, 4], [1, 4]], [6, 7], 2)
            other.add_anchors([[1, 2], [3, 4]], 1, information=[[[2, 0], [0, 3]], [[4, 0], [0, 5]]], nodes=[1, 2])
            x = rng.normal(size=(5, 2))
            self.assertEqual(system.energy(x), other.energy(x))
            links.append([[2, 3]], length=8)
            self.assertEqual((links.length.tolist(), len(links)), ([6, 7, 8], 3))
        with self.assertRaisesRegex(TypeError, "length is missing"):
            links.remove(range(3))
            links.append([[2, 3]])

    def test_nodes_and_terms_come_and_go(self):
        system, corners, links = square()
        anchors = system.terms[0]
        system.add_nodes(1)
        extra = system.add_anchors([[20, 20]], 1, nodes=[4])
        system.fix(4)
        system.remove_nodes([0])
        self.assertEqual((system.nodes, len(anchors), len(links), extra.nodes.tolist()), (4, 3, 3, [[3]]))
        self.assertTrue(system.is_fixed(3))
        system.unfix(3)
        self.assertFalse(system.is_fixed(3))
        system.remove(anchors)
        self.assertEqual([term.kind for term in system.terms], ["links", "anchors"])
        for use in (lambda: anchors.stiffness, lambda: len(anchors), lambda: setattr(anchors, "stiffness", 1)):
            with self.assertRaisesRegex(RuntimeError, "removed"):
                use()
        with self.assertRaisesRegex(ValueError, "not one of this system"):
            system.remove(anchors)
        term = asterism.System(2).add_links([[0, 1]], 1)  # keeps its system alive
        self.assertEqual(term.length, 1)
        with self.assertRaises(ValueError):
            system.remove(term)
        for index in (-1, 4):
            for call in (system.fix, system.unfix, system.is_fixed):
                self.assertRaises(IndexError, call, index)

    def test_repr(self):
        system, _, links = square("huber", scale=3)
        self.assertEqual(repr(system), "<asterism.System: 4 nodes, dim 2; 4 anchors, loss huber; 6 links>")
        self.assertEqual(repr(links), "<asterism.Term: 6 links>")


class SolveTest(unittest.TestCase):
    def test_methods(self):
        expected = None
        for method in asterism.System.methods():
            system, corners, _ = square()
            x = corners + [[1, 0], [0, -2], [3, 0], [0, 1]]
            summary = system.solve(x, method, tolerance=1e-9)
            self.assertIsInstance(summary, asterism.Summary)
            self.assertEqual(summary.status, asterism.Status.CONVERGED, method)
            expected = x if expected is None else expected
            np.testing.assert_allclose(x, expected, atol=1e-5)
        self.assertLess(np.linalg.norm(system.gradient(x)), 1e-5)

    def test_options_and_on_iteration(self):
        system, corners, _ = square()
        seen = []
        x = corners + 1.0
        summary = system.solve(x, "lbfgs", on_iteration=lambda *at: seen.append(at), max_iterations=3)
        self.assertEqual([at[0] for at in seen], list(range(len(seen))))
        self.assertAlmostEqual(seen[0][2], system.energy(seen[0][1]))
        self.assertLessEqual(summary.iterations, 3)
        before = corners + [[3.0, 1], [0, 0], [0, 0], [0, 0]]
        x = before.copy()
        with self.assertRaises(ZeroDivisionError):
            system.solve(x, on_iteration=lambda *at: 1 / 0)
        np.testing.assert_array_equal(x, before)
        with self.assertRaisesRegex(TypeError, "no option 'tolerence'"):
            system.solve(x, tolerence=1)
        with self.assertRaisesRegex(ValueError, "did you mean 'newton'"):
            system.solve(x, "newtn")
        self.assertEqual(system.solve(x, tolerance=-1.0, check=False).status, asterism.Status.INVALID_INPUT)
        np.testing.assert_array_equal(x, before)

    def test_bad_x(self):
        system, corners, _ = square()
        for x, error in [(corners.tolist(), TypeError), (corners[:3].copy(), ValueError), (corners.astype("f4"), TypeError), (np.asfortranarray(corners), ValueError)]:
            self.assertRaises(error, system.solve, x)
        for call in (system.energy, system.gradient, system.stationarity, system.certify, system.solution):
            self.assertRaisesRegex(ValueError, "x: expected shape", call, corners[:3])
            self.assertRaisesRegex(TypeError, "x: expected numbers, found masked", call, np.ma.masked_less(corners, 1))
        nan = corners * np.nan
        for call in (system.energy, system.gradient, system.stationarity, system.solution):
            self.assertRaisesRegex(ValueError, "x of node 0 is not finite", call, nan)
        self.assertEqual(system.solve(nan, check=False).status, asterism.Status.INVALID_INPUT)
        self.assertEqual(system.certify(corners * np.nan).proof, "not applicable")

    def test_no_solution(self):
        system = asterism.System(2)
        system.add_links([[0, 1]], 1)
        with self.assertRaisesRegex(np.linalg.LinAlgError, "not positive definite"):
            system.solution([[0, 0], [1, 0]])
        # Where a link pushes nodes apart that coincide, the Hessian alone would be positive definite.
        for kwargs in ({}, {"loss": "huber", "scale": 1}, {"law": "repulsion"}, {"law": "interval", "upper": 2}):
            held = asterism.System(2)
            held.add_links([[0, 1]], 1, **kwargs)
            held.add_anchors(np.zeros((2, 2)))
            with self.subTest(kwargs), self.assertRaisesRegex(np.linalg.LinAlgError, "pushes nodes 0 and 1 apart"):
                held.solution(np.zeros((2, 2)))
        held = asterism.System(2)
        held.add_links([[0, 1]], 0)  # a length of 0 pushes nothing
        held.add_anchors(np.zeros((2, 2)))
        self.assertAlmostEqual(held.solution(np.zeros((2, 2))).covariance(0)[0, 0], 2 / 3)
        system.add_elements([[0, 1]], lambda p: (np.zeros(1), np.zeros((1, 2, 2))))
        with self.assertRaisesRegex(ValueError, "elements: the user's function gives no second derivatives"):
            system.solution([[0, 0], [1, 0]])


class FunctionTest(unittest.TestCase):
    def test_solves(self):
        for add in (elements, own_links):
            system = asterism.System(N)
            system.add_anchors(rng.normal(size=(N, 2)), 0.5)
            add(system, None)
            for method in ("auto", "newton", "newton-cg", "lbfgs"):
                x = np.zeros((N, 2)) + rng.normal(scale=0.1, size=(N, 2))
                summary = system.solve(x, method)
                self.assertEqual(summary.status, asterism.Status.CONVERGED, (add, method))
                self.assertLess(np.linalg.norm(numeric_gradient(system.energy, x)), 1e-5)
            self.assertEqual(system.solution(x).covariances.shape, (N, 2, 2))

    def test_without_hessian(self):
        system = asterism.System(2)
        system.add_anchors([[0, 0], [3, 0]], 1)
        system.add_elements([[0, 1]], lambda points: quartic(points)[:2])
        x = np.array([[0.0, 0], [3, 0]])
        self.assertEqual(system.solve(x).status, asterism.Status.CONVERGED)
        summary = system.solve(x, "newton", check=False)
        self.assertEqual(summary.status, asterism.Status.INVALID_INPUT)
        self.assertIn("elements", summary.message)

    def test_what_it_raises(self):
        for kind in ("elements", "law"):
            for bad, error, message in [
                (lambda *a: 1 / 0, ZeroDivisionError, "division"),
                (lambda *a: None, TypeError, "expected that it returns .*, found NoneType"),
                (lambda *a: (np.zeros(1),), TypeError, "expected that it returns"),
                (lambda *a: (np.zeros(2), np.zeros(5), np.zeros(7)), ValueError, "expected shape"),
                (lambda *a: (np.zeros(1) + 1j, np.zeros((1, 2, 2)), np.zeros(1)), TypeError, "expected numbers, found complex"),
                (lambda *a: (np.ma.masked_all(1), np.zeros((1, 2, 2)), np.zeros(1)), TypeError, "found masked"),
            ]:
                system = asterism.System(2)
                system.add_anchors([[0, 0], [3, 0]], 1)
                if kind == "elements":
                    system.add_elements([[0, 1]], bad, has_hessian=True)
                else:
                    system.add_links([[0, 1]], 1, law=bad)
                x = np.array([[0.5, 0], [2, 0]])
                for call in (system.solve, system.energy, system.gradient, system.solution):
                    with self.subTest(kind=kind, message=message), self.assertRaisesRegex(error, message):
                        call(x)
                np.testing.assert_array_equal(x, [[0.5, 0], [2, 0]])

    def test_raises_in_the_middle(self):
        calls = []

        def law(r, mu):
            calls.append(1)
            if len(calls) > 3:
                raise KeyError("enough")
            return softened(r, mu)

        system = asterism.System(3)
        system.add_anchors(np.array([[0, 0], [9, 0], [0, 9]]), 0.1)
        system.add_links([[0, 1], [0, 2], [1, 2]], 2, law=law)
        before = np.array([[0.0, 0], [9, 0], [0, 9]])
        x = before.copy()
        with self.assertRaisesRegex(KeyError, "enough"):
            system.solve(x)
        np.testing.assert_array_equal(x, before)

    def test_the_system_cannot_be_changed_meanwhile(self):
        system, corners, links = square()
        errors = []

        def change(*_):
            for attempt in (
                lambda: system.fix(0), lambda: system.unfix(0), lambda: system.add_nodes(1), lambda: system.remove_nodes([0]),
                lambda: system.remove(links), lambda: system.add_loads(np.zeros((4, 2))), lambda: links.remove([0]),
                lambda: setattr(links, "stiffness", 3), lambda: setattr(links, "loss", "huber"), lambda: setattr(links, "law", softened),
                lambda: links.append([[0, 1]], length=[1]),
            ):
                try:
                    attempt()
                except RuntimeError as error:
                    errors.append(str(error))

        before = state(system)
        system.solve(corners + 1.0, on_iteration=change)
        self.assertGreaterEqual(len(errors), 11)
        self.assertEqual(len(errors) % 11, 0)
        self.assertEqual(set(errors), {"this asterism.System is in use: it cannot be changed while it is solved or evaluated"})
        self.assertEqual(state(system), before)

        def law(r, mu):
            change()
            return softened(r, mu)

        links.law = law
        errors.clear()
        system.energy(corners)
        self.assertEqual(len(errors), 11)
        seen, inside = [], threading.Event()

        def wait(r, mu):
            inside.set()
            time.sleep(0.2)
            return softened(r, mu)

        links.law = wait
        thread = threading.Thread(target=system.energy, args=(corners,))
        thread.start()
        inside.wait()
        with self.assertRaisesRegex(RuntimeError, "in use"):
            links.stiffness = 2
        thread.join()
        links.stiffness = 2

    def test_interrupt(self):
        def handler(*_):
            raise KeyboardInterrupt

        previous = signal.signal(signal.SIGALRM, handler)
        self.addCleanup(signal.signal, signal.SIGALRM, previous)
        springs, start = asterism.random_system("lit", 300, 1)
        plain = asterism.System(300)
        plain.add_anchors(springs.anchors, 1e-6)
        plain.add_links(springs.topology.links, springs.rest_length, springs.link_stiffness)
        own = plain.copy()
        own.add_elements([[0, 1]], lambda points: quartic(points)[:2])
        for system, method in ((plain, "multi-start"), (own, "lbfgs")):
            options = {"starts": 100000} if method == "multi-start" else {"max_iterations": 10**8, "tolerance": 0.0}
            x = start.copy()
            slow = (lambda *_: time.sleep(0.001)) if method == "lbfgs" else None
            signal.setitimer(signal.ITIMER_REAL, 0.1)
            with self.subTest(method), self.assertRaises(KeyboardInterrupt):
                for _ in range(1000):  # a solve may end before
                    system.solve(x, method, on_iteration=slow, **options)
                    x[:] = start
            signal.setitimer(signal.ITIMER_REAL, 0)
            np.testing.assert_array_equal(x, start)


def everything(dim=2):
    """A system with a term of every kind that can be stored."""
    system = asterism.System(N, dim)
    for _, add, loss in KINDS:
        add(system, loss)
    system.fix(2)
    system.terms[0].stiffness = 0.25  # the same for all
    system.add_loads(np.zeros((0, dim)), nodes=[])
    return system


class Mine(asterism.System):
    """A class of a user's own."""


class CopyTest(unittest.TestCase):
    COPIES = {
        "copy": copy.copy, "deepcopy": copy.deepcopy, ".copy()": lambda value: value.copy(),
        **{f"pickle {p}": lambda value, p=p: pickle.loads(pickle.dumps(value, p)) for p in range(pickle.HIGHEST_PROTOCOL + 1)},
    }

    def test_copies(self):
        for dim in (1, 2, 3):
            system = everything(dim) if dim > 1 else asterism.System(N, 1)
            if dim == 1:
                anchors(system, ("huber", {"scale": 2}))
            else:
                for _, add, loss in OWN:
                    add(system, loss)
            x = rng.normal(size=(N, dim))
            for name, make in self.COPIES.items():
                with self.subTest(name, dim=dim):
                    other = make(system)
                    self.assertEqual(state(other), state(system))
                    self.assertEqual(other.energy(x), system.energy(x))
                    other.terms[0].stiffness = 9
                    other.fix(0)
                    self.assertNotEqual(state(other), state(system))

    def test_subclass(self):
        self.assertIs(type(Mine(3).copy()), Mine)

    def test_functions_that_cannot_be_pickled(self):
        system, corners, links = square()
        links.law = lambda r, mu: softened(r, mu)
        self.assertEqual(system.copy().energy(corners + 1), system.energy(corners + 1))
        self.assertIs(copy.deepcopy(system).terms[1].law, links.law)
        for protocol in range(pickle.HIGHEST_PROTOCOL + 1):
            with self.assertRaisesRegex(TypeError, "its function <function .*lambda.* cannot be pickled"):
                pickle.dumps(system, protocol)

    def test_no_values(self):
        for made in (asterism.System.__new__(asterism.System), asterism.Term.__new__(asterism.Term), asterism.Solution.__new__(asterism.Solution)):
            with self.assertRaises(TypeError):
                repr(made)
        system, corners, links = square()
        for value in (links, system.solution(corners)):
            for protocol in range(pickle.HIGHEST_PROTOCOL + 1):
                with self.assertRaisesRegex(TypeError, "cannot pickle"):
                    pickle.dumps(value, protocol)

    def test_damaged_state(self):
        system, _, _ = square()
        good = system.__getstate__()
        kind, nodes, columns, choices, function, flag = good[2][0]
        for bad in [
            (), (2,), (40, good[1], good[2]), (2, np.zeros(4), []), (2, good[1], [1]), (2, good[1], [(kind, nodes)]),
            *((2, good[1], [term]) for term in [
                ("anchrs", nodes, columns, choices, None, False), (kind, nodes + 1, columns, choices, None, False),
                (kind, np.zeros((4, 2), int), columns, choices, None, False), (kind, nodes, {}, choices, None, False),
                (kind, nodes, {**columns, "position": np.zeros((3, 2))}, choices, None, False),
                (kind, nodes, {**columns, "position": np.zeros((4, 3))}, choices, None, False),
                (kind, nodes, columns, {"loss": "none"}, None, False), (kind, nodes, columns, choices, 3, False),
                ("elements", nodes, columns, choices, None, False),
            ]),
        ]:
            with self.subTest(bad), self.assertRaises((ValueError, TypeError, RuntimeError, KeyError)):
                asterism.System.__new__(asterism.System).__setstate__(bad)


PAIRS, TRIPLES, POINTS = [[0, 1], [1, 2]], [[0, 1, 2]], np.zeros((4, 2))
BAD = [
    # method, positional, keywords, error, message
    ("add_anchors", [POINTS[:3]], {}, ValueError, r"positions: expected shape \(2,\) or \(4, 2\), found \(3, 2\)"),
    ("add_anchors", [POINTS * np.nan], {}, ValueError, "positions: expected finite numbers, found nan for element 0"),
    ("add_anchors", [POINTS, -1], {}, ValueError, "stiffness: expected finite numbers >= 0, found -1"),
    ("add_anchors", [POINTS, [1, 2, 3, np.inf]], {}, ValueError, "stiffness: .* found inf for element 3"),
    ("add_anchors", [POINTS, "stiff"], {}, TypeError, "stiffness: expected numbers, found <U5"),
    ("add_anchors", [POINTS, None], {}, TypeError, "stiffness: expected numbers, found NoneType"),
    ("add_anchors", [POINTS, 1j], {}, TypeError, "stiffness: expected numbers, found complex"),
    ("add_anchors", [np.ma.masked_equal(POINTS, 0)], {}, TypeError, "positions: expected numbers, found masked"),
    ("add_anchors", [POINTS[:1]], {"nodes": [4]}, ValueError, "nodes: node 4 of element 0 is out of range"),
    ("add_anchors", [POINTS[:1]], {"nodes": [-1]}, ValueError, "nodes: node -1 "),
    ("add_anchors", [POINTS[:1]], {"nodes": [0.0]}, TypeError, "nodes: expected integers, found float64"),
    ("add_anchors", [POINTS[:1]], {"nodes": np.ma.masked_equal([0], 0)}, TypeError, "nodes: expected numbers, found masked"),
    ("add_anchors", [POINTS], {"information": np.eye(3)}, ValueError, r"information: expected shape \(2, 2\) or \(4, 2, 2\), found \(3, 3\)"),
    ("add_anchors", [POINTS], {"information": [[1, 2], [2, 1]]}, ValueError, "information .*not symmetric and positive semi-definite"),
    ("add_anchors", [POINTS], {"loss": "hubr", "scale": 1}, ValueError, "unknown loss 'hubr', did you mean 'huber'"),
    ("add_anchors", [POINTS], {"loss": "huber"}, ValueError, "needs a scale"),
    ("add_anchors", [POINTS], {"loss": "huber", "scale": 0}, ValueError, "scale: expected finite numbers > 0, found 0.0"),
    ("add_links", [[[0, 1, 2]], 1], {}, ValueError, r"pairs: expected shape \(count, 2\), found \(1, 3\)"),
    ("add_links", [[[0, 0]], 1], {}, ValueError, "one node twice"),
    ("add_links", [[[0, 9]], 1], {}, ValueError, "pairs: node 9 of element 0 is out of range"),
    ("add_links", [[[0, 2**40]], 1], {}, ValueError, "pairs: node 1099511627776 "),
    ("add_links", [PAIRS, -1], {}, ValueError, "lengths: expected finite numbers >= 0"),
    ("add_links", [PAIRS, [1]], {}, ValueError, r"lengths: expected shape \(\) or \(2,\), found \(1,\)"),
    ("add_links", [PAIRS, 1], {"law": "hook"}, ValueError, "unknown law 'hook', did you mean 'hooke'"),
    ("add_links", [PAIRS, 1], {"law": 3}, TypeError, "law: expected a name or a function, found int"),
    ("add_links", [PAIRS, 1], {"law": "own"}, ValueError, "the law own needs a function, and the user gave none"),
    ("add_links", [PAIRS, 1], {"law": softened, "loss": "huber", "scale": 1}, ValueError, "cannot have a loss"),
    ("add_links", [PAIRS, 1], {"law": "interval"}, ValueError, "needs upper lengths"),
    ("add_links", [PAIRS, 2], {"law": "interval", "upper": 1}, ValueError, "upper length is less"),
    ("add_links", [PAIRS, 0], {"law": "logarithm"}, ValueError, "positive length"),
    ("add_offsets", [PAIRS, [1, 2, 3]], {}, ValueError, "offsets: expected shape"),
    ("add_bendings", [PAIRS, 1], {}, ValueError, "triples: expected shape"),
    ("add_differences", [TRIPLES], {"coefficients": (1, 2)}, ValueError, "coefficients: expected three"),
    ("add_differences", [TRIPLES], {"coefficients": (1, [1, 2], 1)}, ValueError, r"coefficients\[1\]: expected shape"),
    ("add_differences", [TRIPLES], {"target": "zero"}, TypeError, "target: expected numbers"),
    ("add_angles", [TRIPLES, np.nan], {}, ValueError, "angles: expected finite numbers, found nan"),
    ("add_angles", [TRIPLES, 90], {}, ValueError, "angles: expected radians, from 0 to pi, found 90.0"),
    ("add_areas", [TRIPLES, [1, 2]], {}, ValueError, "areas: expected shape"),
    ("add_loads", [POINTS + np.inf], {}, ValueError, "forces: expected finite numbers, found inf"),
    ("add_common_length", [PAIRS], {"prior_stiffness": -1}, ValueError, "prior_stiffness: expected finite numbers >= 0"),
    ("add_common_length", [PAIRS], {"loss": "truncated", "scale": 1}, ValueError, "must be quadratic or huber"),
    ("add_elements", [PAIRS, 3], {}, TypeError, "function: expected a function, found int"),
    ("add_elements", [[0, 1], quartic], {}, ValueError, r"nodes: expected shape \(count, nodes of each\), found \(2,\)"),
    ("add_nodes", [-1], {}, ValueError, "count: -1"),
    ("remove_nodes", [[4]], {}, ValueError, "nodes: node 4"),
]


class InputTest(unittest.TestCase):
    def test_bad_input(self):
        for method, positional, keywords, error, message in BAD:
            with self.subTest(method, message=message):
                system, _, _ = square()
                before = state(system)
                with self.assertRaisesRegex(error, message):
                    getattr(system, method)(*positional, **keywords)
                self.assertEqual(state(system), before)

    def test_bad_assignments(self):
        system, _, links = square()
        before = state(system)
        for name, value, error, message in [
            ("stiffness", [1, 2], ValueError, r"stiffness: expected shape \(\) or \(6,\), found \(2,\)"),
            ("stiffness", np.nan, ValueError, "stiffness: expected finite numbers >= 0, found nan"),
            ("stiffness", None, TypeError, "stiffness: expected numbers, found NoneType"),
            ("length", np.ma.masked_all(6), TypeError, "length: expected numbers, found masked"),
            ("stifness", 1, AttributeError, "links have no 'stifness'"),
            ("kind", "anchors", AttributeError, "links have no 'kind' that can be assigned"),
            ("loss", "hubr", ValueError, "did you mean 'huber'"),
            ("loss", 3, TypeError, "loss: expected a name, found int"),
            ("law", "own", ValueError, "law: expected your function itself"),
        ]:
            with self.subTest(name, value=value), self.assertRaisesRegex(error, message):
                setattr(links, name, value)
        with self.assertRaisesRegex(AttributeError, "links have no 'stifness'"):
            links.stifness
        self.assertEqual(state(system), before)
        for arguments in [(-1,), (3, 0), (3, 65)]:
            self.assertRaises(ValueError, asterism.System, *arguments)
        self.assertRaises(TypeError, asterism.System, 2.5)

    def test_kinds_of_arrays(self):
        values = np.array([[3, 1], [4, 1], [5, 9], [2, 6]])
        for made in (values.tolist(), values.astype("i2"), values.astype("f4"), np.asfortranarray(values), np.ma.array(values), np.asmatrix(values), values[::-1][::-1]):
            system = asterism.System(4)
            np.testing.assert_array_equal(system.add_anchors(made).position, values)
        self.assertEqual(asterism.System(4).add_links(np.array(PAIRS, "u1"), 1).nodes.tolist(), PAIRS)


@unittest.skipUnless(hasattr(asterism, "read_systems"), "built without nlohmann-json")
class FileTest(unittest.TestCase):
    def test_round_trip(self):
        springs, x = asterism.random_system("lit", 5, 1)
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "systems.jsonl"
            stored = [asterism.StoredSystem(everything(dim), rng.normal(size=(N, dim)), f"of {dim}", {"frame": dim}) for dim in (2, 3)]
            stored.insert(1, asterism.StoredSystem(springs, x))
            asterism.write_systems(path, stored)
            found = asterism.read_systems(path)
        self.assertEqual([type(each.system) for each in found], [asterism.System, asterism.SpringSystem, asterism.System])
        for a, b in zip(stored, found):
            self.assertEqual((a.start.tobytes(), a.name, a.origin), (b.start.tobytes(), b.name, b.origin))
            if isinstance(a.system, asterism.System):
                self.assertEqual(state(a.system), state(b.system))
                b.system.terms[0].stiffness = 2  # what was read can be changed
                b.system.add_loads(np.zeros((N, b.system.dim)))

    def test_law_with_a_name(self):
        system, corners, links = square()
        links.law = "softened"
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "systems.jsonl"
            asterism.write_systems(path, [asterism.StoredSystem(system, corners)])
            (found,) = asterism.read_systems(path)
        self.assertEqual((found.system.terms[1].law, found.system.energy(corners)), ("softened", system.energy(corners)))
        with self.assertRaisesRegex(ValueError, "law of links 'rope' already"):
            asterism.add_link_law("rope", softened)
        with self.assertRaises(TypeError):
            asterism.add_link_law("another", 3)

    def test_refused(self):
        system, corners, links = square()
        links.law = softened
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "systems.jsonl"
            with self.assertRaisesRegex(ValueError, "cannot be written: links: the law is the user's function, which is stored only by a name"):
                asterism.write_systems(path, [asterism.StoredSystem(system, corners)])
            links.law = "hooke"
            system.add_elements([[0, 1]], quartic)
            with self.assertRaisesRegex(ValueError, "cannot be written: elements: a term whose energy is the user's function"):
                asterism.write_systems(path, [asterism.StoredSystem(system, corners)])
            with self.assertRaisesRegex(TypeError, "expected a SpringSystem or a System, found int"):
                asterism.write_systems(path, [asterism.StoredSystem(3, corners)])
            self.assertFalse(path.exists())
    @unittest.skipIf(jsonschema is None, "needs jsonschema (Debian package python3-jsonschema)")
    def test_the_schema_takes_what_the_reader_takes(self):
        """Every column and choice of every kind, as the terms list them; and wrong types and names of each."""
        page = (Path(__file__).parents[2] / "docs" / "system-json.md").read_text()
        blocks = [block[: block.index("\n```")] for block in page.split("```json\n")[1:]]
        (schema,) = [block for block in map(json.loads, blocks) if block.get("title") == "Asterism system of terms"]
        of_terms = schema["$defs"]["term"]
        (pattern,) = of_terms["patternProperties"]
        validator = jsonschema.Draft202012Validator(schema)

        def verdicts(stored):
            try:
                is_read = bool(asterism.parse_systems(json.dumps(stored)))
            except ValueError:
                is_read = False
            return is_read, validator.is_valid(stored)

        eye, robust = np.eye(2), {"loss": "truncated", "scale": 2.0, "sharpness": 3.0}
        lengths = {"law": "interval", "upper": 3.0, "offsets": [1.0, 0.0], "information": eye, **robust}
        differences = {"target": [1.0, 2.0], "coefficients": (1, eye, -1), "information": eye, **robust}
        system = asterism.System(3)
        system.add_anchors([[0, 0], [1, 0], [0, 1]], information=eye, **robust)
        system.add_links([[0, 1]], 2, **lengths)
        system.add_bendings([[0, 1, 2]], 2, **lengths)
        system.add_offsets([[0, 1]], [1.0, 0.0], information=eye, **robust)
        system.add_differences([[0, 1, 2]], **differences)
        system.add_angles([[0, 1, 2]], 1, **robust)
        system.add_areas([[0, 1, 2]], 1, **robust)
        system.add_common_length([[0, 1]], loss="huber", scale=1.0)
        system.add_loads([[0, 0], [1, 0], [0, 1]])
        kinds = [term.kind for term in system.terms]
        self.assertEqual(sorted(kinds), sorted(of_terms["properties"]["kind"]["enum"]))
        unknown = {"asterism_system": 2, "dim": 1, "nodes": 1, "start": [[0]], "terms": [{"kind": "?", "nodes": []}]}
        with self.assertRaises(ValueError) as refused:  # names all that it knows
            asterism.parse_systems(json.dumps(unknown))
        self.assertEqual(sorted(str(refused.exception).split("known: ")[1].rstrip(")").split()), sorted(kinds))
        with tempfile.TemporaryDirectory() as folder:
            asterism.write_systems(Path(folder) / "all.jsonl", [asterism.StoredSystem(system, np.zeros((3, 2)))])
            stored = json.loads((Path(folder) / "all.jsonl").read_text())
        self.assertEqual(verdicts(stored), (True, True))
        names = set()
        for t, term in enumerate(system.terms):
            written = stored["terms"][t]
            sharpness = {"sharpness"} if term.kind == "common_length" else set()
            self.assertEqual(set(written) | sharpness, {"kind", "nodes", *term.columns, *term.choices})
            names |= set(term.columns)
            for key in written:
                wrongs = [None, True, {}, "1", [["1"]], [None]] if key not in ("kind", "loss", "law") else [None, True, {}, 1, []]
                for wrong in wrongs:
                    with self.subTest(term.kind, key=key, wrong=wrong):
                        spoilt = copy.deepcopy(stored)
                        spoilt["terms"][t][key] = wrong
                        self.assertEqual(verdicts(spoilt), (False, False))
                with self.subTest(term.kind, misspelt=key):
                    spoilt = copy.deepcopy(stored)
                    spoilt["terms"][t][key + "s"] = spoilt["terms"][t].pop(key)
                    self.assertEqual(verdicts(spoilt), (False, False))
        self.assertEqual(pattern, "^(" + "|".join(sorted(names, key=pattern[2:-2].split("|").index)) + ")$")

    def test_names_the_place_of_what_is_wrong(self):
        text = '{"asterism_system": 2, "dim": 2, "nodes": 1, "start": [[0, 0]], "terms": [{"kind": "anchors", "nodes": [1]}]}'
        with self.assertRaisesRegex(ValueError, r"^text:1: terms\[0\]: nodes\[0\] is out of range$"):
            asterism.parse_systems(text)


if __name__ == "__main__":
    unittest.main()
