#!/usr/bin/env python3
"""Spring systems and solvers from Python, against NumPy and SciPy."""

import contextlib
import copy
import json
import pathlib
import pickle
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
import unittest
import warnings

import asterism
import numpy as np
import scipy.optimize

try:
    import jsonschema
except ImportError:
    jsonschema = None


def random_system(nodes=6, dim=2, seed=1):
    """A system whose start is in the basin of a minimum nearby."""
    random = np.random.default_rng(seed)
    points = random.uniform(0, 10, (nodes, dim))
    system = asterism.SpringSystem(asterism.Topology.full(nodes), dim)
    system.set_rest_lengths(points)
    system.rest_length *= random.uniform(0.95, 1.05, system.link_count)
    system.anchors = points + random.normal(scale=0.3, size=points.shape)
    system.anchor_stiffness = random.uniform(0.5, 2, nodes)
    system.link_stiffness = random.uniform(0.5, 2, system.link_count)
    return system, points + random.normal(scale=0.1, size=points.shape)


def energy(system, x):
    """The energy as docs/solver.md has it, written a second time."""
    i, j = system.topology.links.T
    stretch = system.rest_length - np.linalg.norm(x[i] - x[j], axis=1)
    anchors = np.sum((x - system.anchors) ** 2, axis=1)
    return 0.5 * np.sum(system.anchor_stiffness * anchors) + 0.5 * np.sum(system.link_stiffness * stretch**2)


def differences(function, x, step=1e-5):
    """Central differences of a function of x, by the flat index of x."""
    result = []
    for i in range(x.size):
        up, down = x.copy(), x.copy()
        up.flat[i] += step
        down.flat[i] -= step
        result.append((function(up) - function(down)) / (2 * step))
    return np.array(result)


class TopologyTest(unittest.TestCase):
    def test_links(self):
        np.testing.assert_array_equal(asterism.Topology.full(3).links, [[0, 1], [0, 2], [1, 2]])
        np.testing.assert_array_equal(asterism.Topology.star(4, 2).links, [[2, 0], [2, 1], [2, 3]])
        links = [(0, 3), (1, 2), (1, 2)]
        np.testing.assert_array_equal(asterism.Topology.from_links(4, links).links, links)
        self.assertEqual(asterism.Topology.from_links(4, []).link_count, 0)
        line = np.arange(5.0)[:, None] * [1, 2, 3]
        np.testing.assert_array_equal(asterism.Topology.k_nearest(line, 1).links, [[0, 1], [1, 2], [2, 3], [3, 4]])
        self.assertFalse(asterism.Topology.full(3).links.flags.writeable)

    def test_refuses_what_is_no_topology(self):
        for links, error, message in [
            ([(0, 9)], ValueError, r"link 0 has an end that is out of range: \[0, 9\], of . nodes"),
            ([(0, 1), (2, 2)], ValueError, "link 1 joins a node to itself"),
            ([(0, 2**40)], ValueError, "link 0 has an end that is out of range"),
            ([(0, 1, 2)], ValueError, r"shape \(count, 2\), found \(1, 3\)"),
            ([(0.5, 1)], TypeError, "expected integers, found float64"),
        ]:
            with self.assertRaisesRegex(error, message):
                asterism.Topology.from_links(4, links)
        with self.assertRaisesRegex(ValueError, "node count -1 is negative"):
            asterism.Topology.full(-1)
        with self.assertRaisesRegex(ValueError, "not finite"):
            asterism.Topology.k_nearest(np.full((3, 2), np.nan), 1)
        with self.assertRaisesRegex(ValueError, r"points: expected shape \(N, 2\) or \(N, 3\), found \(3, 4\)"):
            asterism.Topology.k_nearest(np.zeros((3, 4)), 1)


class SystemTest(unittest.TestCase):
    def test_arrays_are_the_systems_memory(self):
        system, x = random_system()
        for name in ("anchors", "anchor_stiffness", "rest_length", "link_stiffness"):
            with self.subTest(name):
                view = getattr(system, name)
                self.assertTrue(np.shares_memory(view, getattr(system, name)))
                self.assertTrue(view.flags.c_contiguous and view.flags.writeable)
                before = asterism.energy(system, x)
                view *= 1.5
                self.assertNotEqual(asterism.energy(system, x), before)
                self.assertAlmostEqual(asterism.energy(system, x), energy(system, x), places=10)

    def test_a_view_keeps_its_system_alive(self):
        anchors = random_system()[0].anchors
        expected = random_system()[0].anchors.copy()
        [random_system(seed=s) for s in range(50)]  # would overwrite memory that was freed
        np.testing.assert_array_equal(anchors, expected)

    def test_values_are_set_by_copying(self):
        system, _ = random_system()
        view = system.anchors
        system.anchors = np.arange(12).reshape(6, 2)  # converted from another type
        np.testing.assert_array_equal(view, np.arange(12.0).reshape(6, 2))
        with self.assertRaises(ValueError):
            system.anchors = np.zeros((5, 2))

    def test_shapes(self):
        for dim in (2, 3):
            system = asterism.SpringSystem(asterism.Topology.full(5), dim=dim)
            self.assertEqual((system.nodes, system.link_count, system.dim), (5, 10, dim))
            self.assertEqual(system.anchors.shape, (5, dim))
            self.assertEqual(system.rest_length.shape, (10,))
        one = asterism.SpringSystem(asterism.Topology.full(1))
        self.assertEqual(one.anchors.shape, (1, 2))
        self.assertEqual(one.anchor_stiffness.shape, (1,))
        with self.assertRaisesRegex(ValueError, "dim: expected 2 or 3, found 4"):
            asterism.SpringSystem(asterism.Topology.full(2), dim=4)

    def test_fixed_nodes(self):
        system, start = random_system()
        system.fix(2)
        self.assertEqual([system.is_fixed(i) for i in range(6)], [False, False, True, False, False, False])
        x = start.copy()
        self.assertTrue(asterism.solve(system, x).usable)
        np.testing.assert_array_equal(x[2], start[2])
        self.assertFalse(np.array_equal(x[1], start[1]))
        system.release(2)
        asterism.solve(system, x)
        self.assertFalse(np.array_equal(x[2], start[2]))
        with self.assertRaisesRegex(IndexError, r"node 6 is out of range \(6 nodes\)"):
            system.fix(6)


