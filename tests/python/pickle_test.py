#!/usr/bin/env python3
"""copy, deepcopy, pickle and .copy() of every class, and work in other processes."""

import copy
import io
import multiprocessing
import os
import pickle
import pickletools
import resource
import sys
import tempfile
import unittest

import asterism
import numpy as np
from moving_square import BOX, draw_frame

DAMAGED = int(os.environ.get("ASTERISM_DAMAGED_PICKLES", 300))  # of each object
ARRAYS = ("anchors", "anchor_stiffness", "rest_length", "link_stiffness")
COPIES = {
    "copy": copy.copy,
    "deepcopy": copy.deepcopy,
    ".copy()": lambda value: value.copy(),
    **{f"pickle {p}": lambda value, p=p: pickle.loads(pickle.dumps(value, p)) for p in range(pickle.HIGHEST_PROTOCOL + 1)},
}


def make_system(nodes=6, dim=2, seed=1):
    random = np.random.default_rng(seed)
    points = random.uniform(0, 10, (nodes, dim))
    system = asterism.SpringSystem(asterism.Topology.k_nearest(points, 3), dim)
    system.set_rest_lengths(points)
    system.anchors = points + random.normal(scale=0.3, size=points.shape)
    system.anchor_stiffness = random.uniform(0.5, 2, nodes)
    system.link_stiffness = random.uniform(0.5, 2, system.link_count)
    return system, points + random.normal(scale=0.1, size=points.shape)


def solved(work):
    """In another process: what becomes of a system."""
    solver, system, x = work
    summary = solver.solve(system, x)
    return summary, x, asterism.certify(system, x), system.copy()


def tracked(work):
    tracker, frames = work
    return [tracker.update(frame) for frame in frames]


class Restricted(pickle.Unpickler):
    """Of damaged pickles: finds nothing but what ours name."""

    def find_class(self, module, name):
        if module.partition(".")[0] in ("asterism", "numpy", "copyreg", "_codecs", __name__):
            return super().find_class(module, name)
        raise pickle.UnpicklingError(f"{module}.{name}")


def claims_too_long_a_bytearray(damaged):
    """Whether a count of bytes exceeds the pickle. CPython then frees an unfinished bytearray, and prints a SystemError of its own."""
    try:
        for _ in pickletools.genops(damaged):
            pass
    except Exception as error:
        return "bytearray8" in str(error)
    return False


def load_damaged(pickles, count):
    """Loads damaged copies of each pickle, and uses what comes out; every error is an exception, and nothing is printed."""
    with tempfile.TemporaryFile() as printed:
        os.dup2(printed.fileno(), 2)
        load_damaged_copies(pickles, count)
        printed.seek(0)
        if text := printed.read().decode():
            print(text[:1000])
            sys.exit(1)


def load_damaged_copies(pickles, count):
    resource.setrlimit(resource.RLIMIT_AS, (1 << 32, 1 << 32))  # a damaged index makes pickle itself ask for any amount of memory
    random = np.random.default_rng(len(pickles[0]))
    for n in range(count):
        damaged = bytearray(pickles[n % len(pickles)])
        for _ in range(random.integers(1, 4)):
            at = random.integers(len(damaged))
            kind = random.integers(3)
            if kind == 0:
                damaged[at] = random.integers(256)
            elif kind == 1:
                del damaged[at : at + random.integers(1, 40)]
            else:
                damaged[at:at] = damaged[random.integers(len(damaged)) :][: random.integers(1, 40)]
            if not damaged:
                break
        if claims_too_long_a_bytearray(bytes(damaged)):
            continue
        try:
            use(Restricted(io.BytesIO(bytes(damaged))).load())
        except Exception:
            continue


def use(value):
    repr(value)
    for name in dir(type(value)):
        if isinstance(getattr(type(value), name), property):
            getattr(value, name)
    for term in getattr(value, "terms", ()):
        for name in ("nodes", *term.columns, *term.choices):
            getattr(term, name)
        repr(term)
    if hasattr(value, "terms"):
        value.energy(np.ones((value.nodes, value.dim)))


class Mine(asterism.SpringSystem):
    """A class of a user's own."""


def properties(value):
    return {
        name: getattr(value, name)
        for name in dir(type(value))
        if isinstance(getattr(type(value), name), property) and name != "parts"
    }


