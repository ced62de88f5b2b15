"""Tests that charts are well-formed and that what they show is where their axes say.

Usage: plots_test.py SAMPLE, the program built from plots_sample.cpp. Needs the standard library only.
"""

import re
import subprocess
import sys
import unittest
import xml.etree.ElementTree as ElementTree

SVG = "{http://www.w3.org/2000/svg}"


def classes(element):
    return element.get("class", "").split()


def tooltip(element):
    return element.findtext(SVG + "title")


def left(text):
    share = 1 if "end" in classes(text) else 0.5 if "middle" in classes(text) else 0
    return float(text.get("x")) - share * len(text.text) * 6.5


def place(element):
    return tuple(map(float, re.fullmatch(r"translate\((.*),(.*)\)", element.get("transform")).groups()))


class Chart:
    """A chart and its axes as a reader sees them: numbers beside ticks."""

    def __init__(self, svg):
        self.svg = svg
        self.x = self.axis("middle", "x", 0)
        self.y = self.axis("end", "y", -4)  # the text's middle is above its base

    def all(self, name):
        return [element for element in self.svg.iter() if name in classes(element)]

    def axis(self, name, attribute, shift):
        ticks = [t for t in self.all("tick") if name in classes(t)]
        values = [float(t.text) for t in ticks]
        pixels = [float(t.get(attribute)) + shift for t in ticks]
        if len(ticks) < 2:
            return None
        slope = (pixels[-1] - pixels[0]) / (values[-1] - values[0])
        for value, pixel in zip(values, pixels):
            assert abs(pixels[0] + slope * (value - values[0]) - pixel) < 0.2, "ticks in proportion"
        return lambda value: pixels[0] + slope * (value - values[0])