class FunctionsTest(unittest.TestCase):
    def test_against_numpy(self):
        for dim in (2, 3):
            with self.subTest(dim=dim):
                system, x = random_system(dim=dim)
                self.assertAlmostEqual(asterism.energy(system, x), energy(system, x), places=12)
                gradient = differences(lambda y: energy(system, y), x).reshape(x.shape)
                np.testing.assert_allclose(asterism.gradient(system, x), gradient, atol=1e-7)
                hessian = differences(lambda y: asterism.gradient(system, y).ravel(), x)
                np.testing.assert_allclose(asterism.hessian(system, x), hessian, atol=1e-7)
                np.testing.assert_array_equal(asterism.sparse_hessian(system, x).toarray(), asterism.hessian(system, x))

    def test_covariance_is_the_inverse_of_the_hessian(self):
        for dim in (2, 3):
            system, x = random_system(dim=dim)
            asterism.solve(system, x)
            expected = np.linalg.inv(asterism.hessian(system, x))
            np.testing.assert_allclose(asterism.covariance(system, x), expected, atol=1e-12)
            blocks = [expected[dim * i : dim * (i + 1), dim * i : dim * (i + 1)] for i in range(len(x))]
            np.testing.assert_allclose(asterism.node_covariances(system, x), blocks, atol=1e-12)

    def test_there_is_no_covariance_at_a_saddle(self):
        system = asterism.SpringSystem(asterism.Topology.full(2))
        system.anchors = 0
        system.anchor_stiffness = 1e-3
        system.rest_length = 5
        system.link_stiffness = 1
        with self.assertRaisesRegex(np.linalg.LinAlgError, "not positive definite"):
            asterism.covariance(system, np.array([[0.0, 0], [0.1, 0]]))

    def test_there_is_no_covariance_of_a_free_rotation(self):
        for dim, held, motion in ((2, [1], "about node 1"), (3, [0, 2], "about the line through nodes 0 and 2")):
            system, x = random_system(dim=dim)
            stiffness = np.zeros(len(x))
            stiffness[held] = 0.5
            system.anchor_stiffness = stiffness
            summary = asterism.solve(system, x)
            self.assertTrue(summary.usable)
            self.assertIs(summary.positive_definite, False)
            for function in (asterism.covariance, asterism.node_covariances):
                with self.assertRaisesRegex(np.linalg.LinAlgError, motion):
                    function(system, x)

    def test_a_certificate_bounds_what_many_starts_find(self):
        rng = np.random.default_rng(1)
        certified = 0
        for dim in (2, 3):
            for seed in range(20):
                system, x = random_system(dim=dim, seed=seed)
                asterism.solve(system, x)
                certificate = asterism.certify(system, x)
                self.assertAlmostEqual(certificate.energy, asterism.energy(system, x))
                lowest = certificate.energy
                for _ in range(20):
                    start = x + rng.uniform(-1, 1, x.shape) * np.ptp(x)
                    lowest = min(lowest, asterism.solve(system, start).final_energy)
                self.assertLessEqual(certificate.lower_bound, lowest * (1 + 1e-12))
                self.assertEqual(bool(certificate), certificate.certified)
                if certificate.certified:
                    certified += 1
                    self.assertLess(certificate.gap, 1e-6)
                    self.assertGreaterEqual(lowest, certificate.energy * (1 - 1e-6))
                else:
                    self.assertIn(certificate.proof, ("not certified", "not applicable"))
                    self.assertTrue(certificate.reason)
        self.assertGreater(certified, 0)

    def test_a_solve_ends_at_the_gap_asked_for(self):
        system, start = random_system()
        x = start.copy()
        asterism.solve(system, x)
        self.assertTrue(asterism.certify(system, x), asterism.certify(system, x))
        x = start.copy()
        summary = asterism.solve(system, x, method="ida", gap=0.01)
        self.assertEqual(summary.status, asterism.Status.CONVERGED)
        self.assertLessEqual(summary.final_energy - summary.lower_bound, 0.01 * summary.final_energy)
        self.assertTrue(np.isnan(asterism.solve(system, start.copy()).lower_bound))
        with self.assertRaisesRegex(ValueError, "gap"):
            asterism.certify(system, x, gap=-1)

    def test_unset_values_are_errors(self):
        system = asterism.SpringSystem(asterism.Topology.full(3))
        for function in (asterism.energy, asterism.gradient, asterism.hessian, asterism.covariance):
            with self.assertRaisesRegex(ValueError, r"anchors were not set \(anchor 0 is NaN\)"):
                function(system, np.zeros((3, 2)))


