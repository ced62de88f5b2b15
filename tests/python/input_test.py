#!/usr/bin/env python3
"""What people give where a function takes numbers: each kind of array, to each argument of each function of the module."""

import itertools
import unittest
import warnings

import asterism
import numpy as np
import scipy.sparse
from moving_square import BOX, draw_frame

try:
    import networkx
except ImportError:
    networkx = None

random = np.random.default_rng(5)
POINTS = random.permutation(64)[:6]  # of a grid of 8 x 8: whole numbers, which every type holds
POINTS = np.column_stack(np.divmod(POINTS, 8)).astype(float)
DISTANCES = np.linalg.norm(POINTS[:, None] - POINTS, axis=2)


def whole(*shape):
    return random.integers(1, 9, shape).astype(float)


def system_with_solution():
    system = asterism.SpringSystem(asterism.Topology.full(6))
    system.anchors = POINTS
    system.set_rest_lengths(POINTS)
    system.anchor_stiffness, system.link_stiffness = 1, 2
    return system


SYSTEM, SOLUTION = system_with_solution(), POINTS
LINKS = SYSTEM.link_count


def assigned(name):
    def value_after(values):
        system = SYSTEM.copy()
        setattr(system, name, values)
        return getattr(system, name)

    return value_after


def assigned_to_batch(name):
    def value_after(values):
        batch = asterism.SpringBatch(SYSTEM.topology, 2)
        setattr(batch, name, values)
        return getattr(batch, name)

    return value_after


def batch_sensitivity(grad_x):
    batch = asterism.SpringBatch(SYSTEM.topology, 2)
    for name in ("anchors", "anchor_stiffness", "rest_length", "link_stiffness"):
        setattr(batch, name, getattr(SYSTEM, name))
    batch.x = SOLUTION
    return batch.sensitivity(grad_x).anchors


def set_by(method):
    def value_after(points):
        system = SYSTEM.copy()
        getattr(system, method)(points)
        return system.rest_length if method == "set_rest_lengths" else system.rest_offset

    return value_after


def tangent(name):
    system = SYSTEM.copy()
    if name in ("rest_offset", "loads"):
        setattr(system, name, np.zeros((LINKS if name == "rest_offset" else 6, 2)))
    return lambda values: asterism.solution_tangent(system, SOLUTION, **{name: values})


def bench_result(x):
    row = asterism.bench.compare(lambda problem: x, sizes=[2], kinds=["lit"], systems=1, against=[]).rows[0]
    if row.failed:
        raise TypeError("masked, object, complex: counted as failed")
    return row.converged


PAIRS, TRIPLES = [[0, 1], [2, 3], [4, 5]], [[0, 1, 2], [3, 4, 5]]


def column(name, add):
    """What a term has in a column after add(system, values)."""
    return lambda values: getattr(add(asterism.System(6), values), name)


def semidefinite(count):
    root = whole(count, 2, 2)
    return root @ root.transpose(0, 2, 1)


def appended(values):
    term = asterism.System(6).add_loads(POINTS)
    term.append([1, 2], force=values)
    return term.force


def reassigned(values):
    term = asterism.System(6).add_links(PAIRS, 1)
    term.stiffness = values
    return term.stiffness


TERMS = asterism.System(6)
TERMS.add_anchors(POINTS, 1)
TERMS.add_links(PAIRS, 3, 0.2)

JOINT = asterism.Joint(0, 1)
MAP, STACK = whole(5, 6), whole(2, 5, 6)


def structure(function, **options):
    return lambda values: function([values, MAP], [JOINT], **options)[0][0] if function is asterism.m_best_placements else function(
        [values, MAP], [JOINT], **options
    ).energy


