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

    def test_is_a_start_of_the_default_for_hundreds_of_nodes(self):
        # Random starts do not unfold a ladder, and end with 3 % more stress or more. Two solves from one start may end in minima side by side.
        for rungs in (51, 60, 100, 150):
            ladder = grid(2, rungs)
            drawn = asterism.layout(ladder, method="sgd")
            improved = asterism.layout(ladder, start=drawn.x, starts=1).stress
            self.assertLessEqual(asterism.layout(ladder).stress, improved * 1.01)

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
            (lambda: asterism.layout(path, seed=0.5), TypeError, "seed: expected an integer, found 0.5"),
            (lambda: asterism.layout(path, start=np.full((1201, 2), np.inf)), ValueError, "start: expected finite numbers"),
            (lambda: asterism.layout(path, start=np.zeros((3, 2))), ValueError, "start"),
            (lambda: asterism.layout(path, anchors=np.zeros((3, 2))), ValueError, "anchors"),
            (lambda: asterism.layout(path, power=500), ValueError, r"the weight of a path, its length \^ -power, is out of range"),
            (lambda: asterism.layout(path, power=np.nan), ValueError, "power: expected a finite number, found nan"),
            (lambda: asterism.layout_stress(path, [[0, 0], [1, 0], [2, 0]], power=np.nan), ValueError, "power: expected a finite number"),
            (lambda: asterism.layout(path, power="2"), TypeError, "power: expected numbers, found <U1"),
            (lambda: asterism.layout(path, method=2), TypeError, "method: expected a name, found 2"),
            (lambda: asterism.layout([(0, 1, 1e-200), (1, 2, 1e-200)], method="sgd"), ValueError, "the weight of a path"),
            (lambda: asterism.layout([], method="sgd"), ValueError, "graph: it has no nodes"),
            (lambda: asterism.layout(path, method="SGD"), ValueError, "unknown method 'SGD', did you mean 'sgd'"),
        ):
            with self.subTest(message), self.assertRaisesRegex(error, message):
                call()

    def test_nothing_is_proven(self):
        for edges, options in ((grid(6, 7), {"method": "sgd"}), (grid(3, 3), {"sizes": (0.5, 0.2)}), ([(0, 1)], {"method": "sgd"})):
            drawn = asterism.layout(edges, **options)
            self.assertTrue(np.isnan(drawn.gap))
            self.assertIn("nothing proven", repr(drawn))

    def test_stress_of_places_by_node(self):
        edges = [("a", "b"), ("b", "c"), ("c", "d")]
        drawn = asterism.layout(edges)
        self.assertEqual(asterism.layout_stress(edges, dict(reversed(drawn.pos.items()))), asterism.layout_stress(edges, drawn.x))
        with self.assertRaisesRegex(ValueError, "x: 'e' is not a node"):
            asterism.layout_stress(edges, {"e": (0, 0)})
        with self.assertRaisesRegex(ValueError, "x: expected finite numbers"):
            asterism.layout_stress(edges, {"a": (0, 0)})
        with self.assertRaisesRegex(ValueError, "another unit is needed"):
            asterism.layout_stress(edges, 1e200 * drawn.x)

    def test_values_by_node(self):
        """Dicts from node to value stand for arrays in the order of the nodes."""
        edges = [("a", "b"), ("b", "c"), ("c", "d")]
        rows = [(0, 0), (np.nan, np.nan), (2, 0), (np.nan, np.nan)]
        by_array = asterism.layout(edges, anchors=rows, anchor_weights=[np.inf, 0, 3, 0])
        by_dict = asterism.layout(edges, anchors={"c": (2, 0), "a": (0, 0)}, anchor_weights={"a": np.inf, "c": 3})
        np.testing.assert_array_equal(by_dict.x, by_array.x)
        by_dict = asterism.layout(edges, layers={"a": 3, "d": 0}, sizes={n: (1, 1) for n in "abcd"}, start={n: (k, 0) for k, n in enumerate("dcba")})
        by_array = asterism.layout(edges, layers=[3, np.nan, np.nan, 0], sizes=(1, 1), start=[(3, 0), (2, 0), (1, 0), (0, 0)])
        np.testing.assert_array_equal(by_dict.x, by_array.x)
        self.assertTrue(asterism.layout(edges, anchors={}).certified)
        for options, message in (
            ({"anchors": {"x": (0, 0)}}, "anchors: 'x' is not a node of the graph"),
            ({"start": {"a": (0, 0)}}, "start: expected finite numbers for all nodes, found .* for 'b'"),
            ({"layers": {"a": np.inf}}, "layers: expected finite numbers"),
            ({"anchors": {"a": (0, 0, 0)}}, r"anchors: expected shape \(4, 2\), found \(4, 3\)"),
        ):
            with self.subTest(message), self.assertRaisesRegex(ValueError, message):
                asterism.layout(edges, **options)

    def test_a_new_edge_moves_a_drawing_little(self):
        """Five times less than a drawing without a start moves, even if the best rotation is taken from it."""
        edges = preferential(1200, 5)
        first = asterism.layout(edges)
        more = [*edges, (17, 1100)]
        kept = asterism.layout(more, start=first.x)
        without = asterism.layout(more, seed=2)
        off = np.sqrt(np.mean(np.sum((kept.x - first.x) ** 2, axis=1)))  # as they are on the screen
        self.assertLess(off, 0.05 * np.ptp(first.x))
        self.assertLess(5 * off, moved(without.x, first.x))
        self.assertLess(stress(more, kept.x), 1.02 * stress(more, without.x))

    def test_coincident_start(self):
        edges = grid(8, 8)
        result = asterism.layout(edges, start=np.zeros((64, 2)), method="sgd")
        self.assertTrue(np.isfinite(result.x).all())
        self.assertGreater(np.ptp(result.x), 1)