class SolveTest(unittest.TestCase):
    def test_every_method_finds_scipys_minimum(self):
        for dim in (2, 3):
            system, start = random_system(dim=dim)
            expected = scipy.optimize.minimize(lambda y: energy(system, y.reshape(start.shape)), start.ravel(), tol=1e-10)
            for method in asterism.methods():
                with self.subTest(method=method, dim=dim):
                    x = start.copy()
                    summary = asterism.solve(system, x, method=method, tolerance=1e-6)
                    self.assertEqual(summary.status, asterism.Status.CONVERGED, summary)
                    np.testing.assert_allclose(x.ravel(), expected.x, atol=1e-3)
                    self.assertAlmostEqual(summary.final_energy, energy(system, x), places=12)
                    self.assertLess(summary.final_energy, expected.fun + 1e-8)

    def test_methods(self):
        methods = asterism.methods()
        self.assertEqual(len(methods), len(set(methods)))
        self.assertLessEqual({"auto", "ida", "newton", "lbfgs", "schwarz", "multi-start", "staircase", "branch-and-bound"}, set(methods))
        with self.assertRaisesRegex(ValueError, "unknown method 'idas', did you mean 'ida'.* .known: auto, ida, "):
            asterism.Solver("idas")

    def test_a_solver_is_reused(self):
        solver = asterism.Solver("ida", tolerance=1e-10, relaxation=1.5)
        self.assertEqual(solver.options["relaxation"], 1.5)
        self.assertEqual(solver.options["max_iterations"], 10000)
        for nodes, dim in ((4, 2), (9, 3), (5, 2)):
            system, x = random_system(nodes, dim)
            alone = x.copy()
            summary = solver.solve(system, x)
            self.assertEqual(summary.status, asterism.Status.CONVERGED)
            self.assertLessEqual(asterism.stationarity(system, x), 1e-10)
            asterism.solve(system, alone, "ida", tolerance=1e-10, relaxation=1.5)
            np.testing.assert_array_equal(x, alone)

    def test_options(self):
        system, start = random_system()
        x = start.copy()
        summary = asterism.solve(system, x, "ida", max_iterations=2)
        self.assertEqual((summary.status, summary.iterations), (asterism.Status.MAX_ITERATIONS, 2))
        with self.assertRaisesRegex(TypeError, "'newton' has no option 'relaxation' .it has: tolerance, "):
            asterism.Solver("newton", relaxation=1.5)

    def test_on_iteration(self):
        system, start = random_system(6)
        for method in asterism.methods():
            with self.subTest(method=method):
                seen = []
                x = start.copy()

                def look(iteration, at, value, norm):
                    seen.append((iteration, at, value, norm))

                summary = asterism.solve(system, x, method, on_iteration=look, tolerance=1e-6)
                self.assertEqual(summary.status, asterism.Status.CONVERGED)
                self.assertEqual(seen[0][0], 0)
                for iteration, at, value, norm in seen:
                    self.assertAlmostEqual(value, energy(system, at), places=9)
                    self.assertGreaterEqual(norm, 0)
                self.assertLess(seen[-1][2], seen[0][2])
                if method not in ("multi-start", "staircase", "branch-and-bound"):
                    self.assertEqual([s[0] for s in seen], sorted({s[0] for s in seen}))
                    np.testing.assert_allclose(seen[-1][1], x, atol=1e-4)

    def test_on_iteration_has_to_be_a_function(self):
        system, start = random_system(6)
        with self.assertRaisesRegex(TypeError, "on_iteration: expected a function, found int"):
            asterism.solve(system, start.copy(), on_iteration=3)
        with self.assertRaisesRegex(ValueError, "truth value"):
            asterism.solve(system, start.copy(), on_iteration=lambda *_: np.zeros(2))
        self.assertTrue(asterism.solve(system, start.copy(), on_iteration=lambda *_: "go on"))

    def test_assigned_arrays_of_another_shape(self):
        system, _ = random_system(6)
        batch = asterism.SpringBatch(system.topology, 3)
        for target, name, message in [
            (system, "anchors", r"anchors: expected shape \(6, 2\), found \(4, 2\)"),
            (system, "link_stiffness", r"link_stiffness: expected shape \(15,\), found \(4, 2\)"),
            (batch, "anchors", r"anchors: expected shape \(3, 6, 2\), found \(4, 2\)"),
        ]:
            with self.subTest(message), self.assertRaisesRegex(ValueError, message):
                setattr(target, name, np.zeros((4, 2)))

    def test_one_of_something_is_in_the_singular(self):
        self.assertEqual(repr(asterism.Topology.full(2)), "<asterism.Topology: 2 nodes, 1 link>")
        self.assertEqual(repr(asterism.SpringBatch(asterism.Topology.full(1), 1)), "<asterism.SpringBatch: 1 system of 1 node, dim 2>")
        self.assertEqual(repr(asterism.mds(np.zeros((1, 1)))), "<asterism.Embedding: 1 node, dim 2, stress 0, proven least>")
        system = asterism.System(1)
        system.add_anchors([[1, 2]])
        self.assertEqual(repr(system), "<asterism.System: 1 node, dim 2; 1 anchor>")
        system, start = random_system(6)
        summary = asterism.solve(system, start.copy(), "ida", max_iterations=1)
        self.assertRegex(repr(summary), "<asterism.Summary: maximum number of iterations, 1 iteration, energy ")

    def test_on_iteration_ends_the_solve(self):
        system, start = random_system(6)
        x = start.copy()
        summary = asterism.solve(system, x, "ida", on_iteration=lambda iteration, *_: iteration < 3)
        self.assertEqual((summary.status, summary.iterations), (asterism.Status.INTERRUPTED, 3))

        def fail(*_):
            raise KeyError("mine")

        solver = asterism.Solver("newton")
        with self.assertRaisesRegex(KeyError, "mine"):
            solver.solve(system, x, on_iteration=fail)
        self.assertTrue(solver.solve(system, x))  # the callback is not kept

    def test_options_of_every_kind_of_number(self):
        solver = asterism.Solver("multi-start")
        numbers = {bool: [], int: [], float: []}
        for name, value in solver.options.items():
            numbers[type(value)].append(name)
        self.assertTrue(all(numbers.values()), numbers)
        taken = {
            bool: [False, np.bool_(False), np.array(False)],
            int: [3, np.int64(3), np.int8(3), np.uint64(3), np.array(3), np.array(3, ">i4")],
            float: [3, 0.5, np.float32(0.5), np.float64(0.5), np.float16(0.5), np.int64(3), np.longdouble(0.5), np.array(0.5, ">f4")],
        }
        refused = {
            bool: [0, 1, np.int64(1), "True", None, np.array([True]), np.float64(1)],
            int: [1.5, 2.0, np.float32(2), True, np.bool_(True), "3", None, np.array([3]), np.array(2.0), 3j],
            float: [True, np.bool_(True), "0.5", None, np.array([0.5]), 1j, np.complex128(1)],
        }
        for kind, names in numbers.items():
            for name in names:
                for value in taken[kind]:
                    with self.subTest(name, value=repr(value)):
                        found = asterism.Solver("multi-start", **{name: value}).options[name]
                        self.assertEqual(found, value)
                        self.assertIs(type(found), kind)
                for value in refused[kind]:
                    with self.subTest(name, value=repr(value)), self.assertRaisesRegex(TypeError, f"option {name}: expected "):
                        asterism.Solver("multi-start", **{name: value})
        for name in numbers[int]:
            for value in (2**70, -(2**70)):
                with self.subTest(name, value=value), self.assertRaisesRegex(ValueError, f"option {name}: expected an integer from .*, found {value}"):
                    asterism.Solver("multi-start", **{name: value})

    def test_counts_are_whole_numbers(self):
        system, _ = random_system()
        topology = asterism.Topology.full(3)
        points = np.zeros((4, 2))
        batch = asterism.SpringBatch(topology, 0)
        calls = [
            lambda n: asterism.Topology.full(n),
            lambda n: asterism.Topology.star(n, 0),
            lambda n: asterism.Topology.star(3, n),
            lambda n: asterism.Topology.k_nearest(points, n),
            lambda n: asterism.Topology.from_links(n, [(0, 1)]),
            lambda n: asterism.SpringSystem(topology, n),
            lambda n: system.fix(n),
            lambda n: system.is_fixed(n),
            lambda n: system.release(n),
            lambda n: asterism.SpringBatch(topology, n),
            lambda n: asterism.SpringBatch(topology, 1, n),
            lambda n: batch.solve(threads=n),
            lambda n: batch.solve(max_iterations=n),
        ]
        for i, call in enumerate(calls):
            for n in (2, np.int64(2), np.uint8(2), np.array(2)):
                with self.subTest(i, n=repr(n)):
                    call(n)
            for n in (2.0, 2.7, np.float32(2.7), "2", None, np.array([2, 2])):
                with self.subTest(i, n=repr(n)), self.assertRaises(TypeError):
                    call(n)
            with self.subTest(i), self.assertRaisesRegex(ValueError, "1099511627776 is out of range"):
                call(2**40)

    def test_summary(self):
        system, x = random_system()
        summary = asterism.solve(system, x, "newton")
        self.assertEqual(summary.as_dict()["final_energy"], summary.final_energy)
        self.assertIs(summary.positive_definite, True)
        self.assertRegex(repr(summary), r"^<asterism.Summary: converged, \d+ iterations, energy [^,]*>$")
        self.assertRegex(str(summary), "^Newton.*: converged after .* iterations, energy ")

    def test_seconds_are_measured_on_request(self):
        system, x = random_system()
        summary = asterism.solve(system, x.copy(), "newton")
        self.assertIsNone(summary.seconds)
        self.assertIsNone(summary.as_dict()["seconds"])
        self.assertNotIn(" s (", str(summary))
        timed = asterism.solve(system, x.copy(), "newton", measure_seconds=True)
        self.assertGreater(timed.seconds, 0)
        self.assertIn(" s (", str(timed))

    def test_a_summary_is_true_where_it_is_usable(self):
        system, start = random_system()
        self.assertTrue(asterism.solve(system, start.copy()))
        self.assertTrue(asterism.solve(system, start.copy(), "ida", max_iterations=2))  # no worse than the start
        self.assertFalse(asterism.solve(system, np.full_like(start, np.nan), check=False))
        self.assertFalse(asterism.solve(system, start.copy(), tolerance=-1.0, check=False))

    def test_status_is_a_number_to_numpy_and_a_name_to_readers(self):
        Status = asterism.Status
        system, x = random_system()
        status = asterism.solve(system, x).status
        self.assertIs(status, Status.CONVERGED)
        self.assertEqual(status, int(Status.CONVERGED))
        self.assertEqual((str(status), f"{status}", f"{status:>17}"), ("Status.CONVERGED", "Status.CONVERGED", " Status.CONVERGED"))
        self.assertEqual(repr(status), f"<Status.CONVERGED: {int(status)}>")
        self.assertIs(pickle.loads(pickle.dumps(status)), status)
        self.assertIs(copy.deepcopy(status), status)
        self.assertEqual(json.dumps(status), str(int(status)))
        self.assertEqual({status: 1}[int(status)], 1)
        for member in Status:
            self.assertIn(f"{member.name}: ", Status.__doc__)
            array = np.array([int(member), -1, int(member)], np.int32)
            np.testing.assert_array_equal(array == member, [True, False, True])
            np.testing.assert_array_equal(member == array, [True, False, True])
            np.testing.assert_array_equal(array != member, [False, True, False])
            np.testing.assert_array_equal(np.isin(array, [member]), [True, False, True])
            self.assertEqual(np.count_nonzero(array == member), 2)
            self.assertIs(Status(array[0]), member)
            self.assertIs(Status[member.name], member)

    def test_what_a_solver_refuses_is_raised(self):
        nan = np.full((4, 2), np.nan)
        springs = asterism.SpringSystem(asterism.Topology.full(4))
        x = np.eye(4, 2)
        terms = asterism.System(4)
        terms.add_links([[0, 1]], 1)
        for solve in (lambda: asterism.solve(springs, x), lambda: asterism.Solver("ida").solve(springs, x)):
            for array, value in [("anchors", x), ("anchor_stiffness", 1), ("rest_length", 1), ("link_stiffness", 1)]:
                getattr(springs, array)[:] = np.nan
            for array, message, value in [
                ("anchors", "anchors were not set (anchor 0 is NaN)", x),
                ("anchor_stiffness", "anchor stiffness was not set (entry 0 is NaN)", 1),
                ("rest_length", "rest length was not set (entry 0 is NaN)", 1),
                ("link_stiffness", "link stiffness was not set (entry 0 is NaN)", 1),
            ]:
                with self.assertRaisesRegex(ValueError, f"^{re.escape(message)}$"):
                    solve()
                getattr(springs, array)[:] = value
            self.assertTrue(solve())
        for message, call in {
            r"x: expected finite numbers, found \[nan, nan\] at \[0\]": lambda: asterism.solve(springs, nan),
            "tolerance": lambda: asterism.solve(springs, x, tolerance=-1.0),
            "x shares memory": lambda: asterism.solve(springs, springs.anchors),
            r"^x: expected finite numbers, found \[nan, nan\] at \[0\]": lambda: terms.solve(nan),
        }.items():
            with self.subTest(message), self.assertRaisesRegex(ValueError, message):
                call()
        self.assertEqual(repr(asterism.solve(springs, x)).splitlines(), [repr(asterism.solve(springs, x))])

    def test_names_of_other_libraries_are_answered(self):
        system, x = random_system()
        terms = asterism.System(2)
        for name, ours in {
            "levenberg-marquardt": "use 'newton' ", "lm": "use 'newton' ", "Gauss-Newton": "use 'newton' ", "smacof": "use 'ida'", "SMACOF": "use 'ida'",
            "BFGS": "use 'lbfgs'", "L-BFGS-B": "use 'lbfgs'", "CG": "use 'ncg'", "basinhopping": "use 'multi-start'", "GNC": "use 'graduated'",
            "L-BFGS": "did you mean 'lbfgs'", "NEWTON_CG": "did you mean 'newton-cg'", "newtn": "did you mean 'newton'",
        }.items():
            for call in (lambda: asterism.solve(system, x, name), lambda: asterism.Solver(name), lambda: terms.solve(np.eye(2), name)):
                with self.subTest(name), self.assertRaisesRegex(ValueError, f"^unknown method '{name}'.*{ours}.*known: auto, "):
                    call()
        if "ceres-dense" in asterism.methods():
            with self.assertRaisesRegex(ValueError, "as a reference: 'ceres-dense'"):
                asterism.solve(system, x, "ceres")
        for name, ours in {"max_iter": "'max_iterations'", "eps": "'tolerance'", "tolerence": "'tolerance'", "n_jobs": "'threads'"}.items():
            with self.subTest(name), self.assertRaisesRegex(TypeError, f"^the default method 'auto' has no option '{name}'.*{ours}"):
                asterism.solve(system, x, **{name: 1})
        with self.assertRaisesRegex(TypeError, "'seed' is an option of the method 'multi-start'"):
            asterism.solve(system, x, "ida", random_state=1)

    def test_what_a_solver_refuses_is_in_the_summary(self):
        system, start = random_system()
        system.anchors[2, 1] = np.nan
        x = start.copy()
        summary = asterism.solve(system, x, check=False)
        self.assertEqual(summary.status, asterism.Status.INVALID_INPUT)
        self.assertEqual(summary.message, "anchor 2 is not finite")
        self.assertEqual(repr(summary), "<asterism.Summary: invalid input: anchor 2 is not finite>")
        self.assertFalse(summary.usable)
        np.testing.assert_array_equal(x, start)
        self.assertEqual(asterism.solve(*random_system(), tolerance=-1.0, check=False).status, asterism.Status.INVALID_INPUT)

    def test_covariances_of_a_start_are_warned_of(self):
        system, x = random_system()
        asterism.solve(system, x)
        start = x + 0.5 * np.ptp(x) * np.random.default_rng(1).normal(size=x.shape)
        for function in (asterism.covariance, asterism.node_covariances):
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                function(system, x)
            with self.assertWarnsRegex(UserWarning, r"x: expected the solution of the system, found a stationarity of [0-9.]+: .*, so solve first") as caught:
                with contextlib.suppress(np.linalg.LinAlgError):
                    function(system, start)
            self.assertEqual(caught.filename, __file__)

    def test_a_refused_value_is_shown(self):
        for change, message in [
            ({"anchor_stiffness": [1, -2, 1, 1]}, r"anchor_stiffness: expected finite numbers >= 0, found -2.0 at \[1\]"),
            ({"rest_length": [1, 1, 1, 1, 1, np.inf]}, r"rest_length: expected finite numbers >= 0, found inf at \[5\]"),
            ({"link_stiffness": [1, 1, -1, 1, 1, 1]}, r"link_stiffness: expected finite numbers >= 0, found -1.0 at \[2\]"),
            ({"anchors": [[0, 0], [1, 0], [0, np.inf], [1, 1]]}, r"anchors: expected finite numbers, found \[0.0, inf\] at \[2\]"),
            ({"loads": [[0, 0], [1, 0], [0, 1], [np.nan, 1]]}, r"loads: expected finite numbers, found \[nan, 1.0\] at \[3\]"),
        ]:
            system = asterism.SpringSystem(asterism.Topology.full(4))
            system.anchors, system.anchor_stiffness, system.rest_length, system.link_stiffness = 0, 1, 1, 1
            x = np.arange(8.0).reshape(4, 2)
            for name, values in change.items():
                setattr(system, name, values)
            for call in (asterism.solve, asterism.energy):
                with self.subTest(message, call=call), self.assertRaisesRegex(ValueError, f"^{message}$"):
                    call(system, x)
        system = asterism.System(2)
        system.add_anchors([[0, 0], [1, 1]], 1)
        for solve in (system.solve, lambda x, *rest, **options: asterism.solve(random_system()[0], random_system()[1], *rest, **options)):
            for options, message in [
                ({"tolerance": -1}, "option tolerance is negative or not finite, found -1.0"),
                ({"method": "multi-start", "starts": 0}, "option starts is not positive, found 0"),
                ({"method": "ida", "relaxation": 3}, "option relaxation is not between 0 and 2, found 3.0"),
            ]:
                with self.subTest(message), self.assertRaisesRegex(ValueError, f"^{message}$"):
                    solve(np.zeros((2, 2)), **options)
        with self.assertRaisesRegex(ValueError, r"^x: expected finite numbers, found \[nan, nan\] at \[0\]$"):
            system.solve(np.full((2, 2), np.nan))
        with self.assertRaisesRegex(ValueError, "option starts is not positive, found 0"):
            asterism.mds(np.ones((3, 3)), starts=0)

    def test_x_in_the_systems_memory_is_refused(self):
        for dim in (2, 3):
            system, _ = random_system(nodes=8, dim=dim)
            arrays = ("anchors", "anchor_stiffness", "rest_length", "link_stiffness")
            before = [getattr(system, name).copy() for name in arrays]
            links = system.link_stiffness
            for x in (system.anchors, links[: system.nodes * dim].reshape(-1, dim)):
                for method in asterism.methods():
                    with self.subTest(method=method, dim=dim):
                        summary = asterism.solve(system, x, method, check=False)
                        self.assertEqual(summary.status, asterism.Status.INVALID_INPUT)
                        self.assertIn("x shares memory with the system", summary.message)
            for name, values in zip(arrays, before):
                np.testing.assert_array_equal(getattr(system, name), values)
            self.assertTrue(asterism.solve(system, system.anchors.copy()).usable)

    def test_springs_without_stiffness_are_off(self):
        system, start = random_system()
        system.anchor_stiffness[2] = system.link_stiffness[3] = 0
        expected = start.copy()
        energy_there = asterism.solve(system, expected).final_energy
        for idle in (1e160, np.finfo(float).max):
            system.anchors[2] = (idle, -idle)
            system.rest_length[3] = idle
            x = start.copy()
            self.assertEqual(asterism.solve(system, x).final_energy, energy_there)
            np.testing.assert_array_equal(x, expected)
            self.assertEqual(asterism.energy(system, x), energy_there)

    def test_a_start_far_off_does_not_loosen_the_tolerance(self):
        for off in (1e5, 1e15, 1e18):
            system, x = random_system()
            x += off
            summary = asterism.solve(system, x)
            self.assertEqual(summary.status, asterism.Status.CONVERGED)
            self.assertLessEqual(asterism.stationarity(system, x), 1e-8)

    def test_refuses_other_arrays_for_the_result(self):
        system, x = random_system()
        read_only = x.copy()
        read_only.flags.writeable = False
        for bad, error, message in [
            (x.tolist(), TypeError, "list"),
            (x.astype(np.float32), TypeError, "float32"),
            (x.astype(int), TypeError, "int64"),
            (x.astype(">f8"), TypeError, ">f8"),
            (x[:-1], ValueError, r"shape \(5, 2\)"),
            (x.ravel(), ValueError, r"shape \(12,\)"),
            (np.array(1.0), ValueError, r"shape \(\)"),
            (x.astype(complex), TypeError, "complex128"),
            (x.astype(object), TypeError, "object"),
            (x.astype(np.longdouble), TypeError, "float128|longdouble"),
            (np.float64(1), TypeError, "float64"),
            (None, TypeError, "NoneType"),
            (np.asfortranarray(x), ValueError, "one that is not C-contiguous"),
            (np.repeat(x, 2, axis=0)[::2], ValueError, "one that is not C-contiguous"),
            (np.frombuffer(b"0" + x.tobytes(), np.uint8)[1:].view(float).reshape(6, 2), ValueError, "one that is not"),
            (read_only, ValueError, "one that is read-only"),
        ]:
            begin = (
                "x: the result is written into it, so expected a C-contiguous, writeable NumPy array of float64 and shape "
                r"\(6, 2\); found "
            )
            with self.subTest(message), self.assertRaisesRegex(error, begin + f"({message})"):
                asterism.solve(system, bad)


