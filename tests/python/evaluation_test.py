#!/usr/bin/env python3
"""asterism.evaluation on a real report: evaluation_test.py REPORT."""

import csv
import pathlib
import shutil
import sys
import tempfile
import unittest
import unittest.mock

import asterism.evaluation

REPORT = pathlib.Path(sys.argv.pop())


class EvaluationTest(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.results = pathlib.Path(folder.name)
        self.report = self.results / "report"
        self.report.mkdir()
        for file in REPORT.glob("*.csv"):
            shutil.copy(file, self.report)

    def test_loads_every_table(self):
        (self.report / "curves.csv").write_text("tracker,curve,x,y\ndpt,EAO,1,0.5\ndpt,EAO,2,\n")
        tables = asterism.evaluation.load(self.results)
        self.assertEqual(list(tables), ["summary", "sequences", "attributes", "differences", "curves"])
        self.assertEqual(tables, asterism.evaluation.load(str(self.report)))
        self.assertEqual(tables["curves"], {"dpt": {"EAO": [(1.0, 0.5), (2.0, None)]}})

        with (self.report / "sequences.csv").open() as file:
            rows = list(csv.DictReader(file))
        self.assertGreater(len(rows), 50)
        for row in rows:
            self.assertEqual(tables["sequences"][row["tracker"]][row["sequence"]]["AO"], float(row["AO"]))
        # The summary's AO is the mean over sequences, its number of failures the sum.
        for tracker, row in tables["summary"].items():
            sequences = tables["sequences"][tracker].values()
            self.assertAlmostEqual(row["F"], sum(sequence["F"] for sequence in sequences), places=9)
        attributes = tables["attributes"]["dpt"]
        self.assertEqual(set(attributes["camera_motion"]), {"A", "F", "EAO"})
        self.assertEqual({type(d["significant"]) for d in tables["differences"]}, {bool})
        for difference in tables["differences"]:
            self.assertEqual(difference["significant"], not difference["low"] <= 0 <= difference["high"])

    def test_text_that_a_spreadsheet_would_compute_comes_back(self):
        (self.report / "summary.csv").write_text("tracker,EAO\n\"'=1+2\",-0.5\n\"''quoted\",1\n")
        tables = asterism.evaluation.load(self.results)
        self.assertEqual(tables["summary"], {"=1+2": {"EAO": -0.5}, "'quoted": {"EAO": 1.0}})

    def test_a_table_that_is_not_there_is_left_out(self):
        (self.report / "differences.csv").unlink()
        self.assertNotIn("differences", asterism.evaluation.load(self.results))
        shutil.rmtree(self.report)
        with self.assertRaisesRegex(FileNotFoundError, "no report here"):
            asterism.evaluation.load(self.results)

    def test_what_cannot_be_a_tracker(self):
        for trackers, error, message in [
            (3, TypeError, "expected a class, the name of a tracker, or a list of them, found an object of the type int"),
            ([], ValueError, "evaluate: no tracker"),
        ]:
            with self.subTest(message), unittest.mock.patch("shutil.which", return_value="asterism-eval"), self.assertRaisesRegex(error, message):
                asterism.evaluate(trackers, "sequences")

    def test_errors_name_file_and_line(self):
        for name, text, message in [
            ("summary", "trackers,EAO\n", "summary.csv:1: expected the columns tracker, found trackers,EAO"),
            ("summary", "", "summary.csv:1: expected the columns tracker"),
            ("summary", "tracker,EAO\ndpt,0.5\nkcf,x\n", "summary.csv:3: EAO: expected a number, found 'x'"),
            ("summary", "tracker,EAO\ndpt,0.5\ndpt,0.5\n", "summary.csv:3: a second row of dpt"),
            ("summary", 'tracker,EAO\ndpt,"0.5\n', r"summary.csv:2: "),
            ("sequences", "tracker,sequence,frames,A,F,AO\ndpt,car,1\n", "sequences.csv:2: expected 6 cells, found 3"),
            ("curves", "tracker,curve,x,y\ndpt,EAO,1,1\ndpt,EAO,,nought\n", "curves.csv:3: y: expected a number"),
            (
                "differences",
                "measure,a,b,value,low,high,significant\nEAO,a,b,1,1,1,maybe\n",
                "differences.csv:2: significant: expected yes or no, found 'maybe'",
            ),
        ]:
            with self.subTest(message):
                self.setUp()
                (self.report / f"{name}.csv").write_text(text)
                with self.assertRaisesRegex(ValueError, message):
                    asterism.evaluation.load(self.results)


if __name__ == "__main__":
    unittest.main()
