#!/usr/bin/env python3
"""Multidimensional scaling and the layout of graphs, against scikit-learn where it is installed."""

import pickle
import unittest
import warnings

import asterism
import numpy as np
import scipy.sparse
import scipy.sparse.csgraph
from stress import distances_of, stress, symmetric

try:
    from sklearn.manifold import MDS
except ImportError:
    MDS = None


def nearest(x, points):
    """x moved, turned and mirrored onto points."""
    a, b = x - x.mean(axis=0), points - points.mean(axis=0)
    u, _, v = np.linalg.svd(a.T @ b)
    return a @ u @ v + points.mean(axis=0)


class MdsTest(unittest.TestCase):
    def setUp(self):
        self.random = np.random.default_rng(3)

    def problems(self):
        for n in (5, 12, 30, 60):
            points = self.random.normal(size=(n, 2))
            exact = distances_of(points)
            yield "noisy", exact * symmetric(np.exp(self.random.normal(scale=0.1, size=exact.shape)))
            if n > 30:
                break  # below, no method finds the global minimum reliably for more nodes
            yield "of six dimensions", distances_of(self.random.normal(size=(n, 6)))
            yield "random", symmetric(self.random.uniform(0.5, 1.5, exact.shape))

    @unittest.skipUnless(MDS, "needs scikit-learn (Debian package python3-sklearn)")
    def test_no_more_stress_than_scikit_learn(self):
        lower = 0
        for dim in (2, 3):
            for name, distances in self.problems():
                with self.subTest(name, n=len(distances), dim=dim):
                    with warnings.catch_warnings():
                        warnings.simplefilter("ignore")  # about defaults that later versions change
                        theirs = MDS(dim, metric=True, dissimilarity="precomputed", n_init=4, max_iter=3000, eps=1e-10, random_state=1)
                        theirs = stress(theirs.fit_transform(distances), distances)
                    found = asterism.mds(distances, dim=dim)
                    self.assertEqual(found.summary.status, asterism.Status.CONVERGED)
                    self.assertAlmostEqual(found.stress / stress(found.x, distances), 1, places=10)
                    self.assertLessEqual(found.stress, theirs * (1 + 1e-6))
                    self.assertLessEqual(found.lower_bound, min(found.stress, theirs))
                    lower += found.stress < 0.999 * theirs
        self.assertGreater(lower, 0)

    def test_exact_distances_are_met_and_proven(self):
        for dim in (2, 3):
            points = self.random.normal(size=(15, dim))
            found = asterism.mds(distances_of(points), dim=dim)
            np.testing.assert_allclose(nearest(found.x, points), points, atol=1e-6)
            np.testing.assert_allclose(found.x.mean(axis=0), 0, atol=1e-12)
            self.assertTrue(found.certified)
            self.assertLess(found.gap, 1e-6)
            self.assertTrue(found)

    def test_the_default_has_no_more_stress_than_many_starts(self):
        """Clusters that the plane cannot show, over 300 points, of which classical scaling puts some on the wrong side."""
        for seed in (11, 12, 13):
            random = np.random.default_rng([seed, 350])
            centres = 3 * random.normal(size=(10, 10))
            distances = distances_of(centres[random.integers(10, size=350)] + random.normal(size=(350, 10)))
            with self.subTest(seed=seed):
                found = asterism.mds(distances)
                self.assertLessEqual(found.stress, 1.01 * asterism.mds(distances, starts=8).stress)
                weights = 1 / np.maximum(distances, 1e-9)  # of all pairs, which the sample's starts have as well
                self.assertLessEqual(asterism.mds(distances, weights).stress, 1.01 * asterism.mds(distances, weights, starts=8).stress)

    def test_missing_pairs(self):
        points = self.random.normal(size=(20, 2))
        distances = distances_of(points)
        missing = symmetric(self.random.random(distances.shape)) < 0.5
        np.fill_diagonal(missing, False)
        partial = np.where(missing, np.nan, distances)
        known = scipy.sparse.coo_matrix(np.triu(np.where(missing, 0, distances), 1))
        for name, found in {
            "NaN": asterism.mds(partial),
            "weights": asterism.mds(distances + 7 * missing, weights=~missing),
            "sparse": asterism.mds(known),
            "sparse weights": asterism.mds(distances, weights=scipy.sparse.csr_matrix(~missing * 1.0)),
        }.items():
            with self.subTest(name):
                self.assertEqual(found.system.link_count, known.nnz)
                self.assertTrue(found.certified)
                np.testing.assert_allclose(nearest(found.x, points), points, atol=1e-6)

    def test_weights(self):
        distances = symmetric(self.random.uniform(0.5, 1.5, (8, 8)))
        weights = symmetric(self.random.uniform(0.1, 2, (8, 8)))
        found = asterism.mds(distances, weights)
        self.assertAlmostEqual(found.stress, stress(found.x, distances, weights), places=10)
        for _ in range(20):
            other = asterism.mds(distances, weights, start=self.random.normal(size=(8, 2)), method="newton")
            self.assertLessEqual(found.stress, other.stress * (1 + 1e-9))

    def test_anchors(self):
        for dim in (2, 3):
            points = self.random.normal(size=(12, dim)) + 5
            anchors = np.full((12, dim), np.nan)
            anchors[:4] = points[:4]
            found = asterism.mds(distances_of(points), anchors=anchors, dim=dim)
            np.testing.assert_allclose(found.x, points, atol=1e-5)
            anchors[0] += 0.1
            held = asterism.mds(distances_of(points), anchors=anchors, anchor_weights=np.inf, dim=dim)
            np.testing.assert_array_equal(held.x[:4], anchors[:4])
            weak = asterism.mds(distances_of(points), anchors=anchors.tolist(), anchor_weights=0.01, dim=dim)
            self.assertLess(weak.stress, held.stress)
            offsets = weak.x[:4] - anchors[:4]
            self.assertAlmostEqual(weak.stress, stress(weak.x, distances_of(points)) + 0.01 * np.sum(offsets**2), places=10)

    def test_a_proven_gap(self):
        """Weak noise and strong anchors on most nodes: certified; the staircase proves more than nothing of five noisy nodes."""
        points = self.random.normal(size=(10, 2))
        noisy = distances_of(points) * symmetric(1 + 0.01 * self.random.normal(size=(10, 10)))
        found = asterism.mds(noisy, anchors=points, anchor_weights=3)
        self.assertTrue(found.certified, found.certificate)
        self.assertGreater(found.lower_bound, 0.999 * found.stress)
        self.assertLess(found.gap, 1e-3)
        for _ in range(10):
            other = asterism.mds(noisy, anchors=points, anchor_weights=3, start=self.random.normal(size=(10, 2)), starts=1)
            self.assertGreaterEqual(other.stress, found.lower_bound * (1 - 1e-12))

    def test_parts_without_a_common_pair_are_side_by_side(self):
        distances = np.full((5, 5), np.nan)
        distances[0, 1] = distances[1, 0] = 2
        distances[2, 3] = distances[3, 2] = 3
        found = asterism.mds(distances)
        self.assertLess(found.stress, 1e-12)
        groups = [sorted(found.x[g, 0]) for g in ([0, 1], [2, 3], [4])]
        groups.sort()
        for left, right in zip(groups, groups[1:]):
            self.assertGreater(right[0], left[-1])
        self.assertEqual(found.parts, 3)
        self.assertIn("3 unrelated parts", repr(found))
        anchors = np.full((5, 2), np.nan)
        anchors[[0, 4]] = [[1, 2], [3, 4]]
        held = asterism.mds(distances, anchors=anchors)
        self.assertEqual(held.parts, 2)  # the anchors relate two parts to each other
        self.assertEqual(asterism.layout([(0, 1), (2, 3)]).parts, 2)
        self.assertEqual(asterism.layout([(0, 1), (2, 3)], method="sgd").parts, 2)
        self.assertEqual(asterism.layout([(0, 1), (1, 2)]).parts, 1)
        self.assertNotIn("parts", repr(asterism.layout([(0, 1), (1, 2)])))

    def test_nothing_is_proven_of_nothing(self):
        """Without any distance every placement has the least stress."""
        unknown = np.full((4, 4), np.nan)
        for known in (
            lambda: asterism.mds(unknown),
            lambda: asterism.mds(np.ones((4, 4)), np.zeros((4, 4))),
            lambda: asterism.mds(np.ma.masked_all((4, 4))),
            lambda: asterism.mds(scipy.sparse.csr_matrix((4, 4))),
            lambda: asterism.MDS(dissimilarity="precomputed").fit(unknown),
            lambda: asterism.MDS(dissimilarity="precomputed", metric=False).fit(unknown),
        ):
            with self.assertRaisesRegex(ValueError, "no distance is known: every pair of the 4 nodes"):
                known()
        anchored = asterism.mds(unknown, anchors=np.arange(8.0).reshape(4, 2))
        np.testing.assert_allclose(anchored.x, np.arange(8.0).reshape(4, 2))
        self.assertEqual((anchored.parts, anchored.certified), (1, True))
        self.assertEqual(asterism.mds([[0.0]]).parts, 1)

    def test_a_start_far_away_is_centred(self):
        """1e12 away, coordinates are rounded to 1e-4: nothing of that is left in the result, also not of two parts."""
        points = self.random.normal(size=(8, 2))
        distances = distances_of(points)
        far = asterism.mds(distances, start=points + [1e12, -3e12], starts=1)
        self.assertLess(far.stress, 1e-12)
        np.testing.assert_allclose(distances_of(far.x), distances, atol=1e-6)
        np.testing.assert_allclose(far.x.mean(axis=0), 0, atol=1e-9)
        apart = np.full((8, 8), np.nan)
        apart[:4, :4], apart[4:, 4:] = distances[:4, :4], distances[4:, 4:]
        found = asterism.mds(apart, start=points + np.repeat([[1e12, 0], [0, -3e12]], 4, axis=0), starts=1)
        self.assertLess(found.stress, 1e-12)
        # Nodes that have an anchor are where their start is.
        held = asterism.mds(distances, anchors=points, anchor_weights=np.inf, start=points + 1e6)
        np.testing.assert_array_equal(held.x, points)

    def test_a_start_on_a_line_is_left(self):
        distances = symmetric(np.ones((4, 4)))
        found = asterism.mds(distances)
        square = asterism.mds(distances, method="newton")
        self.assertLess(found.stress, 0.4)
        self.assertAlmostEqual(found.stress, square.stress, places=6)
        line = asterism.mds(np.abs(np.subtract.outer(np.arange(6.0), np.arange(6.0))))
        self.assertLess(line.stress, 1e-12)

    def test_lists_integers_and_float32(self):
        expected = asterism.mds(np.array([[0.0, 3, 4], [3, 0, 5], [4, 5, 0]]))
        for distances in ([[0, 3, 4], [3, 0, 5], [4, 5, 0]], np.array([[0, 3, 4], [3, 0, 5], [4, 5, 0]], np.float32)):
            np.testing.assert_array_equal(asterism.mds(distances).x, expected.x)
        self.assertEqual(pickle.loads(pickle.dumps(expected)).stress, expected.stress)

    def test_says_what_is_wrong(self):
        good = symmetric(np.ones((3, 3)))
        for call, error, message in [
            (lambda: asterism.mds([[0, 1], [2, 0]]), ValueError, r"expected a symmetric matrix, but \[0, 1\] is 1.0 and \[1, 0\] is 2.0"),
            (lambda: asterism.mds(-good), ValueError, r"distances: \[0, 1\] is -1.0; expected >= 0"),
            (lambda: asterism.mds(good[:2]), ValueError, r"distances: expected shape \(N, N\), found \(2, 3\)"),
            (lambda: asterism.mds([["a"]]), TypeError, "distances: expected numbers"),
            (lambda: asterism.mds(good, weights=-good), ValueError, r"weights: \[0, 1\] is -1.0"),
            (lambda: asterism.mds(good, weights=np.ones((2, 2))), ValueError, "weights: expected shape"),
            (lambda: asterism.mds(good, anchors=np.zeros((3, 3))), ValueError, r"anchors: expected shape \(3, 2\), found \(3, 3\)"),
            (lambda: asterism.mds(good, anchors=np.zeros((3, 2)), anchor_weights=-1), ValueError, "anchor_weights: expected >= 0"),
            (lambda: asterism.mds(good, dim=4), ValueError, "dim: expected 2 or 3, found 4; asterism.MDS takes 1 to 64"),
            (lambda: asterism.mds(good, dim=2.0), TypeError, "dim: expected an integer, found 2.0"),
            (lambda: asterism.mds(good, start=np.zeros((2, 2))), ValueError, "start: expected shape"),
            (lambda: asterism.mds(good, method="smacof"), ValueError, "unknown method 'smacof': use 'ida'"),
            (lambda: asterism.mds(good, n_components=2), TypeError, r"mds\(\) has no option 'n_components': here it is 'dim'"),
            (lambda: asterism.mds(good, n_init=4), TypeError, "here it is 'starts'"),
            (lambda: asterism.mds(good, random_state=1), TypeError, "here it is 'seed'"),
            (lambda: asterism.mds(good, eps=1e-3), TypeError, "here it is 'tolerance'"),
            (lambda: asterism.mds(good, max_iter=9), TypeError, "here it is 'max_iterations'"),
            (lambda: asterism.mds(good, init=good), TypeError, "here it is 'start'"),
            (lambda: asterism.mds(good, dissimilarity="euclidean"), TypeError, "always a matrix of distances"),
            (lambda: asterism.mds(good, method="ida", random_state=1), TypeError, "'seed' is an option of the method 'multi-start'"),
            (lambda: asterism.mds(good, tolerence=1e-3), TypeError, "did you mean 'tolerance'"),
            (lambda: asterism.mds(good, foo=1), TypeError, r"^mds\(\) has no option 'foo' \(it has: distances, "),
            (lambda: asterism.layout([(0, 1)], weight="weight"), TypeError, r"layout\(\) has no option 'weight': here it is 'length'"),
            (lambda: asterism.layout([(0, 1)], iterations=9), TypeError, "here it is 'max_iterations'"),
            (lambda: asterism.layout([(0, 1)], pos=good), TypeError, "here it is 'start'"),
            (lambda: asterism.layout([(0, 1)], k=2), TypeError, "multiply the result by a factor"),
            (lambda: asterism.layout([(0, 1)], dist={}), TypeError, "asterism.mds places points"),
            (lambda: asterism.mds(good, k=2), TypeError, r"mds\(\) has no option 'k' \(it has: "),
            (lambda: asterism.layout({"a": ["b"]}), TypeError, "found dict; networkx.Graph makes a graph of a dict of neighbours"),
            (lambda: asterism.MDS().fit([[1, 2], [3]]), ValueError, "X: expected an array of numbers, found list: "),
            (lambda: asterism.MDS().fit(row for row in good), TypeError, "X: expected an array of numbers, found generator: "),
            (lambda: asterism.layout([(0, 1)], prog="neato"), TypeError, "here it is 'method'"),
            (lambda: asterism.mds(good, tolerance=-1.0), ValueError, "tolerance"),
            (lambda: asterism.mds(np.zeros((0, 0))), ValueError, r"distances: expected those of one node or more, found shape \(0, 0\)"),
            (lambda: asterism.mds(good, anchors={0: (0, 0)}), TypeError, "anchors: expected shape .*, with NaN in the rows of nodes without an anchor, found dict"),
            (lambda: asterism.layout([(0, 1, {"weight": 2})]), TypeError, "expected a number, or give the graph of networkx itself"),
            (lambda: asterism.layout(np.array([[0, 1], [1, 2]])), ValueError, r"graph: an array of shape \(2, 2\) is an adjacency matrix, .*; give edges as a list"),
            (lambda: asterism.layout([(0, 1, -1)]), ValueError, r"edge \(0, 1\) has length -1.0"),
            (lambda: asterism.layout([(0, 1.5)]), TypeError, "edge 0 has node 1.5; expected an integer or a name"),
            (lambda: asterism.layout([([], "b")]), TypeError, r"edge 0 has node \[\]; expected"),
            (lambda: asterism.layout([(0, 1), (-1, 1)]), ValueError, "edge 1 has node -1; expected >= 0"),
            (lambda: asterism.layout(np.zeros((3, 2))), ValueError, "give edges as a list"),
            (lambda: asterism.layout(["ab"]), TypeError, r"edge 0 is 'ab'; expected \(a, b\) or \(a, b, length\)"),
            (lambda: asterism.layout([(0, 1, {"weight": 2})]), TypeError, "edge 0 has the length {'weight': 2}; expected a number"),
            (lambda: asterism.layout("graph.gml"), TypeError, "graph: expected a list of edges, .* found str"),
            (lambda: asterism.layout(None), TypeError, "graph: expected a list of edges, .* found NoneType"),
            (lambda: asterism.layout([(0, 1)], fixed=[0]), TypeError, "'anchors' with anchor_weights=np.inf hold nodes"),
            (lambda: asterism.layout([(0, 1)], method="kamada_kawai"), ValueError, "use the default, with which layout minimises the stress"),
            (lambda: asterism.mds(good[:2]), ValueError, r"found \(2, 3\); for points, use asterism.MDS"),
            (lambda: asterism.mds([1, 2, 3]), ValueError, r"found \(3,\); SciPy's squareform"),
            (lambda: asterism.mds([[0, 1], [1]]), ValueError, "distances: expected shape .N, N., found rows of different lengths"),
            (lambda: asterism.mds(good, n_jobs=2), TypeError, "asterism.MDS has n_jobs"),
            (lambda: asterism.layout([(0, 1)], partners=0), ValueError, "partners: expected >= 1, found 0"),
            (lambda: asterism.layout([(0, 1)], partners=2.5), TypeError, "partners: expected an integer, found 2.5"),
            (lambda: asterism.layout_stress([(0, 1)], np.zeros((3, 2))), ValueError, r"x: expected shape \(2, 2\) or \(2, 3\), found \(3, 2\)"),
            (lambda: asterism.layout_stress([(0, 1)], [[0, np.nan], [0, 0]]), ValueError, "x: expected finite numbers"),
        ]:
            with self.subTest(message), self.assertRaisesRegex(error, message):
                call()

    def test_names_of_others(self):
        for name, ours in [
            ("smacof", "here it is 'mds'"), ("spring_layout", "here it is 'layout'"), ("minimize", "here it is 'solve'"),
            ("mdss", "did you mean 'mds'"), ("torch", "import asterism.torch"), ("quux", "no attribute 'quux'$"),
        ]:
            if not hasattr(asterism, name):  # torch may be imported
                with self.subTest(name), self.assertRaisesRegex(AttributeError, ours):
                    getattr(asterism, name)


