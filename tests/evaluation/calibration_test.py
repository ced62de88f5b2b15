#!/usr/bin/env python3
"""bench/evaluation/calibration.py: calibration_test.py SCRIPT EXECUTABLE. Needs NumPy; compares with scikit-learn where it is installed."""

import importlib.util
import json
import math
import pathlib
import subprocess
import sys
import tempfile
import unittest

try:
    import numpy as np
except ImportError:
    sys.exit(77)

from synthetic import make_sequence

SCRIPT, EXECUTABLE = sys.argv[1:3]
sys.path.insert(0, str(pathlib.Path(SCRIPT).parent))
spec = importlib.util.spec_from_file_location("calibration", SCRIPT)
cal = importlib.util.module_from_spec(spec)
spec.loader.exec_module(cal)


def sample(count, seed=1):
    """Scores on a grid, so that there are equal ones, labels that depend on them, and uneven weights."""
    rng = np.random.default_rng(seed)
    c = rng.integers(0, 41, count) / 40
    return c, rng.random(count) < 0.1 + 0.8 * c**2, rng.random(count) + 0.1


class Fits(unittest.TestCase):
    def test_logistic_of_two_scores_has_a_closed_form(self):
        c = np.repeat([0.25, 0.75], [4, 5])
        y = np.array([1, 0, 0, 0, 1, 1, 1, 0, 1], bool)
        w = np.array([2, 1, 1, 1, 1, 1, 1, 1, 1], float)
        a, b = cal.fit_logistic(c, y, w)  # passes through the fractions 2/5 and 4/5
        slope = (math.log(4) - math.log(2 / 3)) / 0.5
        self.assertAlmostEqual(b, slope, 7)
        self.assertAlmostEqual(a, math.log(4) - 0.75 * slope, 7)

    def test_logistic_has_no_gradient_left(self):
        c, y, w = sample(500)
        a, b = cal.fit_logistic(c, y, w)
        rest = w * (cal.sigmoid(a + b * c) - y)
        self.assertAlmostEqual(np.sum(rest) / w.sum(), 0, 7)
        self.assertAlmostEqual(np.sum(rest * c) / w.sum(), 0, 7)

    def test_a_score_that_falls_with_the_class_is_not_used(self):
        c, y, w = sample(300)
        for fit in (cal.fit_logistic, cal.MAPPINGS["logit"][0]):
            a, b = fit(c, ~y, w)
            self.assertEqual(b, 0)
            self.assertAlmostEqual(cal.sigmoid(a), np.sum(w * ~y) / w.sum())

    def test_labels_that_are_all_alike_or_separable_give_finite_probabilities(self):
        c = np.linspace(0, 1, 20)
        for y in (np.ones(20, bool), np.zeros(20, bool), c > 0.5):
            for fit, apply in cal.MAPPINGS.values():
                p = apply(fit(c, y, np.ones(20)), c)
                self.assertTrue(np.all((p >= 0) & (p <= 1)), (y, p))

    def test_power_maximizes_the_likelihood(self):
        c, y, w = sample(400)
        a = cal.fit_power(c, y, w)[0]

        def likelihood(a):
            p = cal.inner(c) ** a
            return np.sum(w * np.where(y, np.log(p), np.log1p(-p)))
        for factor in (0.99, 1.01):
            self.assertLess(likelihood(factor * a), likelihood(a))

    def test_isotonic_is_the_minimum_over_ends_of_the_maximum_over_starts(self):
        c, y, w = sample(120)
        values = np.unique(c)
        mean = {(i, j): np.average(y[here], weights=w[here]) for i in range(len(values)) for j in range(i, len(values))
                if np.any(here := (c >= values[i]) & (c <= values[j]))}
        fitted = cal.apply_isotonic(cal.fit_isotonic(c, y, w), values)
        for k in range(len(values)):
            expected = min(max(mean[i, j] for i in range(k + 1)) for j in range(k, len(values)))
            self.assertAlmostEqual(fitted[k], expected, 12)

    def test_every_mapping_is_monotone_and_within_bounds(self):
        c, y, w = sample(300)
        grid = np.linspace(0, 1, 1001)
        for name, (fit, apply) in cal.MAPPINGS.items():
            p = apply(fit(c, y, w), grid)
            self.assertTrue(np.all(np.diff(p) >= 0), name)
            self.assertTrue(np.all((p >= 0) & (p <= 1)), name)

    def test_agrees_with_scikit_learn(self):
        try:
            from sklearn.isotonic import IsotonicRegression
            from sklearn.linear_model import LogisticRegression
            from sklearn.metrics import brier_score_loss, f1_score, precision_score, recall_score, roc_auc_score
        except ImportError:
            self.skipTest("no scikit-learn")
        c, y, w = sample(1000)
        model = LogisticRegression(penalty="none", tol=1e-10, max_iter=1000).fit(c[:, None], y, w)
        a, b = cal.fit_logistic(c, y, w)
        self.assertAlmostEqual(a, model.intercept_[0], 4)
        self.assertAlmostEqual(b, model.coef_[0, 0], 4)
        np.testing.assert_allclose(cal.apply_isotonic(cal.fit_isotonic(c, y, w), c),
                                   IsotonicRegression().fit(c, y, sample_weight=w).predict(c), atol=1e-9)
        self.assertAlmostEqual(cal.area_under_roc(c, y, w), roc_auc_score(y, c, sample_weight=w), 12)
        self.assertAlmostEqual(cal.brier(c, y, w), brier_score_loss(y, c, sample_weight=w), 12)
        flag = c > 0.4
        for ours, theirs in zip(cal.flag_quality(flag, y, w), (precision_score, recall_score, f1_score)):
            self.assertAlmostEqual(ours, theirs(y, flag, sample_weight=w), 12)


