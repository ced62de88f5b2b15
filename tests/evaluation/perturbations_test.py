#!/usr/bin/env python3
"""perturbations.py, which measures how much results change by chance: perturbations_test.py SCRIPT. Ends with 77 without NumPy."""

import json
import statistics
import unittest

from script_case import RETURNS_HEAD, ScriptCase


def rows(tracker, kind, sequence, overlaps):
    return "".join(f"{tracker},{kind},{sequence},{t},before,{o},1\n" for t, o in enumerate(overlaps, 1))


class PerturbationsTest(ScriptCase):
    def run_on(self, *texts, options=()):
        paths = [self.root / f"{i}.csv" for i in range(len(texts))]
        for path, text in zip(paths, texts):
            path.write_text(RETURNS_HEAD + text)
        return self.run_script(*paths, *options)

    @staticmethod
    def cells(line):
        return [cell.strip() for cell in line.split("|")[1:-1]]

    def test_tables_by_hand(self):
        # AO of the kinds pass, left, jpeg-85: a .6 (a frame does not count), .4, .5; b .8, .8, .2; their means .7, .6, .35.
        text = rows("t", "jpeg-85", "a", [0.5]) + rows("t", "pass", "a", [0.4, "", 0.8]) + rows("t", "left", "a", [0.4])
        more = rows("t", "pass", "b", [0.8]) + rows("t", "left", "b", [1, 0.6]) + rows("t", "jpeg-85", "b", [0.2])
        more += rows("t", "covered", "b", [0.9]) + rows("t", "pass", "without_left", [0.9])
        result = self.run_on(text, more)
        self.assertEqual(result.stderr, "")
        lines = result.stdout.splitlines()
        self.assertEqual(lines[0], "2 sequences, 3 runs on each: pass, left, jpeg-85")
        a, b = statistics.stdev([0.6, 0.4, 0.5]), statistics.stdev([0.8, 0.8, 0.2])
        expected = (a * a + b * b) ** 0.5 / 2
        self.assertEqual(
            self.cells(lines[4]),
            ["t", "0.550", f"{(a + b) / 2:.3f}", f"b {b:.3f}, a {a:.3f}", f"{statistics.stdev([0.7, 0.6, 0.35]):.4f}", f"{expected:.4f}",
             f"{2.772 * expected:.3f}"])
        self.assertEqual(self.cells(lines[-1]), ["t", "0.700", "0.600", "0.350"])

    def test_only_sequences_of_all_trackers(self):
        text = "".join(rows(tracker, kind, name, [0.5]) for tracker in "tu" for kind in ("pass", "up") for name in "ab")
        result = self.run_on(text, rows("u", "pass", "c", [0.1]) + rows("u", "up", "c", [0.3]))
        self.assertTrue(result.stdout.startswith("2 sequences"), result.stdout)
        self.assertIn("| u | 0.500 | 0.000 |", result.stdout)

    def test_only_chosen_sequences(self):
        text = "".join(rows("t", kind, name, [ao]) for kind in ("pass", "up") for name, ao in (("a", 0.2), ("b", 0.4), ("c", 0.9)))
        folds = self.root / "folds"
        folds.write_text("0\ta\n1\tb\n")
        for options, ao in (((), "0.500"), (("--folds", folds), "0.300"), (("--folds", folds, "--of", "1"), "0.400")):
            self.assertIn(f"| t | {ao} |", self.run_on(text, options=options).stdout)
        for options, error in ((("--of", "1"), "--of needs --folds"), (("--folds", folds, "--of", "7"), "has no fold 7")):
            result = self.run_on(text, options=options)
            self.assertEqual(result.returncode, 1)
            self.assertIn(error, result.stderr)

    @staticmethod
    def report(*starts, mixed=(), length=9):
        scores = [dict(zip(("EAO", "A", "F"), each)) for each in (*starts, *mixed)]
        tracker = {"name": "t", "vot": {"starts": scores[:len(starts)], "mixed_starts": scores[len(starts):]},
                   "sequences": {name: {"start_F": [f * share for _, _, f in starts]} for name, share in (("a", 0), ("b", 1))}}
        return {"sequences": {"a": length, "b": length}, "eao_interval": {"low": 3}, "trackers": [tracker, {"name": "one pass"}]}

    def run_on_reports(self, *reports):
        paths = [self.root / f"{i}.json" for i in range(len(reports))]
        for path, report in zip(paths, reports):
            path.write_text(report if isinstance(report, str) else json.dumps(report))
        return self.run_script(*paths)

    def test_reports(self):
        mixed = ((0.3, 0.6, 4), (0.2, 0.6, 6))
        result = self.run_on_reports(self.report((0.3, 0.5, 4), (0.2, 0.7, 6), mixed=mixed), self.report((0.4, 0.6, 2)))
        self.assertEqual(result.stderr, "")
        lines = result.stdout.splitlines()
        # Of two draws, .3 and .2, the deviation is .05; that of two values from which they are drawn is larger by the root of 2.
        self.assertEqual(self.cells(lines[2]), ["t", "EAO (3 runs)", "0.300", "0.1000", "0.0707", "0.196"])
        self.assertEqual(self.cells(lines[4]), ["t", "F (3 runs)", "4.000", "2.0000", "1.4142", "3.920"])
        self.assertEqual(lines[-1], "t: b 4 6 2, a 0 0 0")
        for reports, error in (
            ([self.report((0.3, 0.5, 4))], "0.json: t has one start only"),
            ([self.report((0.3, 0.5, 4), (0.2, 0.7, 6), mixed=mixed), self.report((0.4, 0.6, 2), length=8)], "other sequences"),
            (["{"], "Expecting"), (["{}"], "0.json: not a report of asterism-eval"), (["[]"], "0.json: not a report of asterism-eval"),
        ):
            result = self.run_on_reports(*reports)
            self.assertEqual(result.returncode, 1)
            self.assertIn(error, result.stderr)
            self.assertEqual(result.stderr.count("\n"), 1, result.stderr)

    def test_bad_input(self):
        for text, error in (
            ("", "no frame of these kinds and sequences"),
            (rows("t", "covered", "a", [0.5]), "no frame of these kinds and sequences"),
            (rows("t", "pass", "a", [0.5]), "two kinds at least"),
            (rows("t", "pass", "a", [0.5]) + rows("t", "up", "b", [0.5]), "no sequence has the kinds"),
            (rows("t", "pass", "a", ["nan"]), "0.csv:2: the overlap nan"),
            (rows("t", "pass", "a", ["x"]), "0.csv:2: the overlap x"),
            (rows("t", "pass", "a", [1.5]), "0.csv:2: the overlap 1.5"),
        ):
            result = self.run_on(text)
            self.assertEqual(result.returncode, 1, text)
            self.assertIn(error, result.stderr)
            self.assertNotIn("Traceback", result.stderr)
        (self.root / "columns.csv").write_text("tracker,kind\n")
        result = self.run_script(self.root / "columns.csv")
        self.assertEqual(result.returncode, 1)
        self.assertIn("the columns overlap, sequence are missing", result.stderr)


if __name__ == "__main__":
    unittest.main()
