#!/usr/bin/env python3
"""bench/evaluation/learn_laws.py: learn_laws_test.py SCRIPT. Needs SciPy."""

import importlib.util
import json
import pathlib
import subprocess
import sys
import tempfile
import unittest

import asterism
import numpy as np

try:
    import scipy  # noqa: F401
except ImportError:
    print("skipped: SciPy is not installed (Debian package python3-scipy)")
    sys.exit(0)

SCRIPT = pathlib.Path(sys.argv[1])
sys.path.insert(0, str(SCRIPT.parent))
spec = importlib.util.spec_from_file_location("learn_laws", SCRIPT)
laws = importlib.util.module_from_spec(spec)
spec.loader.exec_module(laws)

TRUE = np.array([0.6, 0.8, np.log(3), 1.2, np.log(0.05)])
GRID = np.array([[-12.0, -10], [12, -10], [-12, 10], [12, 10]])  # of parts in a box of 48 x 40 px


def numbers(box):
    return [float(value) for value in box]


def make_record(name, frames, seed, theta=TRUE, noise=4.0):
    """Systems of one sequence whose annotated boxes are those that follow from the law of theta."""
    random = np.random.default_rng(seed)
    topology = asterism.Topology.full(4)
    solver = asterism.Solver("newton", tolerance=1e-12)
    record = []
    for frame in range(2, frames + 2):
        middle = np.array([100.0 + 2 * frame, 80])
        start = middle - 0.5 + GRID + random.normal(scale=0.5, size=(4, 2))
        spread = noise * np.exp(random.normal(scale=0.7, size=4))
        peak = np.clip(random.uniform(0.1, 0.9, 4), 0, 1)
        covariance = np.einsum("i,jk->ijk", spread**2 / 2, np.eye(2))
        system = asterism.SpringSystem(topology)
        system.set_rest_lengths(GRID)
        system.anchors = start + random.normal(size=(4, 2)) * spread[:, None]
        ends = system.anchors[topology.links]
        strain = 1 - np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1) / system.rest_length
        a, b, log_beta, c, log_f = theta
        system.anchor_stiffness = peak**a / spread ** (2 * b)
        system.link_stiffness = np.exp(log_beta) * (strain**2 + np.exp(2 * log_f)) ** (c / 2)
        x = start.copy()
        assert solver.solve(system, x).usable
        # Least squares for the similarity (u, -v; v, u) and its translation.
        rows = np.zeros((8, 4))
        rows[0::2] = np.column_stack([start[:, 0], -start[:, 1], np.ones(4), np.zeros(4)])
        rows[1::2] = np.column_stack([start[:, 1], start[:, 0], np.zeros(4), np.ones(4)])
        u, v, dx, dy = np.linalg.lstsq(rows, x.ravel(), rcond=None)[0]
        centre = middle - 0.5
        moved = np.array([u * centre[0] - v * centre[1] + dx, v * centre[0] + u * centre[1] + dy]) + 0.5
        size = np.hypot(u, v) * np.array([48, 40])
        box = numbers([*(moved - size / 2), *size])
        origin = {"tracker": "dpt", "frame": frame, "peak": numbers(peak), "covariance": covariance.tolist(),
                  "start_box": numbers([*(middle - (24, 20)), 48, 40]), "box": box, "true_box": box, "true_placement": x.tolist()}
        record.append(asterism.StoredSystem(system, start, f"{name}/frame {frame}", origin))
    return record