class InputTest(unittest.TestCase):
    """Arrays that are only read may be of any numbers."""

    def functions(self, system):
        for function in (asterism.energy, asterism.gradient, asterism.hessian, asterism.stationarity, asterism.node_covariances):
            yield lambda x, function=function: function(system, x)
        yield lambda x: asterism.certify(system, x).energy
        yield lambda x: asterism.sparse_hessian(system, x).toarray()
        yield lambda x: asterism.Topology.k_nearest(x, 2).links
        yield lambda x: system.set_rest_lengths(x)
        if hasattr(asterism, "read_systems"):
            yield lambda x: asterism._asterism._system_to_json(system, x, "", "{}")

    def test_taken(self):
        system, x = random_system()
        whole = np.round(x)
        read_only = whole.copy()
        read_only.flags.writeable = False
        for k, function in enumerate(self.functions(system)):
            expected = function(whole)
            for name, given in {
                "list": whole.tolist(),
                "tuples": tuple(map(tuple, whole)),
                "integers": whole.astype(int),
                "small integers": whole.astype(np.int8),
                "float32": whole.astype(np.float32),
                "float16": whole.astype(np.float16),
                "long double": whole.astype(np.longdouble),
                "another byte order": whole.astype(">f8"),
                "columns first": np.asfortranarray(whole),
                "every second row": np.repeat(whole, 2, axis=0)[::2],
                "not aligned": np.frombuffer(b"0" + whole.tobytes(), np.uint8)[1:].view(float).reshape(6, 2),
                "read-only": read_only,
            }.items():
                with self.subTest(name, function=k):
                    np.testing.assert_array_equal(function(given), expected)

    def test_refused(self):
        system, x = random_system()
        shape = r"x|points|start"
        for k, function in enumerate(self.functions(system)):
            for bad, error, message in [
                (x.astype(complex), TypeError, "expected numbers, found complex128"),
                (x.astype(object), TypeError, "expected numbers, found object"),
                ("x", TypeError, "expected numbers, found <U1"),
                (None, TypeError, "expected numbers, found NoneType"),
                ({}, TypeError, "expected numbers, found dict"),
                (x.ravel(), ValueError, r"expected shape .*, found \(12,\)"),
                (1, ValueError, r"expected shape .*, found \(\)"),
            ]:
                with self.subTest(message, function=k), self.assertRaisesRegex(error, f"({shape}): {message}"):
                    function(bad)

    def test_values(self):
        system, _ = random_system()
        batch = asterism.SpringBatch(system.topology, 2)
        for owner in (system, batch):
            for values in (3, 3.0, np.float32(3), np.full(6, 3, np.int8), [3] * 6, np.full(6, 3, ">f4")):
                owner.anchor_stiffness = values
                self.assertTrue((owner.anchor_stiffness == 3).all())
            owner.anchor_stiffness = np.arange(6) > 2  # on or off
            self.assertEqual(owner.anchor_stiffness[..., :].sum() % 3, 0)
            for bad, found in (("3", "<U1"), (3j, "complex128"), (None, "NoneType"), ([None] * 6, "list")):
                with self.assertRaisesRegex(TypeError, f"anchor_stiffness: expected numbers, found {found}"):
                    owner.anchor_stiffness = bad


