#!/usr/bin/env python3
"""The examples as a user runs them, small: examples_test.py PROJECT."""

import importlib.util
import os
import pathlib
import re
import subprocess
import sys
import tempfile
import unittest

import asterism
import numpy as np
from moving_square import BOX, draw_frame, true_box, write_png
from PIL import Image

PROJECT = pathlib.Path(sys.argv.pop())
EXAMPLES = PROJECT / "docs/examples"


class ExamplesTest(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)
        self.figure = self.folder / "figure.png"

    def run_example(self, name, *arguments):
        command = [sys.executable, str(EXAMPLES / name), *map(str, arguments)]
        run = subprocess.run(command, capture_output=True, text=True)
        self.assertEqual((run.returncode, run.stderr), (0, ""), run.stdout)
        return run.stdout

    def assert_drawn(self, colors):
        """A figure with at least so many colors: axes alone have fewer."""
        pixels = np.asarray(Image.open(self.figure).convert("RGB"))
        self.assertGreater(min(pixels.shape[:2]), 250)
        self.assertGreater(len(np.unique(pixels.reshape(-1, 3), axis=0)), colors)

    def test_locate(self):
        self.assertIn("proven; the beacons lie in one plane", self.run_example("locate.py"))

    def test_locate_path(self):
        page = (PROJECT / "docs/locate.md").read_text()
        self.assertIn(f"```text\n{self.run_example('locate_path.py')}```", page)

    def test_survey(self):
        page = (PROJECT / "docs/locate.md").read_text()
        self.assertIn(f"```text\n{self.run_example('survey.py')}```", page)

    def test_path_from_ranges(self):
        rng = np.random.default_rng(1)
        beacons = np.array([[20, 5], [-15, 10], [0, -20]])
        heading, turns = 0.0, 0.05 + 0.2 * rng.normal(size=150)
        places, lines = [np.zeros(2)], ["VERTEX_SE2 0 A0 0 0 0"]
        for k, turn in enumerate(turns):
            places.append(places[-1] + [np.cos(heading), np.sin(heading)])
            heading += turn
            lines.append(f"VERTEX_SE2 {k + 1} A{k + 1} {places[-1][0]} {places[-1][1]} {heading}")
            lines.append(f"EDGE_SE2 {k} A{k} A{k + 1} 1 0 {turn + 0.01 + 0.005 * rng.normal()} 0 0 0 0 0 0")
        lines += [f"VERTEX_XY L{i} {x} {y}" for i, (x, y) in enumerate(beacons)]
        for k, place in enumerate(places):
            wrong = 5 * rng.uniform() if k % 10 == 0 else 0.1 * rng.normal()
            lines.append(f"EDGE_RANGE {k} A{k} L{k % 3} {np.linalg.norm(place - beacons[k % 3]) + wrong} 0.01")
        file = self.folder / "path.pyfg"
        file.write_text("\n".join(lines) + "\n")
        out = self.run_example("path_from_ranges.py", file)
        before = float(re.search(r"dead reckoning: (\S+) m", out)[1])
        self.assertGreater(before, 3, out)
        for known in ("known", "unknown"):
            self.assertLess(float(re.search(f"beacons {known}: error (\\S+) m", out)[1]), 0.2, out)
        self.assertIn("skipped: there is no", self.run_example("path_from_ranges.py", self.folder / "missing.pyfg"))
        for last, message in (
            ("EDGE_RANGE 1 A0 L0 x 1", "expected the numbers of EDGE_RANGE"),
            ("VERTEX_SE2", "expected the numbers of VERTEX_SE2"),
            ("EDGE_RANGE 1 A0 L9 1 1", "a range from A0 to L9, which are not a pose and a beacon"),
        ):
            file.write_text("\n".join([*lines[:3], last]))
            run = subprocess.run([sys.executable, EXAMPLES / "path_from_ranges.py", file], capture_output=True, text=True)
            self.assertEqual((run.returncode, run.stderr), (1, f"{file}:4: {message}\n"))

    @unittest.skipUnless(hasattr(asterism, "Tracker"), "built without trackers")
    def test_cheat_sheet(self):
        page = (PROJECT / "docs/cheat-sheet.md").read_text()
        self.assertIn(f"```text\n{self.run_example('cheat_sheet.py')}```", page)

    def test_solve_and_draw(self):
        self.assertIn("converged", self.run_example("solve_and_draw.py", "--rows", 2, "--out", self.figure))
        self.assert_drawn(300)

    def test_compare_solvers(self):
        out = self.run_example("compare_solvers.py", "--sizes", 4, 6, "--systems", 2, "--out", self.figure)
        rows = {line[:16].strip(): float(line.split()[-1]) for line in out.splitlines()[1:]}
        self.assertEqual(set(rows), {"ida", "newton", "lbfgs", "newton-cg", "ncg", "SciPy L-BFGS-B", "SciPy BFGS", "SciPy CG"})
        self.assertLess(max(value for name, value in rows.items() if "SciPy" not in name), 1e-7)
        self.assert_drawn(300)

    @unittest.skipUnless(hasattr(asterism, "read_systems"), "built without nlohmann-json")
    def test_score_solver(self):
        out = self.run_example("score_solver.py", PROJECT / "bench/problems")
        scores = {words[0]: list(map(int, words[1:])) for words in map(str.split, out.splitlines()[1:])}
        self.assertEqual(set(scores), {file.stem for file in (PROJECT / "bench/problems").glob("*.jsonl")})
        for problems, mine, ida, staircase in scores.values():
            self.assertLessEqual(max(mine, ida, staircase), problems)
        self.assertGreater(sum(score[3] for score in scores.values()), sum(score[2] for score in scores.values()))

    @unittest.skipUnless(hasattr(asterism, "Tracker"), "built without trackers")
    def test_track_video(self):
        for frame in range(12):
            write_png(self.folder / f"{frame:04}.png", draw_frame(frame))
        box = ",".join(map(str, BOX))
        out = self.run_example("track_video.py", self.folder, "--box", box, "--frames", 10, "--out", self.figure)
        self.assertIn("dpt_plus: 9 frames", out)
        self.assert_drawn(1000)

    @unittest.skipUnless(hasattr(asterism, "Tracker"), "built without trackers")
    def test_track_webcam(self):
        """With a module in the place of cv2, whose camera shows the moving square, and which writes down what is drawn."""
        (self.folder / "cv2.py").write_text(f"""
import sys
sys.path.insert(0, {str(pathlib.Path(__file__).parent)!r})
from moving_square import BOX, draw_frame

class VideoCapture:
    def __init__(self, number):
        self.frames = iter(range(6 if number == 0 else 0))
    def read(self):
        return next(((True, draw_frame(frame)) for frame in self.frames), (False, None))

def selectROI(title, image):
    return BOX
def rectangle(image, box, color, thickness):
    print(*box, *color)
def imshow(title, image):
    assert image.shape == (240, 320, 3)
def waitKey(milliseconds):
    return 27 if next(shown) == 4 else -1
shown = iter(range(1, 9))
""")
        environment = dict(os.environ, PYTHONPATH=os.pathsep.join([str(self.folder), os.environ.get("PYTHONPATH", "")]))
        command = [sys.executable, str(EXAMPLES / "track_webcam.py")]
        run = subprocess.run(command, capture_output=True, text=True, env=environment)
        self.assertEqual((run.returncode, run.stderr), (0, ""))
        drawn = np.loadtxt(run.stdout.splitlines())
        self.assertEqual(len(drawn), 4)  # Esc
        np.testing.assert_allclose(drawn[:, :4], [true_box(frame) for frame in range(1, 5)], atol=3)
        np.testing.assert_array_equal(drawn[:, 4:], [[0, 255, 0]] * 4)

    def test_programs_of_pages(self):
        """Each prints what its page shows, if that shows its output; the README's says in a comment what x is."""
        self.assertIn("converged", self.run_example("solve.py"))
        for page, name in [("python.md", "constellation.py"), ("coming-from.md", "coming_from_mds.py")]:
            text = (PROJECT / "docs" / page).read_text()
            shown = re.search(rf"examples/{name} -->\n```python\n.*?^```\n\n```text\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
            self.assertEqual(self.run_example(name), shown[1])

    def test_gradients(self):
        out = self.run_example("gradients.py")
        shares = [float(line.split()[-1]) for line in out.splitlines() if "follows" in line]
        self.assertEqual(len(shares), 4)
        self.assertAlmostEqual(sum(shares), 1, delta=2e-3)  # a translation of all
        self.assertLess(shares[3], min(shares[:3]))

    @unittest.skipUnless(importlib.util.find_spec("torch"), "PyTorch is not installed")
    def test_learn_law(self):
        self.assertEqual(self.run_example("learn_law.py"), "p = 1.5000, q = 0.8000\n")

    def test_gallery(self):
        page = (PROJECT / "docs/gallery.md").read_text()
        scripts = sorted((EXAMPLES / "gallery").glob("*.py"))
        self.assertGreaterEqual(len(scripts), 4)
        for script in scripts:
            with self.subTest(script.name):
                self.run_example(f"gallery/{script.name}", self.figure)
                self.assert_drawn(300)
                self.assertIn(f"```python\n{script.read_text()}```", page)
                picture = f"images/gallery-{script.stem.replace('_', '-')}.png"
                self.assertIn(f"]({picture})", page)
                with Image.open(PROJECT / "docs" / picture) as shown, Image.open(self.figure) as drawn:
                    self.assertEqual(shown.size, drawn.size)

    def test_graphs_of_other_programs(self):
        """The dependency graph from a file such as apt-cache's, and the programs that draw it side by side."""
        available = """Package: a
Depends: b (>= 1.0) | c,
 missing | d:any [amd64], a
Section: games

Package: b
Pre-Depends: c
Section: contrib/games

Package: c
Section: libs

Package: d
Depends: b, b
Section: games
"""
        for arguments, expected in [((), "a b\na d\nb c\nd b\n"), (("--section", "games"), "a b\na d\nd b\n")]:
            command = [sys.executable, str(EXAMPLES / "debian_graph.py"), *arguments]
            run = subprocess.run(command, input=available, capture_output=True, text=True)
            self.assertEqual((run.returncode, run.stderr, run.stdout), (0, "", expected))
        edges = self.folder / "cycle.edges"
        edges.write_text("\n".join(f"n{k} n{(k + 1) % 12}" for k in range(12)) + "\nalone apart 2.5\n")
        script = PROJECT / "bench/laboratory/layouts.py"
        run = subprocess.run([sys.executable, str(script), str(edges)], capture_output=True, text=True)
        self.assertEqual((run.returncode, run.stderr), (0, ""), run.stdout)
        self.assertIn("cycle.edges: 12 nodes, 12 edges", run.stdout)
        relative = {line[:22].strip(): float(line[22:].split()[1]) for line in run.stdout.splitlines() if line.startswith("asterism")}
        self.assertEqual(set(relative), {"asterism", "asterism auto", "asterism partners=50"})
        self.assertLess(relative["asterism"], 1.0001)
        edges.write_text("a b\nc\n")
        run = subprocess.run([sys.executable, str(script), str(edges)], capture_output=True, text=True)
        self.assertEqual((run.returncode, run.stderr), (1, f"layouts.py: {edges}:2: expected NODE NODE [LENGTH]\n"))

    def test_drawings_of_made_graphs(self):
        script = PROJECT / "bench/laboratory/layouts.py"
        command = [sys.executable, str(script), "--made", "300", "--programs", "asterism,asterism auto"]
        run = subprocess.run(command, capture_output=True, text=True)
        self.assertEqual((run.returncode, run.stderr), (0, ""), run.stdout)
        rows = [line.split("|")[1:-1] for line in run.stdout.splitlines() if line.startswith("| ")]
        self.assertEqual(len({row[0] for row in rows}), 10)
        for kind, size, first, other in rows:
            nodes, edges = map(int, size.split(","))
            self.assertTrue(250 <= nodes <= 350 and 1.15 < edges / nodes < 1.45, kind)
            self.assertIn("asterism 1.000 (", first)
            self.assertRegex(other, r"asterism auto [01]\.\d")
        run = subprocess.run([*command, "--kinds", "tree"], capture_output=True, text=True)
        self.assertEqual(run.returncode, 1)
        self.assertIn("no kind of graphs is named tree", run.stderr)

    def test_boxes_of_other_programs(self):
        run = subprocess.run(
            [sys.executable, str(PROJECT / "bench/laboratory/boxes.py"), "--nodes", "60", "--fills", "0.2"],
            capture_output=True,
            text=True,
            check=True,
        )
        rows = [line.split() for line in run.stdout.splitlines()]
        ours = [row for row in rows if row[2] in ("layout", "remove_overlaps")]
        self.assertEqual(len(ours), 8)
        self.assertEqual({row[3] for row in ours}, {"0"})

    def test_help(self):
        for name in ("solve_and_draw.py", "compare_solvers.py", "track_video.py"):
            if name == "track_video.py" and not hasattr(asterism, "Tracker"):
                continue
            self.assertIn("--out", self.run_example(name, "--help"))


if __name__ == "__main__":
    unittest.main()
