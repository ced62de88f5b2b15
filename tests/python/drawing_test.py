#!/usr/bin/env python3
"""layout's method for large graphs, against the stress of all pairs by SciPy's shortest paths."""

import pickle
import unittest

import asterism
import numpy as np
import scipy.sparse
import scipy.sparse.csgraph


def grid(rows, columns):
    at = np.arange(rows * columns).reshape(rows, columns)
    down, right = (at[:-1], at[1:]), (at[:, :-1], at[:, 1:])
    return [(int(i), int(j)) for a, b in (down, right) for i, j in zip(a.ravel(), b.ravel())]


def tree(n, seed):
    random = np.random.default_rng(seed)
    return [(k, int(random.integers(k))) for k in range(1, n)]


def preferential(n, seed):
    """Two edges a node, to ends of edges (Barabasi and Albert 1999)."""
    random = np.random.default_rng(seed)
    ends, edges = [0, 1], [(0, 1)]
    for k in range(2, n):
        for j in {ends[random.integers(len(ends))] for _ in range(2)}:
            edges.append((k, j))
            ends += [k, j]
    return edges


def matrix(edges):
    i, j = np.array([edge[:2] for edge in edges]).T
    lengths = [edge[2] if len(edge) == 3 else 1.0 for edge in edges]
    n = max(i.max(), j.max()) + 1
    return scipy.sparse.csr_matrix((lengths, (i, j)), shape=(n, n))


def stress(edges, x):
    """Of all pairs that a path joins."""
    d = scipy.sparse.csgraph.shortest_path(matrix(edges), directed=False)
    i, j = np.triu_indices(len(x), 1)
    known = np.isfinite(d[i, j])
    i, j = i[known], j[known]
    return float(np.sum((1 - np.linalg.norm(x[i] - x[j], axis=1) / d[i, j]) ** 2))


def moved(x, onto):
    """How far the nodes are from others, root of the mean square, after x is moved and turned onto them."""
    a, b = x - x.mean(axis=0), onto - onto.mean(axis=0)
    u, _, v = np.linalg.svd(a.T @ b)
    return float(np.sqrt(np.mean(np.sum((a @ u @ v - b) ** 2, axis=1))))


class StressTest(unittest.TestCase):
    def test_hardly_more_than_that_of_all_pairs(self):
        random = np.random.default_rng(2)
        weighted = [(i, j, float(random.uniform(0.5, 2))) for i, j in grid(18, 20)]
        graphs = {"grid": grid(18, 20), "tree": tree(350, 1), "preferential": preferential(350, 1), "lengths": weighted}
        for name, edges in graphs.items():
            for dim in (2, 3):
                with self.subTest(name, dim=dim):
                    full = asterism.layout(edges, dim, method="multi-start", starts=1)
                    ours = asterism.layout(edges, dim, method="sgd")
                    self.assertEqual(ours.x.shape, full.x.shape)
                    self.assertLess(stress(edges, ours.x), 1.06 * stress(edges, full.x))
                    self.assertAlmostEqual(ours.stress / stress(edges, ours.x), 1, delta=0.1)  # an estimate

    def test_is_the_default_for_large_graphs_alone(self):
        for n, is_large in ((1000, False), (1001, True)):
            result = asterism.layout([(k, k + 1) for k in range(n - 1)])
            self.assertEqual(result.summary.solver == "sgd", is_large)
            self.assertEqual(result.system is None and result.certificate is None, is_large)
            self.assertTrue(result)
            self.assertLess(result.stress, 0.1 * n)
            again = pickle.loads(pickle.dumps(result))
            np.testing.assert_array_equal(again.x, result.x)

    def test_exact_drawings(self):
        """Graphs whose distances are those of points: the stress is nearly 0, and sides are equal."""
        for edges, distances in (
            ([(0, 1, 3.0)], {3.0}),
            ([(0, 1), (1, 2), (2, 0)], {1.0}),
            ([(0, 1, 1e-100), (1, 2, 1e-100), (2, 0, 1e-100)], {1e-100}),
            ([(0, 1, 1e100), (1, 2, 1e100), (2, 0, 1e100)], {1e100}),
        ):
            with self.subTest(edges):
                x = asterism.layout(edges, method="sgd").x
                (d,) = distances
                for i, j, *_ in edges:
                    self.assertAlmostEqual(np.linalg.norm(x[i] - x[j]) / d, 1, 2)

    def test_sampled_weights_are_those_of_all_pairs(self):
        """The estimated stress of drawings with all nodes in one place is the number of pairs."""
        n, pairs = 1500, 1500 * 1499 / 2
        edges = preferential(n, 3)
        held = asterism.layout(edges, anchors=np.zeros((n, 2)), anchor_weights=np.inf)
        np.testing.assert_array_equal(held.x, 0)
        self.assertAlmostEqual(held.stress / pairs, 1, delta=0.05)

    def test_power(self):
        edges = grid(15, 15)
        for power in (1, 2.5):
            full = asterism.layout(edges, power=power, method="multi-start", starts=1)
            ours = asterism.layout(edges, power=power, method="sgd")
            of = [asterism.layout_stress(edges, each.x, power=power) for each in (full, ours)]
            self.assertLess(of[1], 1.05 * of[0])