class Toy(unittest.TestCase):
    def setUp(self):
        self.records = {name: make_record(name, 40, seed) for seed, name in enumerate("abcd")}

    def test_the_gradient_is_that_of_differences(self):
        random = np.random.default_rng(2)
        for record in self.records.values():
            for stored in record:  # away from the truth, where errors and their gradients vanish
                stored.origin["true_box"] = (np.array(stored.origin["true_box"]) + (5, -3, 4, 6)).tolist()
                stored.origin["true_placement"] = (np.array(stored.origin["true_placement"]) + random.normal(scale=4, size=(4, 2))).tolist()
        frames = laws.Frames(self.records)
        here, weights = frames.of("abc")
        self.assertEqual(len(here), 120)
        self.assertAlmostEqual(weights.sum(), 1)
        for loss in laws.LOSSES:
            for theta in (laws.START, TRUE, *(laws.START + random.normal(scale=0.3, size=(3, 5)))):
                _, gradient, failed, without = frames.evaluate(here, theta, loss)
                self.assertEqual((failed, without), (0, 0))
                for p in range(5):
                    steps = 1e-4 * np.eye(5)[p]
                    high, low = (weights @ frames.evaluate(here, theta + s, loss)[0] for s in (steps, -steps))
                    self.assertAlmostEqual(weights @ gradient[:, p], (high - low) / 2e-4, delta=1e-7)
                self.assertGreater(abs(weights @ gradient).min(), 1e-6)

    def test_a_law_is_found_again(self):
        frames = laws.Frames(self.records)
        here, _ = frames.of("abcd")
        for loss in laws.LOSSES:
            self.assertLess(frames.evaluate(here, TRUE, loss)[0].max(), 1e-12)
            self.assertGreater(frames.evaluate(here, laws.PAPER, loss)[0].mean(), 1e-4)
            theta, result = frames.fit("abcd", loss)
            self.assertLess(result.fun, 1e-8)
            np.testing.assert_allclose(theta, TRUE, atol=0.02, err_msg=loss)

    def test_a_fold_is_not_seen_by_its_own_fit(self):
        folds = {"0": ["a", "b"], "1": ["c", "d"]}
        thetas, _ = laws.learn(laws.Frames(self.records), folds, "box")
        for stored in self.records["c"] + self.records["d"]:
            stored.origin["true_box"] = [0.0, 0.0, 10.0, 10.0]
        others, _ = laws.learn(laws.Frames(self.records), folds, "box")
        np.testing.assert_array_equal(thetas["1"], others["1"])
        self.assertGreater(abs(thetas["0"] - others["0"]).max(), 0.01)

    def test_the_paper_law_is_the_recorded_stiffness(self):
        record = make_record("a", 10, 3, theta=(1, 1, 0, 2, -np.inf))
        frames = laws.Frames({"a": record})
        anchors, links, _, _ = frames.stiffness(np.arange(10), laws.PAPER)
        for t, stored in enumerate(record):
            np.testing.assert_allclose(anchors[t], stored.system.anchor_stiffness, rtol=1e-14)
            np.testing.assert_allclose(links[t], stored.system.link_stiffness, rtol=1e-9)
        self.assertEqual(frames.reproduced(), 1)

    def test_frames_after_a_loss_do_not_count(self):
        record = self.records["a"]
        record[9].origin["box"] = [0, 0, 48, 40]    # frame 11: the tracker is elsewhere
        del record[19].origin["true_box"]           # frame 21 is not annotated
        del record[29]                              # frame 31: an interruption
        frames = laws.Frames({"a": record})
        used = {stored.origin["frame"] for stored in record} - {12, 21, 22, 32}
        self.assertEqual(len(frames.systems), len(used))
        self.assertEqual(sorted(frames.start[:, 0, 0]), sorted(s.start[0, 0] for s in record if s.origin["frame"] in used))

    def test_one_lost_frame_does_not_dominate(self):
        frames = laws.Frames(self.records)
        here, weights = frames.of("abcd")
        x, _ = frames.solve(here, *frames.stiffness(here, TRUE)[:2])
        x[7] += 1e4
        for loss in laws.LOSSES:
            error, by_x = frames.errors(here, x, loss)
            self.assertLess(weights @ error, 1.01 * weights[7])
            self.assertLess(abs(by_x[7]).max(), 1e-6)

    def test_a_system_without_a_solution_counts_with_its_start(self):
        frames = laws.Frames(self.records)
        here, _ = frames.of("a")
        theta = laws.START.copy()
        frames.peak[here[3]] = np.nan
        error, gradient, failed, _ = frames.evaluate(here, theta, "box")
        self.assertEqual(failed, 1)
        expected, _ = frames.errors(here[3:4], frames.start[here[3:4]], "box")
        self.assertEqual(error[3], expected[0])
        np.testing.assert_array_equal(gradient[3], 0)


class Overlap(unittest.TestCase):
    def test_boxes(self):
        self.assertAlmostEqual(laws.overlap([0, 0, 4, 2], [2, 0, 4, 2]), 1 / 3)
        self.assertEqual(laws.overlap([0, 0, 4, 2], [4, 0, 4, 2]), 0)
        self.assertEqual(laws.overlap([1, 2, 3, 4], [1, 2, 3, 4]), 1)


class Program(unittest.TestCase):
    def setUp(self):
        directory = tempfile.TemporaryDirectory()
        self.addCleanup(directory.cleanup)
        self.folder = pathlib.Path(directory.name)
        (self.folder / "records").mkdir()
        self.folds = self.folder / "folds.tsv"
        self.folds.write_text("# fold\tsequence\n0\ta\n1\tb\n")

    def run_script(self):
        return subprocess.run([sys.executable, SCRIPT, self.folder / "records", self.folds, self.folder / "laws.json"],
                              capture_output=True, text=True, check=False)

    def test_writes_candidates_by_fold(self):
        tracker = 'dpt{"transform": "similarity"}'
        for seed, name in enumerate("ab"):
            record = make_record(name, 20, seed)
            for stored in record:
                stored.origin["tracker"] = tracker
            asterism.write_systems(self.folder / "records" / f"{name}.jsonl", record)
        result = self.run_script()
        self.assertEqual(result.returncode, 0, result.stderr)
        candidates = json.loads((self.folder / "laws.json").read_text())["candidates"]
        described = {"tracker": "dpt", "transform": "similarity"}
        self.assertEqual(candidates["paper"], described)
        self.assertEqual(list(candidates), ["paper", *laws.LOSSES])
        for loss in laws.LOSSES:
            self.assertEqual(set(candidates[loss]["by_fold"]), {"0", "1"})
            for fitted in candidates[loss]["by_fold"].values():
                self.assertEqual(set(fitted.pop("stiffness")), set(laws.NAMES))
                self.assertEqual(fitted, described)
        self.assertIn("40 frames of 2 sequences count", result.stdout)
        self.assertRegex(result.stdout, r"\n\| 0 \| 0\.\d{4} \| 0\.\d{4} \|")

    def test_errors_are_one_line(self):
        def refused(pattern):
            result = self.run_script()
            self.assertEqual(result.returncode, 1)
            self.assertRegex(result.stderr, pattern)
            self.assertEqual(len(result.stderr.splitlines()), 1, result.stderr)
        refused(r"a\.jsonl: .*No such file")
        record = make_record("a", 2, 1)
        for name in "ab":
            asterism.write_systems(self.folder / "records" / f"{name}.jsonl", record)
        for stored in record:
            del stored.origin["true_box"]
        asterism.write_systems(self.folder / "records/a.jsonl", record)
        refused("no frame of these sequences counts: a")
        record[0].origin["tracker"] = 'dpt{"grid_rows": 3}'
        asterism.write_systems(self.folder / "records/a.jsonl", record)
        refused("several trackers")
        del record[1].origin["peak"]
        asterism.write_systems(self.folder / "records/a.jsonl", record)
        refused(r"a\.jsonl: a/frame 3: no peak in origin")


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