# Functions of one argument, and what it is given there.
ENTRIES = {
    **{f"SpringSystem.{name}": (assigned(name), whole(6, 2)) for name in ("anchors", "loads")},
    "SpringSystem.rest_offset": (assigned("rest_offset"), whole(LINKS, 2)),
    "SpringSystem.anchor_stiffness": (assigned("anchor_stiffness"), whole(6)),
    **{f"SpringSystem.{name}": (assigned(name), whole(LINKS)) for name in ("rest_length", "link_stiffness")},
    "SpringSystem.set_rest_lengths": (set_by("set_rest_lengths"), whole(6, 2)),
    "SpringSystem.set_rest_offsets": (set_by("set_rest_offsets"), whole(6, 2)),
    **{f"SpringBatch.{name}": (assigned_to_batch(name), whole(2, 6, 2)) for name in ("anchors", "x")},
    "SpringBatch.anchor_stiffness": (assigned_to_batch("anchor_stiffness"), whole(2, 6)),
    **{f"SpringBatch.{name}": (assigned_to_batch(name), whole(2, LINKS)) for name in ("rest_length", "link_stiffness")},
    "SpringBatch.sensitivity": (batch_sensitivity, whole(2, 6, 2)),
    **{
        f.__name__: (lambda x, f=f: f(SYSTEM, x), POINTS + 2)
        for f in (asterism.energy, asterism.gradient, asterism.hessian, asterism.stationarity)
    },
    "sparse_hessian": (lambda x: asterism.sparse_hessian(SYSTEM, x).toarray(), POINTS + 2),
    "certify": (lambda x: asterism.certify(SYSTEM, x).energy, POINTS),
    **{f.__name__: (lambda x, f=f: f(SYSTEM, x), SOLUTION) for f in (asterism.covariance, asterism.node_covariances)},
    "sensitivity, x": (lambda x: asterism.sensitivity(SYSTEM, x, POINTS).anchors, SOLUTION),
    "sensitivity, grad_x": (lambda x: asterism.sensitivity(SYSTEM, SOLUTION, x).anchors, whole(6, 2)),
    **{
        f"solution_tangent, {name}": (tangent(name), whole(*shape))
        for name, shape in {
            "anchors": (6, 2),
            "anchor_stiffness": (6,),
            "rest_length": (LINKS,),
            "link_stiffness": (LINKS,),
            "rest_offset": (LINKS, 2),
            "loads": (6, 2),
        }.items()
    },
    "System.add_anchors, positions": (column("position", lambda s, v: s.add_anchors(v)), whole(6, 2)),
    "System.add_anchors, stiffness": (column("stiffness", lambda s, v: s.add_anchors(POINTS, v)), whole(6)),
    "System.add_anchors, information": (column("information", lambda s, v: s.add_anchors(POINTS, information=v)), semidefinite(6)),
    "System.add_anchors, scale": (column("scale", lambda s, v: s.add_anchors(POINTS, loss="huber", scale=v)), whole(6)),
    "System.add_anchors, sharpness": (column("sharpness", lambda s, v: s.add_anchors(POINTS, loss="truncated", scale=1, sharpness=v)), whole(6)),
    "System.add_links, lengths": (column("length", lambda s, v: s.add_links(PAIRS, v)), whole(3)),
    "System.add_links, upper": (column("upper", lambda s, v: s.add_links(PAIRS, 1, law="interval", upper=v)), whole(3)),
    "System.add_links, offsets": (column("offset", lambda s, v: s.add_links(PAIRS, 1, offsets=v)), whole(3, 2)),
    "System.add_offsets, offsets": (column("offset", lambda s, v: s.add_offsets(PAIRS, v)), whole(3, 2)),
    "System.add_bendings, lengths": (column("length", lambda s, v: s.add_bendings(TRIPLES, v)), whole(2)),
    "System.add_differences, target": (column("target", lambda s, v: s.add_differences(TRIPLES, target=v)), whole(2, 2)),
    "System.add_differences, coefficients": (column("b", lambda s, v: s.add_differences(TRIPLES, coefficients=(1, v, 1))), whole(2, 2, 2)),
    "System.add_angles, angles": (column("rest", lambda s, v: s.add_angles(TRIPLES, v)), whole(2) % 4),
    "System.add_areas, areas": (column("rest", lambda s, v: s.add_areas(TRIPLES, v)), whole(2)),
    "System.add_common_length, lengths": (column("length", lambda s, v: s.add_common_length(PAIRS, lengths=v)), whole(3)),
    "System.add_loads, forces": (column("force", lambda s, v: s.add_loads(v)), whole(6, 2)),
    "Term.append": (appended, whole(2, 2)),
    "Term, a column": (reassigned, whole(3)),
    **{f"System.{name}": (getattr(TERMS, name), POINTS + 2) for name in ("energy", "gradient", "stationarity")},
    "System.certify": (lambda x: TERMS.certify(x).energy, POINTS),
    "System.solution": (lambda x: TERMS.solution(x).covariances, POINTS),
    "Solution.gradients": (lambda x: TERMS.solution(POINTS).gradients(x)[1]["length"], whole(6, 2)),
    "Topology.k_nearest": (lambda points: asterism.Topology.k_nearest(points, 2).links, POINTS),
    "mds, start": (lambda x: asterism.mds(DISTANCES, start=x, method="newton").x, POINTS),
    "layout, start": (lambda x: asterism.layout([(0, 1), (1, 2), (2, 3)], start=x, method="newton").x, POINTS[:4]),
    "layout_stress": (lambda x: asterism.layout_stress([(0, 1), (1, 2), (2, 3)], x), POINTS[:4]),
    "scaled_structure, scales": (lambda s: asterism.scaled_structure([STACK, STACK], [JOINT], s).energy, np.array([1.0, 2.0])),
    "bench.compare": (bench_result, whole(2, 2)),
}
if hasattr(asterism, "read_systems"):
    ENTRIES["StoredSystem.start"] = (lambda x: float(len(asterism._asterism._system_to_json(SYSTEM, x, "", "{}"))), POINTS)