def long_solve():
    """One that takes some tenths of a second, without the GIL."""
    nodes = 100
    system, x = random_system(nodes)
    return lambda: asterism.solve(system, x.copy(), "ncg-central", max_iterations=100, tolerance=0.0)


class PackageTest(unittest.TestCase):
    def test_says_why_the_compiled_module_cannot_be_loaded(self):
        source = pathlib.Path(asterism.__file__).parent
        for there, message in [
            ([], "ImportError: asterism: its compiled module is not in .*; build the target asterism_python for Python 3"),
            (
                ["_asterism.cpython-39-x86_64-linux-gnu.so"],
                "ImportError: asterism: its compiled module was built for CPython 3.9 "
                r"\(_asterism.cpython-39-x86_64-linux-gnu.so\), and this is Python 3",
            ),
            (
                ["_asterism.cpython-313t-x86_64-linux-gnu.so", "_asterism.cpython-39-x86_64-linux-gnu.so"],
                "was built for CPython 3.13t and CPython 3.9 ",
            ),
            (["_asterism.pypy39-pp73-x86_64-linux-gnu.so"], "was built for PyPy 3.9 "),
            (["_asterism.other.so"], r"was built for another Python \(_asterism.other.so\)"),
            ([pathlib.Path(asterism._asterism.__file__).name], "ImportError: .*file too short"),
        ]:
            with self.subTest(there), tempfile.TemporaryDirectory() as folder:
                package = pathlib.Path(folder, "asterism")
                shutil.copytree(source, package, ignore=shutil.ignore_patterns("*.so", "__pycache__"))
                for name in there:
                    (package / name).touch()
                command = [sys.executable, "-c", "import sys; sys.path.insert(0, sys.argv[1]); import asterism", folder]
                run = subprocess.run(command, capture_output=True, text=True)
                self.assertEqual(run.returncode, 1)
                self.assertRegex(run.stderr.splitlines()[-1], message)
                self.assertNotIn("circular", run.stderr.splitlines()[-1])


    def test_help_lists_the_classes_and_functions(self):
        command = [sys.executable, "-c", "import asterism; help(asterism)"]
        text = subprocess.run(command, capture_output=True, text=True, check=True).stdout
        classes = text[text.index("\nCLASSES") : text.index("\nFUNCTIONS")]
        for name, value in vars(asterism).items():
            if name.startswith("_"):
                continue
            if isinstance(value, type):
                self.assertIn(f"class {name}(", classes)
                self.assertTrue(value.__module__.startswith("asterism"), name)
            elif callable(value):
                self.assertIn(f"\n    {name}(", text)
            if not isinstance(value, type(sys)):
                self.assertIn(name, asterism.__all__)
        self.assertIn("\n    mds(distances: ", text)