class PickleTest(unittest.TestCase):
    def assert_same(self, a, b):
        self.assertIs(type(a), type(b))
        first, second = properties(a), properties(b)
        self.assertEqual(first.keys(), second.keys())
        for name, value in first.items():
            if isinstance(value, asterism.Topology):
                self.assert_same(value, second[name])
            else:
                np.testing.assert_array_equal(value, second[name], name)
        self.assertEqual(repr(a), repr(b))

    def test_systems_and_topologies(self):
        for dim in (2, 3):
            system, _ = make_system(dim=dim)
            system.fix(2)
            for name, make in COPIES.items():
                with self.subTest(name, dim=dim):
                    other = make(system)
                    self.assert_same(other, system)
                    self.assertEqual([other.is_fixed(i) for i in range(6)], [i == 2 for i in range(6)])
                    for array in ARRAYS:
                        self.assertFalse(np.shares_memory(getattr(other, array), getattr(system, array)))
                    self.assert_same(make(system.topology), system.topology)
        system.set_rest_offsets(system.anchors)
        system.loads = system.anchors
        for name, make in COPIES.items():
            with self.subTest(f"{name}, offsets and loads"):
                self.assert_same(make(system), system)
        unset = asterism.SpringSystem(asterism.Topology.full(3)).copy()
        self.assertTrue(np.isnan(unset.anchors).all())
        self.assertEqual(asterism.SpringSystem(asterism.Topology.full(1), 3).copy().rest_length.shape, (0,))

    def test_a_class_of_ones_own_is_kept(self):
        mine = Mine(asterism.Topology.full(2))
        mine.anchors = 3
        for name, make in COPIES.items():
            with self.subTest(name):
                self.assertIs(type(make(mine)), Mine)
                self.assertTrue((make(mine).anchors == 3).all())

    def test_results(self):
        system, x = make_system()
        results = [
            asterism.solve(system, x.copy(), "newton", gap=1e-6),
            asterism.solve(system, x.copy(), "ida", max_iterations=2),
            asterism.solve(system, np.full_like(x, np.nan), check=False),
            asterism.certify(system, x),
        ]
        batch = asterism.SpringBatch(system.topology, 3)
        results.append(batch.solve())
        for result in results:
            for name, make in COPIES.items():
                with self.subTest(repr(result), how=name):
                    self.assert_same(make(result), result)
                    self.assertEqual(bool(make(result)), bool(result))
        with self.assertRaisesRegex(ValueError, "another version of Asterism"):
            asterism.Summary.__new__(asterism.Summary).__setstate__((1, 2))

    def test_damaged_pickles_are_exceptions(self):
        system, x = make_system()
        system.set_rest_offsets(x)
        values = [system, system.topology, asterism.solve(system, x.copy()), asterism.certify(system, x), asterism.Solver("newton")]
        batch = asterism.SpringBatch(asterism.Topology.full(3), 2)
        values += [batch, batch.solve()]
        terms = asterism.System(4)
        terms.add_anchors(np.eye(4, 2), [1, 2, 3, 4], information=np.eye(2), loss="huber", scale=2)
        terms.add_links([[0, 1], [1, 2]], 3, law="rope")
        terms.add_elements([[0, 1, 2]], np.hypot)
        values.append(terms)
        if hasattr(asterism, "Tracker"):
            tracker = asterism.Tracker("dpt")
            values.append(tracker)
            frames = [draw_frame(i) for i in range(2)]
            tracker = asterism.Tracker("dpt")
            tracker.init(frames[0], BOX)
            result = tracker.update(frames[1])
            values += [result, result.parts[0]]
        context = multiprocessing.get_context("spawn")
        for value in values:
            with self.subTest(type(value).__name__):
                pickles = [pickle.dumps(value, protocol) for protocol in (0, 2, 5)]
                process = context.Process(target=load_damaged, args=(pickles, DAMAGED))
                process.start()
                process.join()
                self.assertEqual(process.exitcode, 0)

    def test_every_class_has_a_repr_of_its_own(self):
        for module in (asterism, asterism.pose, asterism.bench):
            for each in vars(module).values():
                if isinstance(each, type) and each.__module__.startswith("asterism"):
                    with self.subTest(each.__name__):
                        self.assertTrue(any("__repr__" in vars(base) for base in each.__mro__ if base.__module__ not in ("builtins", "pybind11_builtins")))

    def test_an_object_without_values_says_so(self):
        classes = [each for each in vars(asterism).values() if isinstance(each, type) and each.__module__ == "asterism" and "Status" not in each.__name__]
        self.assertGreater(len(classes), 6)
        for each in classes:
            made = each.__new__(each)
            uses = [lambda value, name=name: getattr(value, name) for name in dir(each) if isinstance(getattr(each, name), property)]
            uses += [function for function, name in ((repr, "__repr__"), (bool, "__bool__"), (len, "__len__")) if name in vars(each)]
            self.assertGreater(len(uses), 0)
            for use_it in uses:
                with self.subTest(each.__name__), self.assertRaisesRegex(TypeError, "has no values"):
                    use_it(made)

    def test_solvers(self):
        system, start = make_system()
        for method in asterism.methods():
            solver = asterism.Solver(method, tolerance=1e-5, max_iterations=500)
            expected = start.copy()
            solver.solve(system, expected)
            for name, make in COPIES.items():
                with self.subTest(method, how=name):
                    other = make(solver)
                    self.assertEqual((other.method, other.options), (solver.method, solver.options))
                    x = start.copy()
                    other.solve(system, x)
                    np.testing.assert_array_equal(x, expected)

    def test_batches(self):
        system, x = make_system()
        for dim in (2, 3):
            system, x = make_system(4, dim)
            batch = asterism.SpringBatch(system.topology, 5, dim)
            for array in ARRAYS:
                setattr(batch, array, getattr(system, array))
            batch.x = x
            copies = {name: make(batch) for name, make in COPIES.items()}
            batch.solve()
            for name, other in copies.items():
                with self.subTest(name, dim=dim):
                    self.assertTrue((other.status == asterism.Status.NOT_RUN).all())
                    self.assertTrue(other.solve())
                    np.testing.assert_array_equal(other.x, batch.x)

    @unittest.skipUnless(hasattr(asterism, "read_systems"), "built without nlohmann-json")
    def test_stored_systems(self):
        system, x = make_system()
        stored = asterism.StoredSystem(system, x, "name", {"frame": 3})
        other = pickle.loads(pickle.dumps(stored))
        self.assert_same(other.system, system)
        np.testing.assert_array_equal(other.start, x)
        self.assertEqual((other.name, other.origin), ("name", {"frame": 3}))

    def test_processes(self):
        with multiprocessing.get_context("spawn").Pool(2) as pool:
            work = [(asterism.Solver("newton", tolerance=1e-10), *make_system(seed=seed)) for seed in range(6)]
            for (solver, system, start), (summary, x, certificate, other) in zip(work, pool.map(solved, work)):
                here = start.copy()
                expected = solver.solve(system, here)
                np.testing.assert_array_equal(x, here)
                self.assertIs(summary.status, asterism.Status.CONVERGED)
                self.assertEqual(summary.final_energy, expected.final_energy)
                self.assertEqual(certificate.proof, asterism.certify(system, here).proof)
                self.assert_same(other, system)
            if hasattr(asterism, "Tracker"):
                frames = [draw_frame(i) for i in range(8)]
                tracker = asterism.Tracker("dpt")
                tracker.init(frames[0], BOX)
                there = pool.apply(tracked, ((tracker, frames[1:]),))
                here = tracked((tracker, frames[1:]))
                self.assertEqual([result.box for result in there], [result.box for result in here])