class RulesTest(unittest.TestCase):
    def test_result_depends_on_the_seed_alone(self):
        edges = preferential(1200, 4)
        one = asterism.layout(edges, threads=1).x
        for threads in (0, 2, 3):
            np.testing.assert_array_equal(asterism.layout(edges, threads=threads).x, one)
        self.assertGreater(moved(asterism.layout(edges, seed=2).x, one), 1e-3)

    def test_a_start_is_kept_nearly(self):
        edges = grid(40, 40)
        first = asterism.layout(edges)
        size = np.ptp(first.x, axis=0).max()
        same = asterism.layout(edges, start=first.x)
        self.assertLess(np.abs(same.x - first.x).max(), 0.03 * size)
        self.assertLessEqual(stress(edges, same.x), 1.02 * stress(edges, first.x))
        more = asterism.layout([*edges, (0, 42)], start=first.x)
        self.assertLess(np.sqrt(np.mean((more.x - first.x) ** 2)), 0.02 * size)
        # The best drawing of all pairs is not left for one of more stress.
        best = asterism.layout(edges, method="lbfgs-jacobi", start=first.x, tolerance=1e-8)
        self.assertLessEqual(stress(edges, asterism.layout(edges, start=best.x).x), 1.005 * stress(edges, best.x))

    def test_pins(self):
        edges = grid(35, 35)
        corners, at = [0, 34, 35 * 34, 35 * 35 - 1], np.array([(0, 0), (0, 50), (50, 0), (50, 50.0)])
        anchors = np.full((35 * 35, 2), np.nan)
        anchors[corners] = at
        free = asterism.layout(edges)
        for weight, most in ((np.inf, 0), (1e9, 1e-3), (50.0, 10)):
            with self.subTest(weight):
                result = asterism.layout(edges, anchors=anchors, anchor_weights=weight)
                off = np.linalg.norm(result.x[corners] - at, axis=1).max()
                self.assertLessEqual(off, most)
                if weight == np.inf:
                    full = asterism.layout(edges, anchors=anchors, anchor_weights=weight, method="lbfgs-jacobi", start=result.x)
                    self.assertLess(stress(edges, result.x), 1.06 * stress(edges, full.x))
                    self.assertGreater(stress(edges, result.x), stress(edges, free.x))

    def test_components_do_not_overlap(self):
        sizes = [600, 300, 150, *[20] * 10, *[2] * 40]
        edges, first, components = [], 0, []
        for size in sizes:
            components.append(range(first, first + size))
            edges += [(first + i, first + j) for i, j in tree(size, size)]
            first += size
        n = first + 300  # and nodes without an edge
        adjacency = matrix(edges)
        adjacency.resize((n, n))
        components += [range(k, k + 1) for k in range(first, n)]
        for dim in (2, 3):
            for start in (None, np.random.default_rng(1).normal(size=(n, dim))):
                x = asterism.layout(adjacency, dim, start=start).x
                self.assertTrue(np.isfinite(x).all())
                boxes = np.array([(x[list(c)].min(axis=0), x[list(c)].max(axis=0)) for c in components])
                apart = (boxes[:, None, 0] > boxes[None, :, 1]).any(axis=2)
                self.assertTrue((apart | apart.T | np.eye(len(boxes), dtype=bool)).all())
                np.testing.assert_allclose(x.mean(axis=0), 0, atol=1e-6 * np.ptp(x))
                if start is None:  # in rows, and not all in one
                    self.assertLess(np.ptp(x[:, 0]), 3 * np.ptp(x[:, 1]))

    def test_held_components_stay_and_others_are_beside_them(self):
        edges = [*grid(30, 30), *[(900 + i, 900 + j) for i, j in grid(20, 20)]]
        anchors = np.full((1300, 2), np.nan)
        anchors[0], anchors[29] = (5, 5), (5, 34)
        x = asterism.layout(edges, anchors=anchors, anchor_weights=np.inf).x
        np.testing.assert_array_equal(x[[0, 29]], [(5, 5), (5, 34)])
        self.assertGreater(x[900:, 0].min(), x[:900, 0].max())

    def test_bad_input(self):
        path = [(k, k + 1) for k in range(1200)]
        for call, error, message in (
            (lambda: asterism.layout(path, partners=5, method="sgd"), ValueError, "partners: the method 'sgd' draws the pairs itself"),
            (lambda: asterism.layout(path, starts=3), TypeError, r"method 'sgd' \(the default over 1000 nodes\) has no option 'starts'.*\(it has: seed, iter"),
            (lambda: asterism.layout(path, iterations=0), ValueError, "iterations: expected >= 1, found 0"),
            (lambda: asterism.layout(path, seed=-1), ValueError, "seed: expected >= 0, found -1"),
            (lambda: asterism.layout(path, threads=2**31), ValueError, r"threads: expected < 2\^31"),
            (lambda: asterism.layout(path, seed=0.5), TypeError, "seed: expected an integer, found float"),
            (lambda: asterism.layout(path, start=np.full((1201, 2), np.inf)), ValueError, "start: expected finite numbers"),
            (lambda: asterism.layout(path, start=np.zeros((3, 2))), ValueError, "start"),
            (lambda: asterism.layout(path, anchors=np.zeros((3, 2))), ValueError, "anchors"),
            (lambda: asterism.layout(path, power=500), ValueError, r"the weight of a path, its length \^ -power, is out of range"),
            (lambda: asterism.layout(path, power=np.nan), ValueError, r"the weight of a path, its length \^ -power, is out of range"),
            (lambda: asterism.layout([(0, 1, 1e-200), (1, 2, 1e-200)], method="sgd"), ValueError, "the weight of a path"),
            (lambda: asterism.layout([], method="sgd"), ValueError, "there are no nodes"),
        ):
            with self.subTest(message), self.assertRaisesRegex(error, message):
                call()

    def test_coincident_start(self):
        edges = grid(8, 8)
        result = asterism.layout(edges, start=np.zeros((64, 2)), method="sgd")
        self.assertTrue(np.isfinite(result.x).all())
        self.assertGreater(np.ptp(result.x), 1)


if __name__ == "__main__":
    unittest.main()