class Measures(unittest.TestCase):
    def test_area_counts_pairs(self):
        c, y, w = sample(60)
        pairs = [(w[i] * w[j], 1 if c[i] > c[j] else 0.5 if c[i] == c[j] else 0)
                 for i in np.flatnonzero(y) for j in np.flatnonzero(~y)]
        self.assertAlmostEqual(cal.area_under_roc(c, y, w), sum(a * b for a, b in pairs) / sum(a for a, _ in pairs), 12)
        self.assertTrue(math.isnan(cal.area_under_roc(c, np.ones(60, bool), w)))

    def test_calibration_error_of_two_bins(self):
        p = np.array([0.15, 0.15, 0.95, 1.0])
        y = np.array([0, 1, 1, 1], bool)
        w = np.array([3, 1, 2, 2], float)
        # 1/2 of |0.15 - 1/4| and 1/2 of |0.975 - 1|.
        self.assertAlmostEqual(cal.calibration_error(p, y, w), 0.5 * 0.1 + 0.5 * 0.025, 12)
        np.testing.assert_allclose(cal.reliability(p, y, w), [[0.5, 0.15, 0.25], [0.5, 0.975, 1]])

    def test_flag_quality_without_a_flag(self):
        y = np.array([True, False])
        precision, recall, f1 = cal.flag_quality(np.zeros(2, bool), y, np.ones(2))
        self.assertTrue(math.isnan(precision))
        self.assertEqual((recall, f1), (0, 0))


def rows(probability, sequences=15, frames=60, seed=3):
    """Frames whose class has probability(c), in two protocols."""
    rng = np.random.default_rng(seed)
    for protocol in ("otb", "vot"):
        for s in range(sequences):
            for frame in range(frames + 10 * (s % 3)):
                c = rng.random()
                yield {"tracker": "t", "protocol": protocol, "sequence": f"s{s}", "run": "1", "frame": str(frame + 2),
                       "overlap": "0.8" if rng.random() < probability(c) else "0", "confidence": str(c)}


FOLDS = {str(k): [f"s{s}" for s in range(15) if s % 5 == k] for k in range(5)}
CANDIDATES = {"overlap": 0.5, "mappings": ["raw", "power", "logistic", "isotonic"], "lost": {"thresholds": [0.2, 0.5]}}