@unittest.skipUnless(hasattr(asterism, "Tracker"), "built without trackers")
class TrackersTest(unittest.TestCase):
    frames = [draw_frame(i) for i in range(8)]
    # Compares all of a result except the times of its stages.
    assert_same = PickleTest.assert_same

    def test_trackers_go_on_bit_for_bit(self):
        names = ["dpt", "kcf", "dpt_plus", "kalman"]
        options = {"grid_rows": 3} if hasattr(asterism, "read_systems") else None
        for name, its_options in [*((name, None) for name in names), ("dpt", options)]:
            tracker = asterism.Tracker(name, its_options)
            tracker.init(self.frames[0], BOX)
            for frame in self.frames[1:4]:
                tracker.update(frame)
            copies = {how: make(tracker) for how, make in COPIES.items()}
            expected = [tracker.update(frame).box for frame in self.frames[4:]]
            for how, other in copies.items():
                with self.subTest(name, how=how):
                    self.assertEqual(other.name, tracker.name)
                    self.assertEqual([other.update(frame).box for frame in self.frames[4:]], expected)

    def test_before_init(self):
        tracker = asterism.Tracker("kcf", pixel_range=(0, 1023)).copy()
        with self.assertRaisesRegex(RuntimeError, "init"):
            tracker.update(self.frames[1])
        frames = [frame.astype(np.uint16) * 4 for frame in self.frames]
        tracker.init(frames[0], BOX)
        other = pickle.loads(pickle.dumps(tracker))
        self.assertEqual(other.update(frames[1]).box, tracker.update(frames[1]).box)

    def test_results(self):
        tracker = asterism.Tracker("dpt")
        tracker.init(self.frames[0], BOX)
        result = tracker.update(self.frames[1])
        for name, make in COPIES.items():
            with self.subTest(name):
                other = make(result)
                self.assert_same(other, result)
                self.assertEqual(len(other.parts), len(result.parts))
                for one, two in zip(other.parts, result.parts):
                    self.assertEqual(properties(one).keys(), properties(two).keys())
                    for key, value in properties(one).items():
                        np.testing.assert_array_equal(value, properties(two)[key])
                    np.testing.assert_array_equal(make(one).position, one.position)
                np.testing.assert_array_equal(other.corners(), result.corners())

    def test_a_set_of_objects_says_that_it_cannot(self):
        with self.assertRaisesRegex(TypeError, "cannot pickle 'asterism.MultiTracker' object"):
            pickle.dumps(asterism.MultiTracker())


if __name__ == "__main__":
    unittest.main()