class Graph:
    """What layout uses of a networkx.Graph."""

    def __init__(self, edges):
        self.all = edges
        self.nodes = dict.fromkeys(node for edge in edges for node in edge[:2])

    def edges(self, data):
        if data is True:
            return [(*edge[:2], {"length": edge[2]} if len(edge) > 2 else {}) for edge in self.all]
        if data != "length":
            return [(*edge[:2], None) for edge in self.all]
        return [(*edge[:2], edge[2] if len(edge) > 2 else None) for edge in self.all]


class Table:
    """What is used of a pandas.DataFrame."""

    def __init__(self, values, index, columns):
        self.values, self.index, self.columns = values, index, columns

    def __array__(self, dtype=None):
        return np.array(self.values, dtype)

    def __iter__(self):
        return iter(self.columns)

    def itertuples(self, index, name):
        return map(tuple, self.values)


class LayoutTest(unittest.TestCase):
    def test_tables_of_pandas(self):
        expected = asterism.layout([("a", "b", 2.0), ("b", "c"), ("c", "a")])
        edges = Table([["a", "b", 2.0], ["b", "c", 1.0], ["c", "a", 1.0]], range(3), ["from", "to", "length"])
        matrix = Table([[0, 2, 1], [2, 0, 1], [1, 1, 0]], list("abc"), list("abc"))
        for table in (edges, matrix):
            found = asterism.layout(table)
            self.assertEqual(found.nodes, list("abc"))
            np.testing.assert_allclose(found.x, expected.x, atol=1e-9)
        self.assertEqual(list(asterism.mds(matrix).pos), list("abc"))
        without_header = Table([[0, 1, 2.0], [1, 2, 1.0], [2, 0, 1.0]], range(3), range(3))
        np.testing.assert_allclose(asterism.layout(without_header).x, expected.x, atol=1e-9)
        np.testing.assert_allclose(asterism.layout(Table(matrix.values, range(3), range(3))).x, expected.x, atol=1e-9)
        with self.assertRaisesRegex(ValueError, r"expected shape \(N, N\), found \(3, 2\)"):
            asterism.mds(Table([[0, 1], [1, 0], [2, 2]], range(3), "ab"))

    def test_nodes_of_any_names(self):
        expected = asterism.layout([(0, 1, 2.0), (1, 2), (2, 0)])
        for names in ("abc", ("x", 7, (1, 2)), (b"q", frozenset(), None)):
            a, b, c = names
            found = asterism.layout([(a, b, 2.0), (b, c), (c, a)])
            self.assertEqual(found.nodes, list(names))
            np.testing.assert_allclose(np.linalg.norm(found.pos[a] - found.pos[b]), np.linalg.norm(expected.x[0] - expected.x[1]))
        self.assertEqual(list(expected.pos), [0, 1, 2])
        self.assertEqual(len(repr(found).splitlines()), 1)
        self.assertRegex(repr(found), r"^<asterism.Embedding: 3 nodes, dim 2, stress .*>$")

    def test_an_attribute_that_no_edge_has(self):
        graph = Graph([("a", "b", 2), ("b", "c")])
        with self.assertRaisesRegex(ValueError, r"length: no edge has the attribute 'len' \(they have: length\)"):
            asterism.layout(graph, length="len")
        self.assertEqual(len(asterism.layout(graph, length=None).x), 3)

    def test_numbers_without_an_edge_are_told(self):
        with self.assertWarnsRegex(UserWarning, "3 of the nodes 0 to 5 have no edge, such as 2") as caught:
            self.assertEqual(len(asterism.layout([(0, 1), (1, 5)]).x), 6)
        self.assertEqual(caught.filename, __file__)
        for many, message in ((10**8, "3 of the nodes 0 to 100000000 have an edge"), (2**31, "node 2147483648"), (2**70, "node")):
            with self.assertRaisesRegex(ValueError, f"graph: {message}.*give numbers that only identify nodes as names"):
                asterism.layout([(0, 1), (1, many)])
        self.assertEqual(asterism.layout([("0", str(2**70))]).nodes, ["0", str(2**70)])

    def test_a_path_is_straight(self):
        for dim in (2, 3):
            found = asterism.layout([(k, k + 1) for k in range(9)], dim)
            self.assertEqual(found.x.shape, (10, dim))
            np.testing.assert_allclose(np.linalg.norm(found.x[0] - found.x[9]), 9, atol=1e-6)
            self.assertTrue(found.certified)

    def test_forms_of_one_graph(self):
        edges = [(0, 1), (1, 2), (2, 3), (3, 0), (3, 4)]
        matrix = np.zeros((5, 5))
        for i, j in edges:
            matrix[i, j] = 1
        expected = asterism.layout(edges)
        for name, graph in {
            "upper half": matrix,
            "both halves": matrix + matrix.T,
            "sparse": scipy.sparse.csr_matrix(matrix),
            "sparse integers": scipy.sparse.coo_matrix((matrix + matrix.T).astype(int)),
            "bools": matrix > 0,
            "lengths": [(*edge, 1) for edge in edges],
            "twice, and a loop": edges + edges + [(1, 0), (2, 2), (0, 1, 3.0)],
        }.items():
            with self.subTest(name):
                np.testing.assert_allclose(asterism.layout(graph).x, expected.x, atol=1e-12)
        named = asterism.layout(Graph([("a", "b"), ("b", "c"), ("c", "d"), ("d", "a"), ("d", "e", 1)]))
        self.assertEqual(named.nodes, list("abcde"))
        np.testing.assert_allclose(named.x, expected.x, atol=1e-12)

    def test_networkx(self):
        try:
            import networkx
        except ImportError:
            self.skipTest("needs networkx (Debian package python3-networkx)")
        graph = networkx.grid_2d_graph(3, 4)
        found = asterism.layout(graph)
        self.assertEqual(found.nodes, list(graph))
        np.testing.assert_array_equal(asterism.layout(graph.edges).x.shape, found.x.shape)
        with self.assertRaisesRegex(TypeError, "distances: expected a matrix .*, found Graph; asterism.layout draws a graph"):
            asterism.mds(graph)
        positions = dict(zip(found.nodes, found.x))
        lengths = [np.linalg.norm(positions[a] - positions[b]) for a, b in graph.edges]
        self.assertGreater(min(lengths), 0.5)

    def test_stress_and_lengths(self):
        edges = [(0, 1, 2.0), (1, 2, 3.0), (2, 0, 4.0)]
        found = asterism.layout(edges)
        self.assertLess(found.stress, 1e-12)
        self.assertAlmostEqual(np.linalg.norm(found.x[1] - found.x[2]), 3, places=6)
        self.assertAlmostEqual(found.system.link_stiffness[0], 1 / 4)
        self.assertAlmostEqual(asterism.layout(edges, power=1).system.link_stiffness[0], 1 / 2)

    def test_components_do_not_overlap(self):
        found = asterism.layout([(0, 1), (1, 2), (2, 0), (3, 4), (6, 7)])
        self.assertEqual(len(found.x), 8)  # node 5 is isolated
        groups = sorted(sorted(found.x[g, 0]) for g in ([0, 1, 2], [3, 4], [5], [6, 7]))
        for left, right in zip(groups, groups[1:]):
            self.assertGreater(right[0], left[-1])

    def test_many_components_of_all_sizes(self):
        """Parts without strain: each pair of a part has its distance, and no part overlaps another."""
        sizes = [1, 5, 2, 1, 3, 2, 4, 1, 5, 3, 1, 2]
        ends = np.cumsum([0] + sizes)
        for dim in (2, 3):
            paths = [(int(i), int(i) + 1, 0.5) for a, b in zip(ends, ends[1:]) for i in range(a, b - 1)]
            distances = np.full((ends[-1],) * 2, np.nan)
            for a, b in zip(ends, ends[1:]):
                distances[a:b, a:b] = 0.5 * np.abs(np.subtract.outer(np.arange(b - a), np.arange(b - a)))
            for found in (asterism.layout(paths, dim), asterism.layout(paths, dim, partners=3), asterism.mds(distances, dim=dim)):
                self.assertLess(found.stress, 1e-8)
                x = found.x - found.x.mean(axis=0)
                np.testing.assert_allclose(found.x.mean(axis=0), 0, atol=1e-9)
                bounds = sorted((x[a:b, 0].min(), x[a:b, 0].max()) for a, b in zip(ends, ends[1:]))
                self.assertTrue(all(left[1] < right[0] for left, right in zip(bounds, bounds[1:])))
        graph = asterism._asterism._Graph(5, np.array([[0, 1], [1, 2], [3, 4]]), np.array([1.0, 2.0, 4.0]))
        expected = [[[0, 1, np.inf]], [[3, 2, np.inf]]]
        np.testing.assert_array_equal(graph.distances(np.array([[0], [2]]), np.array([[0, 1, 3], [0, 1, 4]])), expected)
        np.testing.assert_array_equal(graph.distances(np.array([[3, 4]]), np.array([[4]])), [[[4], [0]]])
        for sources, targets in [([[5]], [[0]]), ([[0]], [[-1]]), ([[0]], [[0], [1]])]:
            with self.assertRaises(IndexError):
                graph.distances(np.array(sources), np.array(targets))

    def test_shortest_paths(self):
        """Against SciPy, with edges of equal and of several lengths, longer than another path, and nodes out of reach."""
        random = np.random.default_rng(5)
        for name, values in {"equal": np.full(60, 2.0), "several": random.uniform(0.1, 9, 60)}.items():
            with self.subTest(name):
                ends = random.integers(0, 45, (60, 2))
                edges = [(int(i), int(j), length) for (i, j), length in zip(ends, values) if i != j]
                found = asterism.layout(edges, method="auto")
                matrix = np.full((len(found.x),) * 2, np.inf)
                for i, j, length in edges:
                    matrix[i, j] = matrix[j, i] = min(matrix[i, j], length)
                expected = scipy.sparse.csgraph.shortest_path(np.where(np.isinf(matrix), 0, matrix), directed=False)
                links = found.system.topology.links
                np.testing.assert_allclose(found.system.rest_length, expected[links[:, 0], links[:, 1]], rtol=1e-12)
                self.assertEqual(len(links), np.isfinite(expected[np.triu_indices(len(expected), 1)]).sum())

    def test_stress_of_any_drawing(self):
        edges = [(0, 1, 2.0), (1, 2, 3.0), (2, 0, 7.0), (3, 4)]  # from 2 to 0 the path by 1 is shorter
        distances = np.array([[0, 2, 5], [2, 0, 3], [5, 3, 0]])
        for dim in (2, 3):
            x = np.random.default_rng(1).normal(size=(5, dim))
            for power in (1.0, 2.0):
                with np.errstate(divide="ignore"):
                    expected = stress(x[:3], distances, np.where(distances > 0, distances, np.inf) ** -power)
                expected += (1 - np.linalg.norm(x[3] - x[4])) ** 2
                self.assertAlmostEqual(asterism.layout_stress(edges, x, power=power), expected, places=12)
        found = asterism.layout(edges)
        self.assertAlmostEqual(asterism.layout_stress(edges, found.x), found.stress, places=12)
        enlarged = 7 * found.x
        self.assertAlmostEqual(asterism.layout_stress(edges, enlarged, scaled=True), found.stress, places=12)
        np.testing.assert_array_equal(enlarged, 7 * found.x)  # the caller's array is as it was
        self.assertEqual(asterism.layout_stress(edges, np.zeros((5, 2)), scaled=True), 4)

    def test_the_scaled_stress_does_not_depend_on_the_scale(self):
        edges = [(k, (k + 1) % 12) for k in range(12)] + [(0, 6), (3, 9)]
        x = 10 * np.random.default_rng(2).normal(size=(12, 2))
        distances = scipy.sparse.csgraph.shortest_path(scipy.sparse.csr_matrix((np.ones(14), zip(*edges)), (12, 12)), directed=False)
        pairs = np.triu_indices(12, 1)
        d, r = distances[pairs], distances_of(x)[pairs]
        scale = np.sum(r / d) / np.sum((r / d) ** 2)  # of weights 1 / d^2
        expected = np.sum((1 - scale * r / d) ** 2)
        for size in (1e-150, 1e-8, 1.0, 1e6, 1e8, 1e10, 1e150, 1e307):
            for offset, accuracy in ((0.0, 1e-12), (1e6, 1e-6), (1e9, 1e-3)):
                with self.subTest(size=size, offset=offset):
                    if offset * size < 1e308:
                        found = asterism.layout_stress(edges, (x / 100 + offset) * size, scaled=True)
                        self.assertAlmostEqual(found / expected, 1, delta=accuracy)

    def test_random_partners(self):
        """Much fewer pairs, and hardly more stress; small components keep all pairs, and a run is repeated exactly."""
        side = 30
        number = np.arange(side * side).reshape(side, side)
        grid = [*zip(number[:, :-1].ravel(), number[:, 1:].ravel()), *zip(number[:-1].ravel(), number[1:].ravel())]
        edges = grid + [(900, 901, 2.0), (901, 902), (902, 900, 2.0)]
        every, some = asterism.layout(edges), asterism.layout(edges, partners=40)
        self.assertEqual(every.system.link_count, 900 * 899 // 2 + 3)
        self.assertLess(some.system.link_count, 40 * 900 + len(edges))
        self.assertGreater(some.system.link_count, 39 * 900)
        self.assertLess(asterism.layout_stress(edges, some.x), 1.1 * every.stress)
        np.testing.assert_allclose(some.system.link_stiffness.sum(), every.system.link_stiffness.sum(), rtol=0.1)
        self.assertIsNone(some.certificate)
        self.assertFalse(some.certified)
        self.assertEqual((some.lower_bound, str(some.gap)), (0, "nan"))
        triangle = [tuple(link) for link in some.system.topology.links if link[0] >= 900]
        self.assertEqual(sorted(triangle), [(900, 901), (900, 902), (901, 902)])
        np.testing.assert_array_equal(asterism.layout(edges, partners=40).x, some.x)
        small = asterism.layout(grid[:40], partners=40)
        self.assertEqual(small.system.link_count, asterism.layout(grid[:40]).system.link_count)

    def test_many_nodes(self):
        """A ring of more nodes than classical scaling starts from: its drawing is a circle."""
        n = 600
        found = asterism.layout([(k, (k + 1) % n) for k in range(n)], dim=2, tolerance=1e-6)
        radii = np.linalg.norm(found.x, axis=1)
        self.assertLess(np.ptp(radii), 0.02 * radii.mean())


if __name__ == "__main__":
    unittest.main()