class ThreadsTest(unittest.TestCase):
    def test_the_gil_is_released(self):
        solve = long_solve()
        ticks, stop = [], threading.Event()

        def tick():
            while not stop.is_set():
                ticks.append(time.perf_counter())
                time.sleep(0.001)

        thread = threading.Thread(target=tick)
        thread.start()
        begin = time.perf_counter()
        solve()
        end = time.perf_counter()
        stop.set()
        thread.join()
        self.assertGreater(end - begin, 0.05)
        meanwhile = sum(begin + 0.1 * (end - begin) < t < end - 0.1 * (end - begin) for t in ticks)
        self.assertGreater(meanwhile, 5)

    def test_a_solver_is_for_one_thread_at_a_time(self):
        system, start = random_system(100)
        solver = asterism.Solver("ncg-central", max_iterations=100, tolerance=0.0)
        errors, stop = [], threading.Event()

        def solve():
            while not stop.is_set():
                try:
                    solver.solve(system, start.copy())
                except RuntimeError as error:
                    errors.append(str(error))
                    stop.set()

        threads = [threading.Thread(target=solve) for _ in range(2)]
        for thread in threads:
            thread.start()
        stop.wait(30)
        stop.set()
        for thread in threads:
            thread.join()
        self.assertIn("this asterism.Solver is in use by another thread", errors)
        self.assertTrue(solver.solve(*random_system()).usable)


    # What changes a system.
    CHANGES = {
        **{name: lambda system, name=name: setattr(system, name, 1) for name in ("anchors", "anchor_stiffness", "rest_length", "link_stiffness")},
        "rest_offset": lambda system: setattr(system, "rest_offset", np.ones((system.link_count, 2))),
        "no rest_offset": lambda system: setattr(system, "rest_offset", None),
        "loads": lambda system: setattr(system, "loads", np.ones((system.nodes, 2))),
        "no loads": lambda system: setattr(system, "loads", None),
        "set_rest_lengths": lambda system: system.set_rest_lengths(system.anchors),
        "set_rest_offsets": lambda system: system.set_rest_offsets(system.anchors),
        "fix": lambda system: system.fix(0),
        "release": lambda system: system.release(0),
    }
    WRITES = {
        name: lambda system, name=name: getattr(system, name).__setitem__(0, 7)
        for name in ("anchors", "anchor_stiffness", "rest_length", "link_stiffness", "rest_offset", "loads")
    }

    def loaded_system(self, nodes):
        system, start = random_system(nodes)
        system.rest_offset = np.zeros((system.link_count, 2))
        system.loads = np.zeros((nodes, 2))
        return system, start

    def test_a_system_that_is_solved_cannot_be_changed_by_another_thread(self):
        for nodes in (6, 120):  # also of more links than those that are solved in a thread of their own
            system, start = self.loaded_system(nodes)
            expected, x = start.copy(), start.copy()
            asterism.solve(system, expected)
            begun, tried, errors = threading.Event(), threading.Event(), []

            def wait(*_):
                begun.set()
                tried.wait(60)

            def solve():
                try:
                    asterism.solve(system, x, on_iteration=wait)
                except RuntimeError as error:
                    errors.append(error)

            thread = threading.Thread(target=solve)
            thread.start()
            begun.wait(60)
            before = system.anchors.copy()
            for name, change in self.CHANGES.items():
                with self.subTest(name, nodes=nodes), self.assertRaisesRegex(RuntimeError, "this asterism.SpringSystem is in use"):
                    change(system)
            asterism.energy(system, start)  # several may read it
            asterism.solve(system, start.copy())
            tried.set()
            thread.join()
            self.assertEqual(errors, [])
            np.testing.assert_array_equal(system.anchors, before)
            np.testing.assert_array_equal(x, expected)
            for change in self.CHANGES.values():
                change(system)

    def test_on_iteration_cannot_change_the_system(self):
        for name, change in [*self.CHANGES.items(), *((f"{name}[0]", write) for name, write in self.WRITES.items())]:
            system, start = self.loaded_system(6)
            x = start.copy()
            with self.subTest(name), self.assertRaisesRegex(RuntimeError, "is in use|on_iteration changed the system"):
                asterism.solve(system, x, on_iteration=lambda *_: change(system))
            np.testing.assert_array_equal(x, start)

    def test_a_batch_that_is_solved_cannot_be_changed(self):
        batch = asterism.SpringBatch(asterism.Topology.full(9), 20000)
        points = np.random.default_rng(1).uniform(0, 9, (20000, 9, 2))
        batch.anchors, batch.x, batch.anchor_stiffness, batch.link_stiffness, batch.rest_length = points, points, 0.1, 1, 5
        thread = threading.Thread(target=batch.solve)
        thread.start()
        errors = set()
        while thread.is_alive():
            for name in ("anchors", "anchor_stiffness", "rest_length", "link_stiffness", "x"):
                try:
                    setattr(batch, name, getattr(batch, name)[:1])
                except RuntimeError as error:
                    errors.add(str(error))
        thread.join()
        self.assertEqual(errors, {"this asterism.SpringBatch is in use by another thread"})

    def test_arrays_outlive_their_removal(self):
        for name in ("rest_offset", "loads"):
            system, x = self.loaded_system(6)
            held = getattr(system, name)
            for _ in range(3):
                setattr(system, name, None)
                held[:] = 3  # of no system, but memory
                self.assertIsNone(getattr(system, name))
                setattr(system, name, np.ones_like(held))
                self.assertTrue(np.shares_memory(held, getattr(system, name)))
            system.set_rest_offsets(x)
            del system
            self.assertTrue(np.isfinite(held).all())


class InterruptTest(unittest.TestCase):
    def test_a_long_solve_ends(self):
        random = np.random.default_rng(2)
        points = random.uniform(0, 170, (30000, 2))
        system = asterism.SpringSystem(asterism.Topology.k_nearest(points, 6))
        system.set_rest_lengths(points)
        system.anchors = points + random.uniform(-0.3, 0.3, points.shape)
        system.anchor_stiffness = 1e-6  # IDA would take minutes
        system.link_stiffness = 1
        x = system.anchors.copy()
        solver = asterism.Solver("ida-sparse", max_iterations=10**9, tolerance=1e-12)
        timer = threading.Timer(0.2, lambda: signal.raise_signal(signal.SIGINT))
        timer.start()
        with self.assertRaises(KeyboardInterrupt):
            solver.solve(system, x)
        timer.join()
        np.testing.assert_array_equal(x, system.anchors)
        system.anchor_stiffness = 1
        self.assertTrue(asterism.solve(system, x).usable)


class OffsetTest(unittest.TestCase):
    def test_the_minimum_is_that_of_least_squares(self):
        for dim in (2, 3):
            system, x = random_system(6, dim, 3)
            self.assertIsNone(system.rest_offset)
            shape = x.copy()
            system.set_rest_offsets(shape)
            i, j = system.topology.links.T
            np.testing.assert_array_equal(system.rest_offset, shape[i] - shape[j])
            self.assertTrue((system.rest_length == 0).all())
            differences = np.zeros((len(i), 6))
            differences[np.arange(len(i)), i], differences[np.arange(len(i)), j] = 1, -1
            rows = np.vstack([differences * np.sqrt(system.link_stiffness)[:, None], np.diag(np.sqrt(system.anchor_stiffness))])
            right = np.vstack(
                [system.rest_offset * np.sqrt(system.link_stiffness)[:, None], system.anchors * np.sqrt(system.anchor_stiffness)[:, None]]
            )
            expected = np.linalg.lstsq(rows, right, rcond=None)[0]
            for method in ("auto", "ida", "staircase", "branch-and-bound"):
                x = system.anchors.copy()
                self.assertTrue(asterism.solve(system, x, method))
                np.testing.assert_allclose(x, expected, atol=1e-6)
            self.assertTrue(asterism.certify(system, x).unique)

    def test_assignment(self):
        system, x = random_system(4, 2, 1)
        before = asterism.energy(system, x)
        system.rest_offset = np.zeros((6, 2))
        self.assertEqual(asterism.energy(system, x), before)
        system.rest_offset[0] += 5  # in place
        self.assertEqual(system.rest_offset.tolist(), [[5, 5]] + [[0, 0]] * 5)
        system.rest_offset = [[1, 0]] * 6
        self.assertNotEqual(asterism.energy(system, x), before)
        system.rest_offset = None
        self.assertIsNone(system.rest_offset)
        self.assertEqual(asterism.energy(system, x), before)
        for wrong in (np.zeros((5, 2)), np.zeros((6, 3)), "abc", 1j * np.zeros((6, 2))):
            with self.assertRaises((ValueError, TypeError)):
                system.rest_offset = wrong