def overlaps(x, sizes):
    """How many pairs of boxes overlap, from all pairs."""
    apart = np.abs(x[:, None] - x) >= (sizes[:, None] + sizes) / 2
    return int((~apart.any(axis=2)).sum() - len(x)) // 2


class BoxesTest(unittest.TestCase):
    def test_no_two_boxes_overlap_and_the_stress_is_kept(self):
        random = np.random.default_rng(7)
        for name, edges in {"grid": grid(20, 25), "tree": tree(1100, 2)}.items():
            free = asterism.layout(edges)
            n = len(free.x)
            sizes = random.uniform(0.5, 2, (n, 1)) * [1.0, 0.4]
            sizes *= np.sqrt(0.25 * np.ptp(free.x, axis=0).prod() / sizes.prod(axis=1).sum())
            with self.subTest(name):
                self.assertGreater(overlaps(free.x, sizes), 20)
                result = asterism.layout(edges, sizes=sizes)
                self.assertEqual(overlaps(result.x, sizes), 0)
                self.assertLess(stress(edges, result.x), 1.1 * stress(edges, free.x))
                self.assertTrue(result.system is None and result.certificate is None)
                self.assertAlmostEqual(result.stress / stress(edges, result.x), 1, delta=0.1)
                np.testing.assert_allclose(result.x.mean(axis=0), 0, atol=1e-9)
                # A drawing that is one already moves little.
                again = asterism.layout(edges, sizes=sizes, start=result.x)
                self.assertEqual(overlaps(again.x, sizes), 0)
                self.assertLess(moved(again.x, result.x), 0.03 * np.ptp(result.x))

    def test_points(self):
        random = np.random.default_rng(1)
        for n, side in ((1, 1), (2, 1e-3), (300, 3), (300, 0.5), (60, 1e-9), (400, 1e5)):
            with self.subTest(n=n, side=side):
                x, sizes = side * random.random((n, 2)), random.uniform(0, 0.3, (n, 2)) * (side if side > 1 else 1)
                moved = asterism.remove_overlaps(x, sizes)
                self.assertEqual(overlaps(moved, sizes), 0)
                np.testing.assert_array_equal(asterism.remove_overlaps(moved, sizes), moved)
        # More boxes than have room, which passes do not end: some were left nearer than the scan line looked.
        many = asterism.remove_overlaps(np.random.default_rng(0).uniform(0, 70, (5000, 2)), (1, 1))
        self.assertTrue(all((np.abs(many[k + 1 :] - many[k]) >= 1).any(axis=1).all() for k in range(5000)))
        coincident = asterism.remove_overlaps(np.zeros((50, 2)), (1, 0.2))
        self.assertEqual(overlaps(coincident, np.full((50, 2), (1, 0.2))), 0)

    def test_boxes_that_are_held(self):
        random = np.random.default_rng(3)
        x, sizes, held = 4 * random.random((200, 2)), random.uniform(0.1, 0.3, (200, 2)), np.zeros(200, dtype=bool)
        x[:3], held[:3] = [(0, 0), (2, 2), (4, 4)], True
        moved = asterism.remove_overlaps(x, sizes, held=held)
        self.assertEqual(overlaps(moved, sizes), 0)
        np.testing.assert_array_equal(moved[:3], x[:3])
        # Boxes that touch do not overlap; two that overlap and are held are an error.
        touching = np.array([(0.0, 0), (1, 0), (0.5, 1)])
        np.testing.assert_array_equal(asterism.remove_overlaps(touching, (1, 1), held=[True] * 3), touching)
        with self.assertRaisesRegex(ValueError, "no places were found"):
            asterism.remove_overlaps(0.9 * touching, (1, 1), held=[True] * 3)
        edges, anchors = grid(8, 8), np.full((64, 2), np.nan)
        anchors[[0, 63]] = (0, 0), (8, 8)
        drawn = asterism.layout(edges, sizes=(0.8, 0.8), anchors=anchors, anchor_weights=np.inf)
        self.assertEqual(overlaps(drawn.x, np.full((64, 2), 0.8)), 0)
        np.testing.assert_array_equal(drawn.x[[0, 63]], anchors[[0, 63]])

    def test_layers_directions_and_alignment(self):
        random = np.random.default_rng(4)
        edges = sorted({(int(random.integers(k)), k) for k in range(1, 50)} | {(k // 3, k) for k in range(3, 50, 4)})
        sizes = np.full((50, 2), (0.5, 0.3))
        for dim, more in ((2, {"sizes": sizes}), (2, {}), (3, {})):
            with self.subTest(dim=dim, more=list(more)):
                drawn = asterism.layout(edges, dim, downward=0.7, **more)
                self.assertGreaterEqual(min(drawn.x[a, 1] - drawn.x[b, 1] for a, b in edges), 0.7)
                rows = np.where(np.arange(50) % 5 == 4, np.nan, np.arange(50) % 5 * 1.5)
                layered = asterism.layout(edges, dim, layers=rows, **more)
                known = ~np.isnan(rows)
                np.testing.assert_array_equal(layered.x[known, 1], rows[known])
                lines = [("y", [0, 7, 9, 30]), ("x", [1, 2]), ("x", [2, 3]), ("y", [11, 12])]
                aligned = asterism.layout(edges, dim, aligned=lines, **more)
                for axis, nodes in (*lines, ("x", [1, 3])):
                    self.assertEqual(np.ptp(aligned.x[nodes, "xyz".index(axis)]), 0)
                for result in (drawn, layered, aligned) if more else ():
                    self.assertEqual(overlaps(result.x, sizes), 0)
        # Edges of a circle have any direction; others go down.
        ring = asterism.layout([("a", "b"), ("b", "c"), ("c", "a"), ("c", "d"), ("e", "a"), ("f", "g")], downward=1.0)
        y = {node: place[1] for node, place in ring.pos.items()}
        self.assertTrue(y["c"] - y["d"] >= 1 and y["e"] - y["a"] >= 1 and y["f"] - y["g"] >= 1)

    def test_heights_that_contradict(self):
        chain = [("a", "b"), ("b", "c"), ("c", "d")]
        held = {"anchors": {"a": (0, 1), "d": (0, 0)}, "anchor_weights": np.inf}
        for options, message in (
            ({"layers": {"a": 0, "b": 1}}, "downward: 'b' has to be at y -0.5 or below, as 'a' is at 0, but is at 1"),
            ({"layers": {"a": 1, "d": 0}}, "downward: 'd' has to be at y -0.5 or below, as 'a' is at 1, but is at 0"),
            (held, "downward: 'd' has to be at y -0.5 or below"),
            ({"layers": {"a": 1}, "aligned": [("y", ["a", "d"])]}, "downward: 'a' cannot be above 'b', as nodes of the same y"),
            ({"aligned": [("y", ["a", "b"])]}, "downward: 'a' cannot be above 'b', as nodes of the same y"),
        ):
            with self.subTest(message), self.assertRaisesRegex(ValueError, message):
                asterism.layout(chain, downward=0.5, **options)
        drawn = asterism.layout(chain, downward=0.5, layers={"a": 1.5, "d": 0})
        np.testing.assert_allclose([drawn.pos[node][1] for node in "abcd"], [1.5, 1, 0.5, 0])
        # In random graphs, what is refused has no solution, and what is not is drawn.
        from scipy.optimize import linprog

        random = np.random.default_rng(3)
        refused = 0
        for _ in range(40):
            n = 7
            edges = [(int(i), int(j)) for i, j in random.integers(n, size=(8, 2)) if i < j] + [(n - 2, n - 1)]
            layers = np.where(random.random(n) < 0.5, -0.7 * np.arange(n) + random.normal(size=n), np.nan)
            nodes = sorted({node for edge in edges for node in edge})
            rows = np.zeros((len(edges), n))
            for row, (i, j) in zip(rows, edges):
                row[j], row[i] = 1, -1
            bounds = [(None, None) if np.isnan(y) else (y, y) for y in layers]
            is_possible = linprog(np.zeros(n), rows, np.full(len(edges), -0.5), bounds=bounds).status == 0
            options = {"downward": 0.5, "layers": {str(k): layers[k] for k in nodes}}
            named = [(str(i), str(j)) for i, j in edges]
            if is_possible:
                asterism.layout(named, **options)
            else:
                refused += 1
                with self.assertRaisesRegex(ValueError, "downward: .* has to be at y"):
                    asterism.layout(named, **options)
        self.assertTrue(5 < refused < 35)

    def test_there_is_always_room_in_layers(self):
        """No coordinate but y is given, so that all boxes fit beside each other."""
        random = np.random.default_rng(7)
        for trial in range(12):
            n = int(random.integers(10, 40))
            edges = [(i, j) for i in range(n) for j in range(i)] if trial % 2 else preferential(n, trial)
            sizes = random.uniform(0.1, 1, size=(n, 2))
            layers = np.where(random.random(n) < 0.5, random.integers(0, 4, n), np.nan)
            x = asterism.layout(edges, sizes=sizes, layers=layers).x
            given = ~np.isnan(layers)
            np.testing.assert_array_equal(x[given, 1], layers[given])
            apart = (np.abs(x[:, None] - x) >= (sizes[:, None] + sizes) / 2).any(axis=2)
            self.assertTrue((apart | np.eye(n, dtype=bool)).all())

    def test_groups(self):
        edges, random = grid(7, 7), np.random.default_rng(5)
        for sizes in (np.full((49, 2), (0.4, 0.3)), None):
            for groups in ([range(0, 10), range(20, 30)], [[int(k) for k in random.choice(49, 6, replace=False)]]):
                x = asterism.layout(edges, groups=groups, sizes=sizes).x
                half = np.zeros((49, 2)) if sizes is None else sizes / 2
                low, high = x - half, x + half
                alone = sorted(set(range(49)) - {k for group in groups for k in group})
                of = [[k] for k in alone] if sizes is None else [[k] for k in range(49)]
                if sizes is not None:
                    self.assertEqual(overlaps(x, sizes), 0)
                of = [[k] for k in alone] + [list(group) for group in groups]
                lows, highs = (np.array([each(side[nodes], axis=0) for nodes in of]) for each, side in ((np.min, low), (np.max, high)))
                apart = ((lows[:, None] >= highs) | (lows >= highs[:, None])).any(axis=2)
                grouped = np.arange(len(of)) >= len(alone)
                among = (grouped[:, None] | grouped) & ~np.eye(len(of), dtype=bool)
                self.assertTrue(apart[among].all())

    def test_bad_input(self):
        pairs = [("a", "b"), ("b", "c")]
        pins = [(0.0, 0), (0.5, 0), (5, 5)]
        for call, error, message in (
            (lambda: asterism.layout(pairs, sizes=(1, -1)), ValueError, r"sizes: row 0 is \[1.0, -1.0\]; expected >= 0 and finite"),
            (lambda: asterism.layout(pairs, sizes=[(1, 1), (1, np.nan), (1, 1)]), ValueError, "sizes: row 1"),
            (lambda: asterism.layout(pairs, sizes=[(1, 1), (1, 1)]), ValueError, r"sizes: expected shape \(3, 2\) or \(2,\), found \(2, 2\)"),
            (lambda: asterism.layout(pairs, 3, sizes=(1, 1)), ValueError, "sizes: only with dim 2"),
            (lambda: asterism.layout(pairs, 3, groups=[["a"]]), ValueError, "groups: only with dim 2"),
            (lambda: asterism.layout(pairs, layers=[0, 1]), ValueError, "layers"),
            (lambda: asterism.layout(pairs, layers=[0, np.inf, 1]), ValueError, "layers: expected finite numbers"),
            (lambda: asterism.layout(pairs, downward=-1), ValueError, "downward: expected >= 0 and finite, found -1"),
            (lambda: asterism.layout(pairs, downward=np.nan), ValueError, "downward: expected >= 0"),
            (lambda: asterism.layout(pairs, aligned=[("z", ["a"])]), ValueError, "aligned: entry 0 is .*; expected an axis of 'x', 'y'"),
            (lambda: asterism.layout(pairs, aligned=["xa"]), ValueError, "aligned: entry 0"),
            (lambda: asterism.layout(pairs, aligned=[("x", ["a", "q"])]), ValueError, "aligned: entry 0: 'q' is not a node of the graph"),
            (lambda: asterism.layout(pairs, aligned=[("x", "ab")]), TypeError, "expected a list of nodes"),
            (lambda: asterism.layout(pairs, groups=[["a", "b"], ["b"]]), ValueError, "groups: 'b' is in two groups"),
            (lambda: asterism.layout(pairs, groups=[[["a"]]]), ValueError, "is not a node of the graph"),
            (lambda: asterism.layout(pairs, groups=[["a"], ["b", "c"]], aligned=[("x", ["a", "c"])]), ValueError, "aligned: 'a' and 'c' are not in the same group"),
            (lambda: asterism.layout(pairs, sizes=(1, 1), anchors=pins, anchor_weights=np.inf), ValueError, "no places were found"),
            (lambda: asterism.layout(pairs, aligned=[("y", ["c", "a"])], layers=[1, 2, 3]), ValueError, "aligned: 'a' and 'c' have to be at y 1.0 and 3.0"),
            (lambda: asterism.layout(pairs, aligned=3), TypeError, "aligned: expected a list of pairs of an axis and nodes, found int"),
            (lambda: asterism.layout(pairs, groups={"x": ["a", "b"]}), TypeError, r"groups: expected a list of lists of nodes, found dict; .* list\(groups.values\(\)\)"),
            (lambda: asterism.layout(pairs, sizes={"a": (1, 1)}), ValueError, "sizes: expected one for each node, found none for 'b'"),
            (lambda: asterism.layout(pairs, groups="ab"), TypeError, "groups: expected a list of lists of nodes, found str"),
            (lambda: asterism.layout(pairs, layers=[1, 2, 3], anchors=pins, anchor_weights=np.inf), ValueError, "layers: 'a' is held on"),
            (lambda: asterism.layout(pairs, downward=1, layers=[0, 1, 2]), ValueError, "downward: 'b' has to be at y -1 or below"),
            (lambda: asterism.layout(pairs, downward=1, aligned=[("y", ["a", "b"])]), ValueError, "downward: 'a' cannot be above 'b'"),
            (lambda: asterism.layout(pairs, node_size=3), TypeError, "here it is 'sizes', the width and the height"),
            (lambda: asterism.remove_overlaps([1, 2], (1, 1)), ValueError, r"x: expected shape \(N, 2\), found \(2,\)"),
            (lambda: asterism.remove_overlaps([[1, np.nan]], (1, 1)), ValueError, "x: expected finite numbers"),
            (lambda: asterism.remove_overlaps([[1, 2]], (1, np.inf)), ValueError, "sizes: row 0"),
            (lambda: asterism.remove_overlaps([[1, 2]], (1, 1), held=[1]), ValueError, r"held: expected shape \(1,\) of bool"),
        ):
            with self.subTest(message), self.assertRaisesRegex(error, message):
                call()


if __name__ == "__main__":
    unittest.main()
