#!/usr/bin/env python3
"""Trackers written in Python, run through asterism.trax: trax_test.py [ASTERISM_EVAL].

The client is written from the protocol's documentation. With asterism-eval, the scores have to be those of the same tracker run directly.
"""

import base64
import json
import os
import pathlib
import subprocess
import sys
import tempfile
import unittest

import asterism
import numpy as np
from moving_square import BOX, draw_frame, true_box, write_png

EVAL = sys.argv.pop() if len(sys.argv) > 1 and not sys.argv[-1].startswith("-") else None

TRACKERS = """
import asterism
import numpy as np

class NoStart:
    def update(self, image):
        return None


class Seen:
    "Answers with what it was given, so that the test sees it."
    def init(self, image, box):
        print("a line that is no message")
        self.first, self.box = image, box
        assert image.dtype == np.uint8 and image.flags.c_contiguous
    def update(self, image):
        return [float(image[0, 0].flat[0]), float(image[0, 0].flat[-1]), float(image.shape[1]), float(image.shape[0])]

class Pair(Seen):
    def update(self, image):
        return image[0, 0].flat[0] > 9, self.box

class Blind(Seen):
    def update(self, image):
        return None

class Fails(Seen):
    def update(self, image):
        raise RuntimeError("no \\"more\\"\\nlines")

class Wrong(Seen):
    def update(self, image):
        return 1, 2, 3

def kcf():
    return asterism.Tracker("kcf")

def cv2():
    return asterism.OpenCvTracker("kcf")

number = 7
"""


def message(kind, *arguments):
    return "@@TRAX:" + kind + "".join(f' "{each}"' for each in arguments) + "\n"


def memory(image):
    height, width = image.shape[:2]
    if image.ndim == 3:
        return f"image:{width};{height};rgb;" + base64.b64encode(np.ascontiguousarray(image[..., ::-1]).tobytes()).decode()
    return f"image:{width};{height};{'gray16' if image.dtype == np.uint16 else 'gray8'};" + base64.b64encode(image.tobytes()).decode()


class TraxTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        scratch = tempfile.TemporaryDirectory()
        cls.addClassCleanup(scratch.cleanup)
        cls.folder = pathlib.Path(scratch.name)
        (cls.folder / "mine.py").write_text(TRACKERS)

    def run_on(self, spec, lines):
        command = [sys.executable, "-m", "asterism.trax", spec]
        return subprocess.run(command, input="".join(lines), cwd=self.folder, capture_output=True, text=True, timeout=60)

    def session(self, spec, images, box="1.5,2,30,40", end=("quit",)):
        lines = [message("initialize", memory(images[0]), box), *(message("frame", memory(each)) for each in images[1:])]
        done = self.run_on(spec, [*lines, *map(message, end)])
        return done, done.stdout.splitlines()

    def test_what_a_tracker_gets_and_says(self):
        image = np.zeros((5, 7, 3), np.uint8)
        image[0, 0] = 10, 20, 30  # blue, green, red
        for spec in ("mine:Seen", "mine.py:Seen"):
            done, (hello, start, state) = self.session(spec, [image, image])
            self.assertEqual(done.returncode, 0, done.stderr)
            self.assertRegex(hello, '^@@TRAX:hello "trax.version=1" .*"trax.region=rectangle" "trax.image=memory"')
            self.assertEqual(start, '@@TRAX:state "1.5,2.0,30.0,40.0"')
            self.assertEqual(state, '@@TRAX:state "10.0,30.0,7.0,5.0"')
            self.assertIn("a line that is no message", done.stderr)
        gray = np.full((5, 7), 10, np.uint8)
        self.assertEqual(self.session("mine:Seen", [gray, gray])[1][-1], '@@TRAX:state "10.0,10.0,7.0,5.0"')
        self.assertEqual(self.session("mine:Seen", [gray, gray.astype(np.uint16) * 100])[1][-1], '@@TRAX:state "1000.0,1000.0,7.0,5.0"')
        self.assertEqual(self.session("mine:Pair", [gray, gray, 0 * gray])[1][-2:], ['@@TRAX:state "1.5,2.0,30.0,40.0"', '@@TRAX:state "0"'])
        self.assertEqual(self.session("mine:Blind", [gray, gray])[1][-1], '@@TRAX:state "0"')

    def test_our_trackers(self):
        frames = [draw_frame(i) for i in range(4)]
        box = ",".join(map(str, BOX))
        tracker = asterism.Tracker("kcf")
        tracker.init(frames[0], BOX)
        for state, frame in zip(self.session("mine:kcf", frames, box)[1][2:], frames[1:]):
            result = tracker.update(frame)
            region = ",".join(map(repr, result.box))
            self.assertEqual(state, f'@@TRAX:state "{region}" "confidence={result.confidence}" "lost=0"')
        last = self.session("mine:cv2", frames, box)[1][-1]
        np.testing.assert_allclose([float(v) for v in last.split('"')[1].split(",")], true_box(3), atol=3)

    def test_errors_are_told(self):
        image = np.zeros((5, 7), np.uint8)
        for spec, reason in {"mine:Fails": r"RuntimeError: no \"more\"\nlines", "mine:Wrong": "ValueError: update: expected a box (x, y, width, height), found (1, 2, 3)"}.items():
            done, lines = self.session(spec, [image, image])
            self.assertEqual((done.returncode, lines[-1]), (1, f'@@TRAX:quit "trax.reason={reason}"'))
            self.assertIn("Traceback", done.stderr)
        done, lines = self.session("mine:Seen", [image], end=())
        self.assertEqual((done.returncode, "without a quit" in lines[-1]), (1, True))
        for lines in ([message("frame", memory(image))], [message("initialize", "/a/file.png", "1,2,3,4")], [message("state", "1,2,3,4")]):
            done = self.run_on("mine:Seen", lines)
            self.assertEqual((done.returncode, done.stdout.splitlines()[-1][:25]), (1, '@@TRAX:quit "trax.reason='))
        for spec, text in {
            "mine": "expected MODULE:CLASS, found 'mine'", "nothing:T": "No module named 'nothing'", "mine:T": "mine has no class 'T'",
            "mine:number": "mine has no class 'number'", "no.py:T": "no.py: no such file",
            "mine:NoStart": "mine: the class NoStart has no init(image, box)",
        }.items():
            done = self.run_on(spec, [])
            self.assertEqual((done.returncode, done.stderr), (2, f"asterism.trax: {text}\n"))
        self.assertEqual(subprocess.run([sys.executable, "-m", "asterism.trax"], capture_output=True).returncode, 2)

    def write_sequence(self):
        sequence = self.folder / "data" / "square"
        sequence.mkdir(parents=True, exist_ok=True)
        for i in range(12):
            write_png(sequence / f"{i + 1:08}.png", draw_frame(i))
        (sequence / "groundtruth.txt").write_text("".join(",".join(map(str, true_box(i))) + "\n" for i in range(12)))

    @unittest.skipUnless(EVAL, "asterism-eval was not built")
    def test_scores_are_those_of_the_same_tracker(self):
        self.write_sequence()
        # A file of such a name shows that the shell gets it as one word.
        (self.folder / "it's mine.py").write_text(TRACKERS)
        externals = {"command": f"{sys.executable} -m asterism.trax mine:kcf", "module": "python:mine:kcf", "file": "python:it's mine.py:kcf"}
        named = [argument for name, external in externals.items() for argument in ("--external", f"{name}={external}")]
        done = self.evaluate("--trackers", "kcf", *named)
        self.assertEqual(done.returncode, 0, done.stderr)
        for protocol in ("baseline", "unsupervised"):
            direct, *others = (
                [line.split(",") for line in (self.folder / f"out/results/{name}/{protocol}/square/square_001.txt").read_text().splitlines()]
                for name in ("kcf", *externals)
            )
            for ours in others:
                self.assertEqual((len(ours), ours[0]), (12, direct[0]))
                np.testing.assert_allclose(np.array(ours[1:], float), np.array(direct[1:], float), atol=1e-3)
        for external, text in {
            "python:mine": 'expected python:MODULE:CLASS or python:FILE.py:CLASS, found "python:mine"',
            "python::kcf": 'found "python::kcf"', "python:mine:": 'found "python:mine:"', "python:mine:T": "mine has no class 'T'",
        }.items():
            done = self.evaluate("--external", f"wrong={external}")
            self.assertEqual(done.returncode, 1)
            self.assertIn(text, done.stderr)
        # Another python3, which does not find the package.
        (self.folder / "python3").write_text(f'#!/bin/sh\nexec "{sys.executable}" -I "$@"\n')
        (self.folder / "python3").chmod(0o755)
        done = self.evaluate("--external", "elsewhere=python:mine:kcf", path=str(self.folder))
        self.assertEqual(done.returncode, 1)
        self.assertIn(f"{sys.executable}, which is python3 here: No module named 'asterism'", done.stderr)
        self.assertTrue(done.stderr.endswith("tracker 'python:mine:kcf': ended with exit code 1 before its first answer\n"), done.stderr)
        self.assertNotIn("Traceback", done.stderr)

    @unittest.skipUnless(EVAL, "asterism-eval was not built")
    def test_evaluate(self):
        self.write_sequence()
        (self.folder / "still.py").write_text("class Still:\n"
                                              "    def init(self, image, box): self.box = box\n"
                                              "    def update(self, image): return self.box\n")
        tables = self.script("from still import Still\nimport asterism, json\n"
                             "class Moved(Still):\n    def update(self, image): return (1000, 1000, 5, 5)\n"
                             "if __name__ == '__main__':\n"
                             "    options = dict(protocol=['vot', 'otb'], workers=1, bounded=False)\n"
                             "    tables = asterism.evaluate([Still, Moved, 'kcf'], 'data', folder='kept', **options)\n"
                             "    assert asterism.evaluate({'a': Still}, 'data', **options)['summary']['a']['AO'] == tables['summary']['Still']['AO']\n"
                             "    print(json.dumps(tables['summary']))\n")
        tables = json.loads(tables.stdout)
        self.assertEqual(set(tables), {"Moved", "Still", "kcf"})
        x, y, width, height = true_box(0)
        overlaps = []
        for i in range(1, 12):  # the first frame does not count
            left, top = true_box(i)[:2]
            both = max(width - abs(left - x), 0) * max(height - abs(top - y), 0)
            overlaps.append(both / (2 * width * height - both))
        self.assertAlmostEqual(tables["Still"]["AO"], np.mean(overlaps), places=6)
        self.assertEqual(tables["Moved"]["AO"], 0)
        self.assertEqual((tables["Moved"]["F"], tables["kcf"]["F"]), (2, 0))
        self.assertGreater(tables["kcf"]["AO"], 0.9)
        self.assertTrue((self.folder / "kept/report/report.html").is_file())

        for lines, error in {
            "class T: pass\nasterism.evaluate(T, 'data')": "ValueError: evaluate: the class T has no function 'init'",
            "from still import Still\nclass T(Still): pass\nasterism.evaluate(T, 'data', protocol='otb')": "RuntimeError: evaluate: called while the file of its class is loaded",
            "from still import Still\nasterism.evaluate([Still()], 'data')": "ValueError: evaluate: expected a class, .*, found an instance: give Still itself",
            "asterism.evaluate(lambda: None, 'data')": "ValueError: evaluate: <lambda> has no name at the top level",
            "asterism.evaluate(['kcf', 'kcf'], 'data')": "ValueError: evaluate: two trackers with the name 'kcf'",
            "asterism.evaluate('kcf', 'data', nothing=3)": "RuntimeError: .*--nothing",
            "asterism.evaluate('kcf', 'no data')": "RuntimeError: .*no data",
            "asterism.evaluate('kcff', 'data')": "RuntimeError: .*kcff",
            "import os\nos.environ['PATH'] = ''\nasterism.evaluate('kcf', 'data')": "FileNotFoundError: asterism-eval is not on the PATH",
        }.items():
            with self.subTest(lines):
                self.assertRegex(self.script("import asterism\n" + lines, fails=True).stderr, error)
        typed = subprocess.run([sys.executable, "-c", "import asterism\ndef make(): pass\nasterism.evaluate(make, 'data')"], env=self.environment(),
                               cwd=self.folder, capture_output=True, text=True, timeout=60)
        self.assertIn("make was typed into this session", typed.stderr)

    def environment(self):
        return os.environ | {"PATH": os.pathsep.join([os.path.dirname(EVAL), os.environ["PATH"]])}

    def script(self, text, fails=False):
        (self.folder / "script.py").write_text(text)
        done = subprocess.run([sys.executable, "script.py"], cwd=self.folder, env=self.environment(), capture_output=True, text=True, timeout=120)
        self.assertEqual(done.returncode, int(fails), done.stderr)
        return done

    def evaluate(self, *trackers, path=os.path.dirname(sys.executable)):
        path = os.pathsep.join([path, os.environ["PATH"]])  # python3 is the one that runs this test
        command = [EVAL, "run", self.folder / "data", *trackers, "--out", "out", "--workers", "1"]
        return subprocess.run(command, cwd=self.folder, env=os.environ | {"PATH": path}, capture_output=True, text=True, timeout=300)


if __name__ == "__main__":
    unittest.main()
