#!/usr/bin/env python3
"""bench/evaluation/cross_validation.py: cross_validation_test.py SCRIPT EXECUTABLE. Standard library alone."""

import importlib.util
import json
import pathlib
import subprocess
import sys
import tempfile
import unittest

from synthetic import make_sequence

SCRIPT, EXECUTABLE = sys.argv[1:3]
spec = importlib.util.spec_from_file_location("cross_validation", SCRIPT)
cv = importlib.util.module_from_spec(spec)
spec.loader.exec_module(cv)


def differences_of(better):
    """Of every pair, by (candidate, other, low of EAO, low of AO); both ways."""
    result = {}
    for a, b, eao, ao in better:
        for measure, low in (("EAO", eao), ("AO", ao)):
            result[measure, a, b] = (low + 0.1, low, low + 0.2)
            result[measure, b, a] = (-low - 0.1, -low - 0.2, -low)
    return result


class ChoiceTest(unittest.TestCase):
    names = ["published", "simple", "complex"]

    def test_the_published_setting_stays_unless_both_measures_favour_another(self):
        never = [("simple", "published", -0.01, 0.05), ("complex", "published", 0.05, -0.01), ("complex", "simple", 0, 0)]
        self.assertEqual(cv.choose(self.names, differences_of(never)), "published")

    def test_among_equals_the_simplest(self):
        both = [("simple", "published", 0.01, 0.01), ("complex", "published", 0.02, 0.02), ("complex", "simple", -0.01, 0.3)]
        self.assertEqual(cv.choose(self.names, differences_of(both)), "simple")

    def test_without_an_interval_nothing_is_favored(self):
        nan = float("nan")
        self.assertEqual(cv.choose(self.names[:2], differences_of([("simple", "published", nan, nan)])), "published")

    def test_a_later_one_that_is_better_than_the_choice(self):
        best = [("simple", "published", 0.01, 0.01), ("complex", "published", 0.02, 0.02), ("complex", "simple", 0.01, 0.01)]
        self.assertEqual(cv.choose(self.names, differences_of(best)), "complex")


class Files(unittest.TestCase):
    def setUp(self):
        directory = tempfile.TemporaryDirectory()
        self.addCleanup(directory.cleanup)
        self.folder = pathlib.Path(directory.name)

    def write(self, name, text):
        (self.folder / name).write_text(text)
        return self.folder / name

    def refused(self, pattern, function, *arguments):
        with self.assertRaisesRegex(cv.BadInput, pattern):
            function(*arguments)


class InputTest(Files):
    def test_folds(self):
        self.assertEqual(cv.read_folds(self.write("f", "# fold\tsequence\n0\ta\t12\n1\tb\n0\tc\n")), {"0": ["a", "c"], "1": ["b"]})
        self.refused("f:2: expected FOLD<tab>SEQUENCE", cv.read_folds, self.write("f", "0\ta\n1 b\n"))
        self.refused("f:2: a is there twice", cv.read_folds, self.write("f", "0\ta\n1\ta\n"))
        self.refused("two folds", cv.read_folds, self.write("f", "0\ta\n"))
        self.refused("No such file", cv.read_folds, self.folder / "none")

    def test_candidates(self):
        good = {"candidates": {"a": "kcf", "b": "dpt"}}
        self.assertEqual(cv.read_candidates(self.write("c", json.dumps(good))), good["candidates"])
        for bad in ("{", "[]", '{"candidates": {"a": "kcf"}}', '{"candidates": {"a": "kcf", "b": 1}}',
                    '{"candidates": {"a": "kcf", "out-of-fold": "dpt"}}'):
            self.refused("c: ", cv.read_candidates, self.write("c", bad))

    def test_candidates_by_fold(self):
        good = {"candidates": {"a": {"tracker": "kcf"}, "b": {"by_fold": {"0": "dpt", "1": {"tracker": "dpt"}}}}}
        self.assertEqual(cv.read_candidates(self.write("c", json.dumps(good))), good["candidates"])
        for bad, pattern in (('{"a": "kcf", "b": {"by_fold": []}}', "b: not a name with"),
                             ('{"a": "kcf", "b": {"by_fold": {"0": 1}}}', "b: \"by_fold\" must have"),
                             ('{"a": {"by_fold": {"0": "kcf"}}, "b": "dpt"}', "the first candidate is the published")):
            self.refused(pattern, cv.read_candidates, self.write("c", f'{{"candidates": {bad}}}'))
        candidates = self.write("c", '{"candidates": {"a": "kcf", "b": {"by_fold": {"0": "dpt"}}}}')
        self.refused("b: no description for fold 1", cv.cross_validate, candidates, "", "", self.write("f", "0\ta\n1\tb\n"),
                     self.folder / "out", [])

    def test_the_published_setting_is_chosen_where_it_is_alone(self):
        self.assertEqual(cv.choose(["published"], {}), "published")

    def test_what_was_tried_is_kept(self):
        cv.declare({"a": "kcf", "b": "dpt"}, self.folder)
        self.assertEqual(cv.declare({"a": "kcf", "c": "dpt_plus"}, self.folder), {"a": "kcf", "b": "dpt", "c": "dpt_plus"})
        self.refused("b was dpt", cv.declare, {"a": "kcf", "b": "dpt_crs"}, self.folder)
        self.write("tried.json", "{")
        self.refused("tried.json: damaged", cv.declare, {"a": "kcf", "b": "dpt"}, self.folder)