if hasattr(asterism, "Tracker"):
    FRAME = draw_frame(0)

    def box_of(box):
        tracker = asterism.Tracker("kalman" if "kalman" in asterism.tracker_names() else "kcf")
        tracker.init(FRAME, box)
        return tracker.update(FRAME).box

    ENTRIES["Tracker.init"] = (box_of, np.round(np.array(BOX)))

# Where masked entries mean something, and an array of plain numbers that says the same.
HOLES = np.isin(np.arange(36).reshape(6, 6), (1, 6, 15, 20))  # symmetric
MISSING = {
    "mds, distances": (lambda d: asterism.mds(d).x, DISTANCES, HOLES, np.nan),
    "mds, weights": (lambda w: asterism.mds(DISTANCES + 1, w).x, np.round(10 * DISTANCES + 1), HOLES, 0),
    "mds, anchors": (lambda a: asterism.mds(DISTANCES, anchors=a).x, POINTS + 3, np.arange(6)[:, None] == [4, 4], np.nan),
    "mds, anchor_weights": (
        lambda w: asterism.mds(DISTANCES, anchors=np.where(np.arange(6)[:, None] == 4, np.nan, POINTS), anchor_weights=w).x,
        whole(6),
        np.arange(6) == 4,
        np.nan,
    ),
    "layout": (lambda m: asterism.layout(m).x, np.round(DISTANCES), HOLES, 0),
    "pictorial_structure": (structure(asterism.pictorial_structure), MAP, MAP < 4, np.inf),
    "m_best_placements": (structure(asterism.m_best_placements, count=1), MAP, MAP < 4, np.inf),
    "loopy_structure": (structure(asterism.loopy_structure), MAP, MAP < 4, np.inf),
    "scaled_structure": (
        lambda stack: asterism.scaled_structure([stack, STACK], [JOINT], [1, 2]).energy,
        STACK,
        STACK < 4,
        np.inf,
    ),
}
MAY_BE_NONE = {
    *("mds, weights", "mds, anchors", "mds, start", "layout, start", "SpringSystem.rest_offset", "SpringSystem.loads"),
    *("System.add_anchors, information", "System.add_anchors, sharpness", "System.add_links, offsets"),
    *(name for name in ENTRIES if name.startswith("solution_tangent")),
}
ALL = {**ENTRIES, **{name: (function, values) for name, (function, values, *_) in MISSING.items()}}


def one_masked(values):
    mask = np.zeros(values.shape, bool)
    mask.flat[1] = True
    return np.ma.masked_array(values, mask)