class LoadTest(unittest.TestCase):
    def test_a_chain_hangs_in_balance(self):
        nodes = 9
        chain = asterism.SpringSystem(asterism.Topology.from_links(nodes, [(i, i + 1) for i in range(nodes - 1)]), dim=3)
        chain.anchors = np.linspace(0, [6, 0, 1], nodes)
        chain.anchor_stiffness, chain.rest_length, chain.link_stiffness = 0, 1, 40
        chain.fix(0), chain.fix(nodes - 1)
        self.assertIsNone(chain.loads)
        weights = np.zeros((nodes, 3))
        weights[:, 2] = -np.arange(nodes)
        chain.loads = weights
        x = chain.anchors.copy()
        self.assertTrue(asterism.solve(chain, x, tolerance=1e-12))
        d = np.diff(x, axis=0)
        lengths = np.linalg.norm(d, axis=1)[:, None]
        pulls = 40 * (lengths - 1) * d / lengths
        np.testing.assert_allclose(pulls[1:] - pulls[:-1] + weights[1:-1], 0, atol=1e-6)
        self.assertTrue(asterism.certify(chain, x).unique)
        # The solution follows the loads.
        grad_x = np.random.default_rng(1).normal(size=x.shape)
        gradient = asterism.sensitivity(chain, x, grad_x)
        step = np.random.default_rng(2).normal(size=x.shape)
        moved = asterism.solution_tangent(chain, x, loads=step)
        self.assertAlmostEqual((gradient.loads * step).sum(), (grad_x * moved).sum(), 9)
        chain.loads = weights + 1e-5 * step
        y = x.copy()
        self.assertTrue(asterism.solve(chain, y, tolerance=1e-12))
        np.testing.assert_allclose((y - x) / 1e-5, moved, atol=1e-3)

    def test_assignment(self):
        system, x = random_system(4, 2, 1)
        before = asterism.energy(system, x)
        system.loads = np.ones((4, 2))
        self.assertAlmostEqual(asterism.energy(system, x), before - x.sum(), 9)
        system.loads[2] = 5  # in place
        self.assertAlmostEqual(asterism.energy(system, x), before - x.sum() - 4 * x[2].sum(), 9)
        system.loads = None
        self.assertIsNone(system.loads)
        self.assertEqual(asterism.energy(system, x), before)
        for wrong in (np.zeros((5, 2)), np.zeros((4, 3)), "abc", 1j * np.zeros((4, 2))):
            with self.assertRaises((ValueError, TypeError)):
                system.loads = wrong


class BatchTest(unittest.TestCase):
    def batch(self, count=200, nodes=4, dim=2):
        batch = asterism.SpringBatch(asterism.Topology.full(nodes), count, dim=dim)
        systems = [random_system(nodes, dim, seed) for seed in range(count)]
        for name in ("anchors", "anchor_stiffness", "rest_length", "link_stiffness"):
            setattr(batch, name, np.stack([getattr(system, name) for system, _ in systems]))
        batch.x = np.stack([x for _, x in systems])
        return batch, systems

    def test_each_system_is_solved_as_alone(self):
        for dim in (2, 3):
            batch, systems = self.batch(dim=dim)
            summary = batch.solve()
            self.assertEqual(summary.status, asterism.Status.CONVERGED)
            self.assertEqual(summary.converged, batch.size)
            for (system, x), solved, final in zip(systems, batch.x, batch.final_energy):
                asterism.solve(system, x, "newton")
                np.testing.assert_allclose(solved, x, atol=1e-6)
                self.assertAlmostEqual(final, energy(system, solved), places=9)
            self.assertTrue(summary)
            self.assertTrue(np.all(batch.status == asterism.Status.CONVERGED))
            self.assertEqual([asterism.Status(s) for s in np.unique(batch.status)], [asterism.Status.CONVERGED])
            self.assertTrue(all(definite is True for definite in batch.positive_definite))
            self.assertTrue(np.all(batch.stationarity <= 1e-8))

    def test_systems_without_a_verdict(self):
        batch = asterism.SpringBatch(asterism.Topology.full(2), 1)
        self.assertEqual(list(batch.positive_definite), [None])
        # Two nodes on one anchor have a circle of minima.
        batch.anchors[:] = 0
        batch.anchor_stiffness[:] = batch.link_stiffness[:] = batch.rest_length[:] = 1
        batch.x[:] = [[-1 / 3, 0], [1 / 3, 0]]
        batch.solve(escape_saddles=False)
        self.assertIs(batch.positive_definite[0], False)
        batch.anchors[0, 1] = 1, 0
        batch.solve(max_iterations=0)
        self.assertIs(batch.positive_definite[0], None)

    def test_proves_what_one_system_does(self):
        batch, systems = self.batch()
        batch.solve()
        self.assertTrue(np.isnan(batch.lower_bound).all())
        batch, systems = self.batch()
        batch.solve(gap=1e-6)
        proven = batch.final_energy - batch.lower_bound <= 1e-6 * batch.final_energy
        certified = [asterism.certify(system, np.ascontiguousarray(x)).certified for (system, _), x in zip(systems, batch.x)]
        np.testing.assert_array_equal(proven, certified)
        self.assertTrue(proven.any())

    def test_arrays_are_the_batchs_memory(self):
        batch, _ = self.batch(count=5, nodes=3)
        for name, shape in {"anchors": (5, 3, 2), "anchor_stiffness": (5, 3), "rest_length": (5, 3), "x": (5, 3, 2)}.items():
            view = getattr(batch, name)
            self.assertEqual(view.shape, shape)
            view[3, 1] = 7
            np.testing.assert_array_equal(getattr(batch, name)[3, 1], view[3, 1])
            self.assertTrue(np.shares_memory(view, getattr(batch, name)))

    def test_a_forgotten_value_is_that_systems_failure(self):
        batch, _ = self.batch(count=5)
        batch.anchor_stiffness[3, 0] = np.nan
        summary = batch.solve()
        self.assertEqual((summary.status, summary.first_failure, summary.converged), (asterism.Status.INVALID_INPUT, 3, 4))
        self.assertFalse(summary)
        np.testing.assert_array_equal(np.flatnonzero(batch.status == asterism.Status.INVALID_INPUT), [3])

    def test_sizes(self):
        empty = asterism.SpringBatch(asterism.Topology.full(3), 0)
        self.assertEqual(empty.anchors.shape, (0, 3, 2))
        self.assertEqual(empty.solve().converged, 0)
        self.assertEqual(asterism.SpringBatch(asterism.Topology.full(1), 4).rest_length.shape, (4, 0))
        for call, message in [
            (lambda: asterism.SpringBatch(asterism.Topology.full(3), -1), "count: expected 0 or more"),
            (lambda: asterism.SpringBatch(asterism.Topology.full(3), 1, dim=1), "dim: expected 2 or 3"),
            (lambda: empty.solve(threads=-1), "threads: expected 0 or more"),
            (lambda: empty.solve(simd="sse"), "simd: expected auto, portable, avx2 or avx512, found 'sse'"),
        ]:
            with self.assertRaisesRegex(ValueError, message):
                call()

    def test_threads_and_instructions_agree(self):
        one, _ = self.batch(2000)
        two, _ = self.batch(2000)
        one.solve(simd="portable")
        two.solve(simd="portable", threads=2)
        np.testing.assert_array_equal(one.x, two.x)

    def test_keyboard_interrupt(self):
        system, start = random_system(16)  # too large for the lanes
        batch = asterism.SpringBatch(system.topology, 20000)
        for name in ("anchors", "anchor_stiffness", "rest_length", "link_stiffness"):
            setattr(batch, name, getattr(system, name))
        batch.x = start
        timer = threading.Timer(0.05, lambda: signal.raise_signal(signal.SIGINT))
        timer.start()
        with self.assertRaises(KeyboardInterrupt):
            batch.solve()
        timer.join()
        np.testing.assert_array_equal(batch.x[-1], start)  # not reached
        self.assertEqual(batch.status[-1], int(asterism.Status.INTERRUPTED))


