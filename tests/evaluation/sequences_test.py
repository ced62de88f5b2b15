#!/usr/bin/env python3
"""sequences.py, which compares a folder with the list of the development sequences: sequences_test.py SCRIPT CROSS_VALIDATION [DATA]."""

import collections
import hashlib
import importlib.util
import os
import pathlib
import subprocess
import sys
import tempfile
import unittest

SCRIPT, CROSS_VALIDATION = map(pathlib.Path, sys.argv[1:3])
DATA = os.environ.get("ASTERISM_SEQUENCES", "")
del sys.argv[1:]
sys.dont_write_bytecode = True


def module(path):
    spec = importlib.util.spec_from_file_location(path.stem, path)
    loaded = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(loaded)
    return loaded


BOXES = "10,20,30,40\n11.5,20,30,40\nnan,nan,nan,nan\n"


class SequencesTest(unittest.TestCase):
    def setUp(self):
        scratch = tempfile.TemporaryDirectory()
        self.addCleanup(scratch.cleanup)
        self.root = pathlib.Path(scratch.name)
        self.make()
        # The checksums, computed here by the words of the script's documentation.
        images = hashlib.sha256(b"".join(hashlib.sha256(f"image {k}".encode()).digest() for k in range(3))).hexdigest()
        boxes = hashlib.sha256(b"10.00,20.00,30.00,40.00\n11.50,20.00,30.00,40.00\nnan,nan,nan,nan\n").hexdigest()
        self.known = {"frames": "3", "boxes sha256": boxes, "images sha256": images}
        self.sequences = module(SCRIPT)

    def make(self, boxes=BOXES, frames=3):
        (self.root / "one/color").mkdir(parents=True, exist_ok=True)
        for k in range(frames):
            (self.root / f"one/color/{k + 1:08}.jpg").write_text(f"image {k}")
        (self.root / "one/groundtruth.txt").write_text(boxes)

    def difference(self):
        return self.sequences.difference(self.known, self.root / "one")

    def test_the_same(self):
        self.assertEqual(self.difference(), "")
        self.make("10.0\t20\t30\t40\n1.15e1, 20.001, 30, 40\nNaN,NaN,NaN,NaN\n\n")  # numbers may be written in another way
        self.assertEqual(self.difference(), "")

    def test_what_differs(self):
        self.make(BOXES.replace("11.5", "11.6"))
        self.assertEqual(self.difference(), "other boxes")
        self.make("one,two\n")
        self.assertEqual(self.difference(), "other boxes: could not convert string to float: 'one'")
        self.make(BOXES)
        (self.root / "one/color/00000002.jpg").write_text("image 9")
        self.assertEqual(self.difference(), "other images")
        self.make(frames=4)
        self.assertEqual(self.difference(), "4 frames, expected 3")
        (self.root / "one/groundtruth.txt").unlink()
        self.assertEqual(self.difference(), "missing")

    def test_the_list(self):
        known = self.sequences.known_sequences()
        self.assertEqual(collections.Counter(row["fold"] for row in known), {str(fold): 10 for fold in range(5)})
        self.assertEqual(collections.Counter(row["fold"] for row in known if row["set"] != "3"), {str(fold): 7 for fold in range(5)})
        self.assertEqual(len({row["sequence"] for row in known}), 50)
        self.assertEqual(sum(int(row["frames"]) for row in known if row["set"] != "3"), 8346)  # as docs/results/evaluation.md says
        for row in known:
            self.assertEqual(len(row), 8)
            self.assertRegex(row["boxes sha256"] + row["images sha256"], "^[0-9a-f]{128}$")

    def test_as_a_program(self):
        run = lambda *arguments: subprocess.run([sys.executable, SCRIPT, *map(str, arguments)], capture_output=True, text=True)
        done = run(self.root)
        self.assertEqual((done.returncode, done.stderr), (1, ""))
        self.assertEqual(done.stdout.splitlines()[0::50], ["david: missing", "0 of 50 sequences are those of sequences.tsv"])
        done = run(self.root / "nowhere")
        self.assertEqual((done.returncode, done.stderr), (1, f"sequences.py: {self.root}/nowhere: no such folder\n"))
        for count, each in ((35, 7), (50, 10)):
            self.assertEqual(run("--folds", count, self.root / "folds.tsv").returncode, 0)
            folds = module(CROSS_VALIDATION).read_folds(self.root / "folds.tsv")
            self.assertEqual([len(fold) for fold in folds.values()], 5 * [each])
        self.assertEqual(run("--folds", 40, self.root / "folds.tsv").returncode, 2)

    @unittest.skipUnless(os.path.isdir(DATA), "the development sequences are not here (ASTERISM_SEQUENCES)")
    def test_the_sequences(self):
        done = subprocess.run([sys.executable, SCRIPT, DATA], capture_output=True, text=True)
        self.assertEqual((done.returncode, done.stdout), (0, "50 of 50 sequences are those of sequences.tsv\n"))


if __name__ == "__main__":
    unittest.main()