class ArraysTest(unittest.TestCase):
    def test_every_type_and_layout_is_the_same_numbers(self):
        for name, (function, values) in ALL.items():
            expected = function(values)
            is_whole = (values == np.round(values)).all()
            kinds = {
                **({} if name == "layout" else {"list": values.tolist()}),  # there, a list is one of edges
                "columns first": np.asfortranarray(values),
                "big-endian": values.astype(">f8"),
                **({"matrix": values.view(np.matrix)} if values.ndim == 2 else {}),
                "a mask without masked entries": np.ma.masked_array(values, np.zeros(values.shape, bool)),
                "every second row": np.repeat(values, 2, axis=0)[::2],
                **({dtype: values.astype(dtype) for dtype in ("f2", "f4", "g", "i1", "i8", "u2")} if is_whole else {"long double": values.astype("g")}),
            }
            for kind, given in kinds.items():
                with self.subTest(name, kind=kind):
                    np.testing.assert_allclose(np.asarray(function(given)), np.asarray(expected), rtol=1e-12, atol=1e-12)

    def test_masked_entries_are_missing(self):
        for name, (function, values, mask, missing) in MISSING.items():
            with self.subTest(name):
                wrong_beneath = np.where(mask, 1e3, values)
                expected = function(np.where(mask, missing, values))
                np.testing.assert_allclose(function(np.ma.masked_array(wrong_beneath, mask)), expected, rtol=1e-9, atol=1e-9)
                if name == "layout":
                    continue  # a list is one of edges
                rows = [np.ma.masked_array(row, m) for row, m in zip(wrong_beneath, mask)]
                np.testing.assert_allclose(function(rows), expected, rtol=1e-9, atol=1e-9)

    def test_masked_entries_are_refused_where_nothing_can_be_missing(self):
        for name, (function, values) in ENTRIES.items():
            with self.subTest(name), self.assertRaisesRegex(TypeError, "masked"):
                function(one_masked(values))
        x = POINTS.copy()
        with self.assertRaisesRegex(TypeError, "x: expected numbers, found masked ones"):
            asterism.solve(SYSTEM, one_masked(x))
        with self.assertRaisesRegex(TypeError, "links: expected numbers, found masked ones"):
            asterism.Topology.from_links(3, one_masked(np.array([[0, 1], [1, 2]])))
        with self.assertRaisesRegex(ValueError, "joint 0: expected offset"):
            asterism.pictorial_structure([MAP, MAP], [asterism.Joint(0, 1, one_masked(np.zeros(2)))])
        for attribute in ("weight", "length", "truncation", "layer_weight"):
            for value in (np.ma.masked, "1"):
                with self.subTest(attribute), self.assertRaisesRegex(ValueError, "joint 0: expected offset"):
                    asterism.scaled_structure([STACK, STACK], [asterism.Joint(0, 1, **{attribute: value})], [1, 2])
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            with self.assertRaisesRegex(TypeError, "graph: the edges' lengths: expected numbers, found masked ones"):
                asterism.layout([(0, 1, np.ma.masked), (1, 2, 1)])
        with self.assertRaisesRegex(TypeError, "option tolerance: expected a number, found masked"):
            asterism.Solver(tolerance=np.ma.masked)

    @unittest.skipUnless(hasattr(asterism, "Tracker"), "built without trackers")
    def test_masked_images_and_regions(self):
        frame, mask = draw_frame(0), np.zeros(draw_frame(0).shape[:2], np.uint8)
        mask[20:40, 20:40] = 1
        tracker = asterism.Tracker("kcf")
        for call in (
            lambda: tracker.init(one_masked(frame), BOX),
            lambda: tracker.update(one_masked(frame)),
            lambda: asterism.MultiTracker().add(1, one_masked(frame), BOX),
            lambda: asterism.suggested_range(one_masked(frame)),
        ):
            with self.assertRaisesRegex(TypeError, "image: expected numbers, found masked ones"):
                call()
        with self.assertRaisesRegex(TypeError, "the object: expected numbers, found masked ones"):
            tracker.init(frame, one_masked(mask))
        tracker.init(np.ma.masked_array(frame, False), BOX)

    def test_what_is_no_array_of_numbers_is_refused(self):
        for name, (function, values) in ALL.items():
            # A sparse matrix means something to mds and layout.
            sparse = [] if name in ("mds, distances", "mds, weights", "layout") or values.ndim != 2 else [scipy.sparse.csr_matrix(values)]
            for given in (values.astype(complex), values.astype(object), values.astype(str), "a", None, {}, *sparse):
                if given is None and name in MAY_BE_NONE:
                    continue
                with self.subTest(name, given=type(given).__name__), self.assertRaises((TypeError, ValueError)):
                    function(given)

    def test_numbers_beyond_float64(self):
        huge = np.full((6, 2), np.longdouble("1e4000"))
        system = SYSTEM.copy()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # NumPy's, of an overflow
            system.anchors = huge
        self.assertEqual(asterism.solve(system, POINTS.copy(), check=False).message, "anchor 0 is not finite")
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            with self.assertRaises(RuntimeWarning):
                system.anchors = huge

    def test_maps_beyond_float32(self):
        for structure_of in ("pictorial_structure", "m_best_placements", "loopy_structure"):
            with self.assertRaisesRegex(ValueError, r"map 0: 1e\+39 is beyond float32"):
                MISSING[structure_of][0](np.where(MAP < 4, 1e39, MAP))