class Choices(unittest.TestCase):
    def test_a_calibrated_confidence_stays_as_it_is(self):
        result = cal.calibrate(cal.Frames(list(rows(lambda c: c)), 0.5), FOLDS, CANDIDATES)
        self.assertEqual(set(result["chosen"].values()), {"raw"})
        self.assertEqual(result["measures"]["out-of-fold"], result["measures"]["raw"])

    def test_the_simplest_mapping_that_is_better_is_chosen(self):
        truth = lambda c: 1 / (1 + math.exp(-(-4 + 12 * c)))
        result = cal.calibrate(cal.Frames(list(rows(truth)), 0.5), FOLDS, CANDIDATES)
        self.assertEqual(set(result["chosen"].values()), {"logistic"})
        a, b = result["parameters_on_all"]["logistic"]
        self.assertAlmostEqual(a, -4, delta=0.8)
        self.assertAlmostEqual(b, 12, delta=2)
        for measures in result["measures"]["out-of-fold"].values():
            self.assertLess(measures["ece"], 0.05)

    def test_a_fold_is_predicted_without_its_own_labels(self):
        data = list(rows(lambda c: c))
        other = [dict(row, overlap="0") if row["sequence"] in FOLDS["2"] else row for row in data]
        a, b = (cal.Frames(r, 0.5) for r in (data, other))
        here = a.of(FOLDS["2"])
        p, q = (cal.predict(f, list(FOLDS.values()), "logistic") for f in (a, b))
        np.testing.assert_array_equal(p[here], q[here])
        self.assertFalse(np.array_equal(p[~here], q[~here]))
        self.assertEqual(cal.calibrate(a, FOLDS, CANDIDATES)["chosen"]["2"], cal.calibrate(b, FOLDS, CANDIDATES)["chosen"]["2"])

    def test_the_threshold_moves_only_when_another_is_better(self):
        step = lambda edge: cal.Frames(list(rows(lambda c: float(c > edge))), 0.5)
        self.assertEqual(cal.choose_threshold(step(0.5), list(FOLDS.values()), [0.2, 0.5]), 0.5)
        self.assertEqual(cal.choose_threshold(step(0.2), list(FOLDS.values()), [0.2, 0.5]), 0.2)

    def test_every_sequence_has_the_same_weight(self):
        frames = cal.Frames(list(rows(lambda c: c)), 0.5)
        for protocol in frames.protocols:
            totals = np.bincount(frames.sequence, frames.w * (frames.protocol == protocol))
            np.testing.assert_allclose(totals, 1)


class Program(unittest.TestCase):
    def setUp(self):
        directory = tempfile.TemporaryDirectory()
        self.addCleanup(directory.cleanup)
        self.folder = pathlib.Path(directory.name)

    def run_script(self, *arguments):
        return subprocess.run([sys.executable, SCRIPT, *map(str, arguments)], capture_output=True, text=True, timeout=300)

    def test_from_runs_to_tables(self):
        for name, seed in (("first", 1), ("second", 2), ("third", 3)):
            make_sequence(self.folder / "data" / name, seed)
        run = lambda *a: subprocess.run([EXECUTABLE, *map(str, a)], capture_output=True, text=True, timeout=300)
        done = run("run", self.folder / "data", "--trackers", "dpt", "--out", self.folder / "out", "--protocol", "vot,otb")
        self.assertEqual(done.returncode, 0, done.stderr)
        done = run("export-frames", self.folder / "out", "--out", self.folder / "frames.csv")
        self.assertEqual(done.returncode, 0, done.stderr)
        lines = (self.folder / "frames.csv").read_text().splitlines()
        self.assertEqual(lines[0], "tracker,protocol,sequence,run,frame,overlap,confidence")
        self.assertIn(f"{len(lines) - 1} frames", done.stdout)
        for line in lines[1:]:
            overlap, confidence = map(float, line.split(",")[-2:])
            self.assertTrue(0 <= overlap <= 1 and 0 <= confidence <= 1, line)
        stored = (self.folder / "out/results/dpt/unsupervised/first/first_001_confidence.value").read_text().splitlines()
        self.assertEqual([float(line.split(",")[-1]) for line in lines if line.startswith("dpt,otb,first,")],
                         [float(f"{float(c):.9g}") for c in stored[1:]])
        (self.folder / "folds.tsv").write_text("0\tfirst\n1\tsecond\n2\tthird\n")
        (self.folder / "candidates.json").write_text(json.dumps(CANDIDATES))
        done = self.run_script(self.folder / "candidates.json", self.folder / "frames.csv", self.folder / "folds.tsv",
                               self.folder / "calibration.json")
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn("4 mappings and 2 thresholds tried.", done.stdout)
        self.assertIn("dpt", json.loads((self.folder / "calibration.json").read_text()))

    def test_bad_input_is_named(self):
        (self.folder / "folds.tsv").write_text("0\ta\n1\tb\n")
        (self.folder / "frames.csv").write_text("tracker,protocol,sequence,run,frame,overlap,confidence\nt,otb,a,1,2,0.5,1.5\n")
        (self.folder / "candidates.json").write_text(json.dumps(CANDIDATES))
        (self.folder / "bad.json").write_text(json.dumps(dict(CANDIDATES, mappings=["cubic"])))
        for candidates, expected in (("candidates.json", "confidences must be in [0, 1]"), ("bad.json", "mappings of raw"),
                                     ("missing.json", "missing.json")):
            done = self.run_script(self.folder / candidates, self.folder / "frames.csv", self.folder / "folds.tsv",
                                   self.folder / "out.json")
            self.assertEqual(done.returncode, 1)
            self.assertIn(expected, done.stderr)
            self.assertNotIn("Traceback", done.stderr)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