class Charts(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        page = subprocess.run([SAMPLE], capture_output=True, check=True).stdout
        svgs = list(ElementTree.fromstring(page).iter(SVG + "svg"))  # throws if it is not well-formed
        cls.lines, cls.scatter, cls.bars, cls.differences, cls.timeline, cls.empty = map(Chart, svgs)
        cls.style = page.decode().split("<style>")[1].split("</style>")[0]

    def test_text_is_what_it_was(self):
        names = [t.text for t in self.scatter.all("name")]
        self.assertIn('a <b> & "c"  d', names)
        self.assertEqual(self.lines.svg.get("aria-label"), "Expected average overlap")

    def test_points_are_where_the_axes_say(self):
        markers = [m for m in self.scatter.all("marker") if tooltip(m)]
        self.assertEqual(len(markers), 11)
        for marker in markers:
            x, y = map(float, tooltip(marker).rsplit(": ", 1)[1].split(", "))
            at = place(marker)
            self.assertAlmostEqual(at[0], self.scatter.x(x), delta=0.5)
            self.assertAlmostEqual(at[1], self.scatter.y(y), delta=0.5)

    def labels(self):
        """The names beside points: those of the legend are in the last column."""
        names = self.scatter.all("name")
        legend = max(float(t.get("x")) for t in names)
        return [t for t in names if float(t.get("x")) < legend] or self.fail("labels")

    def test_labels_of_points_meet_no_other_label(self):
        boxes = [(left(t), float(t.get("y")), len(t.text) * 6.5) for t in self.labels()]
        for i, (x, y, width) in enumerate(boxes):
            for other_x, other_y, other_width in boxes[:i]:
                apart = x > other_x + other_width or other_x > x + width or abs(y - other_y) > 10
                self.assertTrue(apart)

    def test_labels_of_points_are_apart_from_other_markers(self):
        markers = {tooltip(m).rsplit(": ", 1)[0]: place(m) for m in self.scatter.all("marker") if tooltip(m)}
        for label in self.labels():
            begin, base = left(label), float(label.get("y"))
            for name, (x, y) in markers.items():
                beside = x < begin - 14 or x > begin + len(label.text) * 6.5 + 14 or abs(y - base) > 14
                self.assertTrue(beside or name == label.text, (name, label.text))

    def test_lines_go_through_their_tooltips(self):
        paths = {tooltip(p): p.get("d") for p in self.lines.all("line") if p.tag == SVG + "path"}
        self.assertEqual(len(paths), 11)
        for spot in self.lines.all("spot"):
            name, values = tooltip(spot).rsplit(": ", 1)
            y, x = map(float, values.split(" at "))
            self.assertAlmostEqual(float(spot.get("cx")), self.lines.x(x), delta=0.3)
            self.assertAlmostEqual(float(spot.get("cy")), self.lines.y(y), delta=0.3)
            self.assertRegex(paths[name], rf"[ML]{spot.get('cx')},{spot.get('cy')}(\D|$)")

    def test_line_labels_stand_apart(self):
        heights = sorted(float(t.get("y")) for t in self.lines.all("name"))
        self.assertEqual(len(heights), 11)
        self.assertTrue(all(b - a >= 14.9 for a, b in zip(heights, heights[1:])))

    def test_shade_covers_its_interval(self):
        (shade,) = self.lines.all("shade")
        left = float(shade.get("x"))
        self.assertAlmostEqual(left, self.lines.x(166), delta=0.2)
        self.assertAlmostEqual(left + float(shade.get("width")), self.lines.x(377), delta=0.2)

    def test_bars_end_at_their_values(self):
        for chart, number in ((self.bars, 11), (self.differences, 2)):
            bars = chart.all("bar")
            self.assertEqual(len(bars), number)
            for bar in bars:
                value = float(re.match(r".*: (\S+)", tooltip(bar)).group(1))
                left, width = float(bar.get("x")), float(bar.get("width"))
                self.assertAlmostEqual(left, chart.x(min(0, value)), delta=0.2)
                self.assertAlmostEqual(left + width, chart.x(max(0, value)), delta=0.2)

    def test_intervals_have_their_ends(self):
        low, high = map(float, re.search(r"\((\S+) to (\S+)\)", tooltip(self.bars.all("bar")[0])).groups())
        whisker = self.bars.all("whisker")[0]
        self.assertAlmostEqual(float(whisker.get("x1")), self.bars.x(low), delta=0.2)
        self.assertAlmostEqual(float(whisker.get("x2")), self.bars.x(high), delta=0.2)

    def test_failures_are_in_their_frames(self):
        failures = self.timeline.all("failure")
        self.assertEqual(len(failures), 6)
        for failure in failures:
            frame = int(tooltip(failure).rsplit(" ", 1)[1])
            left = float(re.match(r"M(.*?),", failure.get("d")).group(1))
            self.assertAlmostEqual(left + 4, self.timeline.x(frame), delta=0.2)

    def test_strips_are_as_long_as_their_sequence(self):
        strips = zip(self.timeline.all("strip"), self.timeline.all("overlap"), (207, 207, 207, 1000))
        for strip, overlap, frames in strips:
            right = float(strip.get("x")) + float(strip.get("width"))
            self.assertAlmostEqual(right, self.timeline.x(frames + 0.5), delta=0.3)
            steps = re.findall(r"H([\d.]+)", overlap.get("d"))
            self.assertAlmostEqual(float(steps[-1]), right, delta=0.2)
            self.assertEqual(len(steps), min(frames, 320))

    def test_every_class_has_a_style_in_both_schemes(self):
        light, dark = re.findall(r"--c0: .*?}", self.style, re.S)
        for i in range(8):
            self.assertIn(f".plot .c{i}", self.style)
            colors = [re.search(rf"--c{i}: (\S+);", scheme).group(1) for scheme in (light, dark)]
            self.assertNotEqual(*colors)
        page_classes = {c for chart in (self.lines, self.scatter, self.bars, self.timeline)
                        for element in chart.svg.iter() for c in classes(element)}
        for name in page_classes - {"plot", "name", "d0"}:
            self.assertRegex(self.style, rf"\.{name}\b")


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    SAMPLE = sys.argv.pop(1)
    unittest.main()