class MatricesTest(unittest.TestCase):
    """Symmetric matrices as they are computed and stored."""

    def test_symmetric_to_the_rounding_of_the_type(self):
        for dtype, to in itertools.product((np.float16, np.float32, np.float64), (np.asarray, scipy.sparse.coo_matrix)):
            if to is not np.asarray and dtype == np.float16:
                continue  # SciPy has none
            matrix = DISTANCES.astype(dtype)
            for unit in range(2):
                matrix[0, 1] = np.nextafter(matrix[0, 1], dtype(np.inf))
            with self.subTest(dtype, to=to):
                mean = (float(matrix[0, 1]) + float(matrix[1, 0])) / 2
                exact = matrix.astype(float)
                exact[0, 1] = exact[1, 0] = mean
                np.testing.assert_allclose(asterism.mds(to(matrix)).x, asterism.mds(exact).x, rtol=1e-12, atol=1e-12)
                asterism.mds(DISTANCES, to(matrix))
                matrix[0, 1] *= dtype(1.03)
                for arguments in ((to(matrix),), (DISTANCES, to(matrix))):
                    with self.assertRaisesRegex(ValueError, r"expected a symmetric matrix, but \[[01], [01]\]"):
                        asterism.mds(*arguments)

    def test_sparse_entries_given_twice_are_summed(self):
        row, column = np.array([0, 0, 1, 2, 2]), np.array([1, 1, 2, 0, 0])
        values = np.array([1.0, 2.0, 4.0, 6.0, -1.0])  # a triangle of 3, 4, 5
        coo = scipy.sparse.coo_matrix((values, (row, column)), shape=(3, 3))
        csr = scipy.sparse.csr_matrix((values, column, [0, 2, 3, 5]), shape=(3, 3))
        self.assertFalse(csr.has_canonical_format)
        for matrix in (coo, csr, coo.tocsc(), coo.todok(), coo.tolil(), scipy.sparse.coo_array(coo)):
            with self.subTest(type(matrix)):
                x = asterism.mds(matrix).x
                found = [np.linalg.norm(x[i] - x[j]) for i, j in ((0, 1), (1, 2), (0, 2))]
                np.testing.assert_allclose(found, [3, 4, 5])
                drawn = asterism.layout(matrix).system
                self.assertEqual(sorted(drawn.rest_length), [3, 4, 5])
                weighted = asterism.mds(np.ones((3, 3)), matrix).system
                self.assertEqual(sorted(weighted.link_stiffness), [3, 4, 5])
        self.assertEqual(csr.nnz, 5)  # the caller's matrix is as it was
        none = scipy.sparse.coo_matrix(([1.0, -1.0, 2.0], ([0, 0, 1], [1, 1, 2])), shape=(3, 3))
        self.assertEqual(asterism.mds(none).system.rest_length.tolist(), [0, 2])

    def test_anchors_known_in_part(self):
        for rows in ({2: [5, np.nan]}, {k: [5, np.nan] for k in range(6)}, {2: [np.nan, np.inf]}):
            anchors = np.full((6, 2), np.nan)
            for k, row in rows.items():
                anchors[k] = row
            first = min(rows)
            with self.subTest(rows), self.assertRaisesRegex(ValueError, rf"anchors: row {first} is \[.*\]; expected finite numbers, or NaN in all"):
                asterism.mds(DISTANCES, anchors=anchors)
        masked = np.ma.masked_array(POINTS, np.arange(12).reshape(6, 2) == 5)
        with self.assertRaisesRegex(ValueError, "anchors: row 2 is"):
            asterism.mds(DISTANCES, anchors=masked)
        given = POINTS.copy()
        given[3] = np.nan
        before = given.copy()
        asterism.mds(DISTANCES, anchors=given)
        np.testing.assert_array_equal(given, before)