@unittest.skipUnless(hasattr(asterism, "read_systems"), "built without nlohmann-json")
class JsonTest(unittest.TestCase):
    def test_systems_come_back_bit_for_bit(self):
        with tempfile.TemporaryDirectory() as folder:
            path = pathlib.Path(folder) / "systems.jsonl"
            systems = [random_system(dim=dim) for dim in (2, 3)]
            asterism.write_systems(
                path, [asterism.StoredSystem(system, x, "näme", {"frame": 3}) for system, x in systems]
            )
            self.assertEqual(path.read_text().count("\n"), 2)
            for stored, (system, x) in zip(asterism.read_systems(path), systems):
                np.testing.assert_array_equal(stored.start, x)
                self.assertEqual((stored.name, stored.origin), ("näme", {"frame": 3}))
                for name in ("anchors", "anchor_stiffness", "rest_length", "link_stiffness"):
                    np.testing.assert_array_equal(getattr(stored.system, name), getattr(system, name))

    def test_errors_name_the_place(self):
        with self.assertRaisesRegex(ValueError, "^text:2: not JSON"):
            asterism.parse_systems('\n{"asterism_system": 1,,}')
        with self.assertRaises(FileNotFoundError):
            asterism.read_systems("no/such/file.json")
        with tempfile.TemporaryDirectory() as folder:
            path = pathlib.Path(folder) / "systems.jsonl"
            system, x = random_system()
            system.rest_length[0] = -1
            with self.assertRaisesRegex(ValueError, "rest length 0 is negative"):
                asterism.write_systems(path, [asterism.StoredSystem(system, x)])
            self.assertFalse(path.exists())

    SYSTEM = (
        '{"asterism_system": 1, "dim": 2, "anchors": [[0, 0], [1, 1]], "anchor_stiffness": [1, 1], "links": [[0, 1]], '
        '"rest_length": [1], "link_stiffness": [1], "fixed": [0]'
    )

    def test_text_that_is_no_utf_8(self):
        with tempfile.TemporaryDirectory() as folder:
            for data, message in (
                (self.SYSTEM.encode("utf-16") + b"}", "expected UTF-8, found UTF-16"),
                (self.SYSTEM.encode() + b', "name": "\xff"}', "1: not JSON: .*UTF-8"),
                (b"\n" + self.SYSTEM.encode() + b',\n"name": "n\xe4me"}', "3: not JSON: .*UTF-8"),
            ):
                for name in ("systems.json", "systems \udcff.json"):  # the name of a file may be any bytes
                    path = pathlib.Path(folder) / name
                    path.write_bytes(data)
                    shown = str(path).encode("utf-8", "backslashreplace").decode()
                    with self.subTest(message, name=ascii(name)), self.assertRaisesRegex(ValueError, re.escape(shown) + ":\\s?" + message):
                        asterism.read_systems(path)
            path.write_text("\ufeff" + self.SYSTEM + "}", encoding="utf-8")
            self.assertEqual(len(asterism.read_systems(path)), 1)
        with self.assertRaisesRegex(ValueError, "^text: not UTF-8"):
            asterism.parse_systems(self.SYSTEM + ', "name": "\ud800"}')
        with self.assertRaisesRegex(TypeError, "^text: expected str, found NoneType"):
            asterism.parse_systems(None)

    def test_origins_that_json_cannot_hold(self):
        system, x = random_system()
        with tempfile.TemporaryDirectory() as folder:
            path = pathlib.Path(folder) / "systems.jsonl"
            for origin, error in (
                ({"a": float("nan")}, ValueError),
                ({"a": [1, {"b": float("-inf")}]}, ValueError),
                ({"a": 2**64}, ValueError),
                ({"a": -(2**63) - 1}, ValueError),
                ({"a": object()}, TypeError),
                ({"a": "\ud800"}, ValueError),
                ([1], ValueError),
            ):
                with self.subTest(ascii(origin)), self.assertRaisesRegex(error, "^the system cannot be written: "):
                    asterism.write_systems(path, [asterism.StoredSystem(system, x, "", origin)])
            for systems, message in ((3, "systems: expected a list of StoredSystems, found int"), ([3], "systems: expected StoredSystems, found int")):
                with self.subTest(message), self.assertRaisesRegex(TypeError, message):
                    asterism.write_systems(path, systems)
            for name, error in (("\ud800", ValueError), (7, TypeError)):
                with self.assertRaisesRegex(error, "^the system cannot be written: its name"):
                    asterism.write_systems(path, [asterism.StoredSystem(system, x, name)])
            self.assertFalse(path.exists())
            origin = {"a": 2**64 - 1, "b": -(2**63), "c": 1e300, "d": 5e-324}
            asterism.write_systems(path, [asterism.StoredSystem(system, x, "", origin)])
            self.assertEqual(asterism.read_systems(path)[0].origin, origin)

    @unittest.skipIf(jsonschema is None, "needs jsonschema (Debian package python3-jsonschema)")
    def test_the_schema_takes_what_the_reader_takes(self):
        page = (pathlib.Path(__file__).parents[2] / "docs" / "system-json.md").read_text()
        schema = json.loads(page[page.rindex("```json\n") + 8 : page.rindex("\n```")])
        good = json.loads(self.SYSTEM + "}")
        for key, value in [
            *((key, value) for key, number in (("asterism_system", 1), ("dim", 2)) for value in (number, float(number), str(number), None, True, number + 0.5, [number])),
            *(("links", [[0, end]]) for end in (1, 1.0, 1.5, "1", None, -1.0)),
            *(("fixed", [node]) for node in (0, 1.0, -0.0, 0.5, "0", False, -1)),
            *(("rest_length", [value]) for value in (0, 2, 2.5, 10**20, 1e300, -1, -0.5, "1", None, True)),
            *(("start", [[0, 0], [value, 1]]) for value in (1, -1.5, 10**20, "1", None)),
            *(("origin", value) for value in ({}, {"a": None}, [], "x", 1)),
            *(("name", value) for value in ("", "x", 1, None)),
            ("fixes", [0]),
            ("anchors", []),
        ]:
            stored = {**good, key: value}
            with self.subTest(key, value=value):
                in_schema = jsonschema.Draft202012Validator(schema).is_valid(stored)
                try:
                    is_read = bool(asterism.parse_systems(json.dumps(stored)))
                except ValueError:
                    is_read = False
                self.assertEqual(is_read, in_schema)

    def test_numbers_out_of_range_are_named_with_their_line(self):
        for number, message in (
            ("1e999", "number overflow parsing '1e999'"),
            ("-1e-400", "number underflow parsing '-1e-400'"),
            ("0.00001e-330", "number underflow"),
            (str(2**64), "the origin's integer 18446744073709551616 has more than 64 bits"),
        ):
            text = "\n" + self.SYSTEM + f',\n"origin": {{"a": 1,\n"b": [2, {number}\n]}}}}'
            with self.subTest(number), self.assertRaisesRegex(ValueError, "^text:4: " + message):
                asterism.parse_systems(text)
        zero = asterism.parse_systems(self.SYSTEM + ', "start": [[0e-400, 0.0], [-0.0, 5e-324]]}')[0].start
        self.assertEqual(zero[1, 1], 5e-324)
        large = asterism.parse_systems(self.SYSTEM + f', "start": [[{10**20}, {10**300}], [0, 0]]}}')[0].start
        self.assertEqual(large[0].tolist(), [1e20, 1e300])


if __name__ == "__main__":
    unittest.main()
