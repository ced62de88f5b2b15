#!/usr/bin/env python3
"""returns.py, which makes tables of what asterism-returns wrote: returns_test.py SCRIPT. Ends with 77 without NumPy."""

import unittest

from script_case import RETURNS_HEAD, ScriptCase


class ReturnsTest(ScriptCase):
    def setUp(self):
        super().setUp()
        (self.root / "folds").write_text("# fold sequence\n0\tother\n1\ta\n1\tb\n")

    def run_on(self, text, *options):
        (self.root / "returns.csv").write_text(text)
        return self.run_script(self.root / "returns.csv", "--folds", self.root / "folds", *options)

    @staticmethod
    def rows(tracker, kind, sequence, before, absent, after):
        """Of the overlaps before and after the absence, and the milliseconds of the frames in between."""
        lines = [("before", o, 2) for o in before] + [("absent", "", m) for m in absent] + [("after", o, 4) for o in after]
        return "".join(f"{tracker},{kind},{sequence},{t},{state},{o},{m}\n" for t, (state, o, m) in enumerate(lines, 1))

    def test_tables_by_hand(self):
        text = RETURNS_HEAD + self.rows("plain", "cut", "a", [0.8], [10], [0, 0.2]) + self.rows("plain", "cut", "b", [0.6], [10], [0.4, 0])
        text += self.rows("found", "cut", "a", [0.8], [20], [0.6, 1]) + self.rows("found", "cut", "b", [0.6], [40], [0.4, "", 0.8])
        text += self.rows("found", "cut", "other", [0.1], [99], [0.1])
        result = self.run_on(text, "--of", "1", "--baseline", "plain")
        self.assertEqual(result.stderr, "")
        lines = [[cell.strip() for cell in line.split("|")[1:-1]] for line in result.stdout.splitlines()]
        self.assertEqual(lines[2], ["cut", "plain", "2", "0.000", "0.150", "0.700", "", "", "3.3", "10.0"])
        # The share of a is 1, that of b 1/2, as the frame without overlap does not count; AO 0.8 and 0.6.
        self.assertEqual(lines[3][:6], ["cut", "found", "2", "0.750", "0.700", "0.700"])
        self.assertEqual(lines[3][6:8], ["+0.750 (+0.500 to +1.000)", "+0.550 (+0.400 to +0.700)"])
        self.assertEqual(lines[3][9], "30.0")

    def test_a_pass_has_no_return(self):
        text = RETURNS_HEAD + self.rows("plain", "pass", "a", [0.8, 0.4], [], []) + self.rows("plain", "pass", "b", [0.2, 0.2], [], [])
        line = self.run_on(text, "--of", "1").stdout.splitlines()[2]
        self.assertIn("| pass | plain | 2 | 0.250 | 0.400 |", line)

    def test_bad_input(self):
        for text, options, error in (
            ("tracker,kind\n", ["--of", "1"], "the columns"),
            (RETURNS_HEAD, ["--of", "1"], "no sequence of these folds"),
            (RETURNS_HEAD, ["--of", "7"], "has no fold 7"),
        ):
            result = self.run_on(text, *options)
            self.assertEqual(result.returncode, 1)
            self.assertIn(error, result.stderr)

    def test_bad_numbers(self):
        for line, error in (
            ("t,cut,a,1,before,0.5,fast", "returns.csv:3: the milliseconds fast are not a number"),
            ("t,cut,a,1,before,0.5,nan", "returns.csv:3: the milliseconds nan"),
            ("t,cut,a,1,before,0.5,-1", "returns.csv:3: the milliseconds -1"),
            ("t,cut,a,1,before,0.5,inf", "returns.csv:3: the milliseconds inf"),
            ("t,cut,a,1,before,0.5,", "returns.csv:3: the milliseconds "),
            ("t,cut,a,1,before,much,2", "returns.csv:3: the overlap much"),
            ("t,cut,a,1,before", "returns.csv:3: expected 7 values"),
            ("t,cut,a,1,before,0.5,2,3", "returns.csv:3: expected 7 values"),
            ("t,cut,a,1,before,0.5,2\xff", "not a CSV file"),
        ):
            text = RETURNS_HEAD + "t,cut,a,0,before,0.5,2\n" + line + "\n"
            (self.root / "returns.csv").write_bytes(text.encode("latin-1"))
            result = self.run_script(self.root / "returns.csv", "--folds", self.root / "folds", "--of", "1")
            self.assertEqual((result.returncode, result.stdout), (1, ""), line)
            self.assertIn(error, result.stderr)
            self.assertEqual(len(result.stderr.splitlines()), 1, result.stderr)


if __name__ == "__main__":
    unittest.main()