class RunTest(Files):
    def test_the_results_out_of_fold_are_those_of_the_choices(self):
        for number, name in enumerate("abcd"):
            make_sequence(self.folder / "data" / name, number, 30)
        folds = self.write("folds.tsv", "0\ta\n0\tb\n1\tc\n1\td\n")
        # A candidate that hardly moves, and one that follows the object.
        candidates = self.write("candidates.json", json.dumps(
            {"candidates": {"stands": 'dpt_crs_nos{"root": {"model": "template", "padding": 1e-9}}', "kcf": "kcf"}}))
        out = self.folder / "out"
        command = [sys.executable, SCRIPT, candidates, EXECUTABLE, self.folder / "data", folds, out, "--workers", "2", "--interval", "10:20"]
        first = subprocess.run(command, capture_output=True, text=True, check=False)
        self.assertEqual(first.returncode, 0, first.stderr)
        result = json.loads((out / "cross_validation.json").read_text())
        self.assertEqual(set(result["tried"]), {"stands", "kcf"})
        self.assertIn("2 candidates tried on 4 sequences in 2 folds.", first.stdout)
        for fold, held_out in (("0", "ab"), ("1", "cd")):
            choice = result["choices"][fold]
            for sequence in held_out:
                for path in (out / "results" / choice).glob(f"*/{sequence}/*_001.txt"):
                    copy = out / "results" / cv.OUT_OF_FOLD / path.relative_to(out / "results" / choice)
                    self.assertEqual(copy.read_text(), path.read_text())
        if set(result["choices"].values()) == {"kcf"}:
            self.assertEqual(result["figures"]["out-of-fold"], result["figures"]["kcf"])
        # The same command reuses all results and prints the same.
        second = subprocess.run(command, capture_output=True, text=True, check=False)
        self.assertEqual(second.stdout, first.stdout)
        self.assertIn("0 runs made", second.stderr)

    def test_a_candidate_by_fold_is_run_as_described_for_each_fold(self):
        for number, name in enumerate("abcd"):
            make_sequence(self.folder / "data" / name, number, 30)
        folds = self.write("folds.tsv", "0\ta\n0\tb\n1\tc\n1\td\n")
        stands = {"tracker": "dpt_crs_nos", "root": {"model": "template", "padding": 1e-9}}
        candidates = self.write("candidates.json", json.dumps(
            {"candidates": {"kcf": "kcf", "fitted": {"by_fold": {"0": stands, "1": "kcf"}}}}))
        out = self.folder / "out"
        command = [sys.executable, SCRIPT, candidates, EXECUTABLE, self.folder / "data", folds, out, "--workers", "2", "--interval", "10:20"]
        first = subprocess.run(command, capture_output=True, text=True, check=False)
        self.assertEqual(first.returncode, 0, first.stderr)
        result = json.loads((out / "cross_validation.json").read_text())
        # It is never chosen, also where it is no worse.
        self.assertEqual(result["choices"], {"0": "kcf", "1": "kcf"})
        self.assertEqual(result["figures"]["out-of-fold"], result["figures"]["kcf"])

        def boxes(tracker, sequence, folder=out):
            found = {path.relative_to(folder / "results" / tracker): path.read_text()
                     for path in (folder / "results" / tracker).glob(f"*/{sequence}/*_001.txt")}
            self.assertEqual(len(found), 2, "in both protocols")
            return found
        for sequence in "ab":
            self.assertEqual(boxes("fitted", sequence), boxes("fitted", sequence, out / "by-fold/0"))
            self.assertNotEqual(boxes("fitted", sequence), boxes("kcf", sequence))
        for sequence in "cd":
            self.assertEqual(boxes("fitted", sequence), boxes("kcf", sequence))
        for measure in cv.RULE:
            difference = result["figures"]["fitted"][measure] - result["figures"]["kcf"][measure]
            self.assertNotEqual(difference, 0)
            self.assertAlmostEqual(result["by_fold_minus_published"]["fitted"][measure][0], difference, places=6)
            self.assertIn(f"{measure} fitted, against kcf: {difference:+.3f}", first.stdout)
        second = subprocess.run(command, capture_output=True, text=True, check=False)
        self.assertEqual(second.stdout, first.stdout)
        self.assertNotRegex(second.stderr, "[1-9][0-9]* runs? made")
        # Another description for a fold is another candidate.
        candidates.write_text(candidates.read_text().replace('"1": "kcf"', '"1": "dpt"'))
        third = subprocess.run(command, capture_output=True, text=True, check=False)
        self.assertRegex(third.stderr, "fitted was .*: give the changed candidate another name")

    def test_errors_are_one_line(self):
        for arguments, pattern in (((self.folder / "none", EXECUTABLE), "No such file"),
                                   ((self.write("c", '{"candidates": {"a": "kcf", "b": "dpt"}}'), self.folder / "none"), "none: ")):
            folds = self.write("folds.tsv", "0\ta\n1\tb\n")
            result = subprocess.run([sys.executable, SCRIPT, *arguments, self.folder, folds, self.folder / "out"],
                                    capture_output=True, text=True, check=False)
            self.assertEqual(result.returncode, 1)
            self.assertRegex(result.stderr, pattern)
            self.assertEqual(len(result.stderr.splitlines()), 1)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