class RangeTest(unittest.TestCase):
    """Lengths at the ends of the range: the right drawing, or a line that says what is wrong, and no warnings."""

    def setUp(self):
        warnings.simplefilter("error")
        self.addCleanup(warnings.resetwarnings)

    def test_mds(self):
        refused = 0
        for exponent in (-323, -310, -300, -200, -160, -154, -140, -100, -20, 20, 100, 140, 150, 154, 160, 200, 300, 307):
            scale = 10.0**exponent
            for name, distances in (("all", DISTANCES * scale), ("one", np.where(HOLES, scale, DISTANCES))):
                for method in ("multi-start", "newton", "lbfgs-jacobi"):
                    with self.subTest(exponent, which=name, method=method):
                        try:
                            result = asterism.mds(distances, method=method)
                        except ValueError as error:
                            self.assertRegex(str(error), r"^lengths of up to .* and weights of up to .*: another unit")
                            refused += 1
                            continue
                        self.assertTrue(np.isfinite(result.x).all() and np.isfinite(result.stress))
                        if name == "all" and method == "multi-start":
                            found = np.linalg.norm(result.x[:, None] - result.x, axis=2)
                            np.testing.assert_allclose(found / scale, DISTANCES, atol=1e-5)
        self.assertGreater(refused, 10)
        asterism.mds(np.zeros((3, 3)))

    def test_layout(self):
        for edges, message in (
            ([(0, 1, 1e-160), (1, 2, 1), (2, 3, 1)], r"graph: a path of length 1e-160 has the weight 1e-160 \*\* -2.0, which is out of range"),
            ([(0, 1, 1e200), (1, 2, 1)], r"graph: a path of length 1e\+200 has the weight"),
        ):
            for partners in (None, 1):
                with self.subTest(edges), self.assertRaisesRegex(ValueError, message):
                    asterism.layout(edges, partners=partners)
        for scale in (1e-100, 1e100):
            result = asterism.layout([(0, 1, scale), (1, 2, scale)])
            self.assertAlmostEqual(np.linalg.norm(result.x[2] - result.x[0]) / scale, 2, 6)


class MessagesTest(unittest.TestCase):
    @unittest.skipIf(networkx is None, "networkx is not installed")
    def test_the_weights_of_networkx_are_not_ignored_silently(self):
        graph = networkx.Graph()
        graph.add_edge("a", "b", weight=2.0)
        graph.add_edge("b", "c", weight=3.0)
        for draw in (asterism.layout, lambda g, **options: asterism.layout_stress(g, np.eye(3, 2), **options)):
            with self.assertWarnsRegex(UserWarning, "'weight' and no 'length'.*length='weight'"):
                draw(graph)
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                draw(graph, length=None)
                draw(graph, length="weight")
        drawn = asterism.layout(graph, length="weight")
        self.assertAlmostEqual(np.linalg.norm(drawn.x[2] - drawn.x[0]), 5, 6)
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            networkx.set_edge_attributes(graph, 7.0, "length")
            self.assertAlmostEqual(np.linalg.norm(np.diff(asterism.layout(graph).x[:2], axis=0)), 7, 6)

    def test_a_summary_without_a_solve_names_the_solver(self):
        for dim in (2, 3):
            system = asterism.SpringSystem(asterism.Topology.full(3), dim)
            system.anchors, system.anchor_stiffness, system.rest_length, system.link_stiffness = 0, 1, 1, 1
            summary = asterism.solve(system, system.anchors, "newton", check=False)
            self.assertEqual(summary.solver, asterism.solve(system, system.anchors.copy(), "newton").solver)
            self.assertIn("Newton", str(summary))

    @unittest.skipUnless(hasattr(asterism, "Tracker"), "built without trackers")
    def test_regions(self):
        frame = draw_frame(0)
        for box, message in (
            ((10, 10, -5, 20), r"a width and height above 0, found -5.0 x 20.0"),
            ((10, 10, np.nan, 20), "finite numbers, found nan"),
            ((10, 10, 20), r"x, y, width, height, the corners of a polygon, .* found int64 of shape \(3,\)"),
            (np.zeros(frame.shape[:2]), r".*a mask of bool or uint8, found float64 of shape"),
            ("box", "numbers or a mask, found str"),
        ):
            with self.subTest(message), self.assertRaisesRegex(ValueError, "the object: expected " + message):
                asterism.Tracker("kcf").init(frame, box)


if __name__ == "__main__":
    unittest.main()
