"""bench/microbench/compare_benchmarks.py: its test against enumeration, and its verdicts and complaints from outside."""

import importlib.util
import itertools
import json
import pathlib
import random
import subprocess
import sys
import tempfile
import unittest

SCRIPT = pathlib.Path(__file__).parents[2] / "bench" / "microbench" / "compare_benchmarks.py"
specification = importlib.util.spec_from_file_location("compare_benchmarks", SCRIPT)
compare_benchmarks = importlib.util.module_from_spec(specification)
sys.dont_write_bytecode = True
specification.loader.exec_module(compare_benchmarks)


def enumerated_p(a, b):
    """mann_whitney by all divisions of the values into two such samples."""
    values = a + b

    def distance(mine):
        theirs = [i for i in range(len(values)) if i not in mine]
        u = sum((values[i] > values[j]) + 0.5 * (values[i] == values[j]) for i in mine for j in theirs)
        return abs(u - len(a) * len(b) / 2)

    seen = distance(set(range(len(a))))
    divisions = [set(mine) for mine in itertools.combinations(range(len(values)), len(a))]
    return sum(distance(mine) >= seen for mine in divisions) / len(divisions)


class MannWhitney(unittest.TestCase):
    def test_is_exact_without_ties(self):
        rng = random.Random(1)
        for m, n in ((4, 4), (5, 3), (4, 7), (6, 6)):
            a = [rng.uniform(0, 1) for _ in range(m)]
            b = [rng.uniform(0.3, 1.3) for _ in range(n)]
            self.assertAlmostEqual(compare_benchmarks.mann_whitney(a, b), enumerated_p(a, b), places=12)

    def test_is_close_with_ties(self):
        rng = random.Random(2)
        for _ in range(5):
            a = [rng.randint(0, 9) for _ in range(7)]
            b = [rng.randint(4, 13) for _ in range(7)]
            self.assertAlmostEqual(compare_benchmarks.mann_whitney(a, b), enumerated_p(a, b), delta=0.02)

    def test_equal_values_do_not_differ(self):
        self.assertEqual(compare_benchmarks.mann_whitney([1] * 5, [1] * 5), 1)

    def test_symmetric(self):
        a, b = [1, 2, 3, 7], [4, 5, 6, 8, 9]
        self.assertEqual(compare_benchmarks.mann_whitney(a, b), compare_benchmarks.mann_whitney(b, a))


class Significant(unittest.TestCase):
    def test_benjamini_hochberg(self):
        # The example in their paper (1995, section 3.2): the first four of these 15 are significant at 0.05.
        p = [1e-4, 4e-4, 0.0019, 0.0095, 0.0201, 0.0278, 0.0298, 0.0344]
        p += [0.0459, 0.3240, 0.4262, 0.5719, 0.6528, 0.7590, 1.0]
        self.assertEqual(compare_benchmarks.significant(p, 0.05), [True] * 4 + [False] * 11)


class Interval(unittest.TestCase):
    def test_holds_the_ratio(self):
        rng = random.Random(3)
        old = [rng.gauss(100, 2) for _ in range(20)]
        new = [rng.gauss(120, 2) for _ in range(20)]
        low, high = compare_benchmarks.ratio_interval(old, new, 0.95)
        self.assertTrue(1.17 < low < 1.2 < high < 1.23, (low, high))


class Script(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.addCleanup(self.folder.cleanup)

    def write(self, name, benchmarks, unit="ns"):
        """A result as Google Benchmark writes it, with the aggregates of each benchmark behind its runs."""
        runs = []
        for benchmark, times in benchmarks.items():
            common = {"name": benchmark, "run_name": benchmark, "time_unit": unit}
            for time in times:
                runs.append({**common, "run_type": "iteration", "cpu_time": time, "instructions": 8 * time})
            runs.append({**common, "run_type": "aggregate", "aggregate_name": "mean", "cpu_time": 1e6})
        return self.write_text(name, json.dumps({"context": {}, "benchmarks": runs}))

    def write_text(self, name, text):
        path = pathlib.Path(self.folder.name) / name
        path.write_text(text, encoding="utf-8")
        return str(path)

    def run_script(self, *arguments):
        return subprocess.run(
            [sys.executable, str(SCRIPT), *arguments], capture_output=True, text=True, check=False
        )

    def compare(self, *arguments):
        """The lines of a comparison that works."""
        result = self.run_script(*arguments)
        self.assertEqual((result.returncode, result.stderr), (0, ""))
        return result.stdout.splitlines()

    def expect_complaint(self, text, *arguments):
        result = self.run_script(*arguments)
        self.assertEqual((result.returncode, result.stdout), (1, ""))
        self.assertEqual(result.stderr.count("\n"), 1, result.stderr)
        self.assertIn(text, result.stderr)

    TIMES = [10.0, 10.3, 9.8, 10.1, 10.2, 9.9, 10.05, 9.95]

    def test_the_same_does_not_differ(self):
        path = self.write("a.json", {"energy/4": self.TIMES, "gradient/4": self.TIMES})
        lines = self.compare(path, path)
        self.assertEqual(lines[-1], "0 of 2 differ significantly")
        self.assertEqual(lines[2].split()[:4], ["energy/4", "10.03", "10.03", "1.000"])

    def test_a_shift_is_found(self):
        old = self.write("old.json", {"energy/4": self.TIMES, "gradient/4": self.TIMES})
        new = self.write("new.json", {"energy/4": [1.1 * t for t in self.TIMES], "gradient/4": self.TIMES})
        lines = self.compare(old, new)
        self.assertEqual(lines[-1], "1 of 2 differ significantly")
        self.assertTrue(lines[2].endswith("higher"))
        self.assertIn("1.100", lines[2])
        self.assertTrue(self.compare(new, old)[2].endswith("lower"))
        self.assertEqual(self.compare("--alpha", "1e-9", old, new)[-1], "0 of 2 differ significantly")
        self.assertEqual(self.compare("--least", "0.11", old, new)[-1], "0 of 2 differ significantly")

    def test_units_and_counters(self):
        old = self.write("old.json", {"energy/4": self.TIMES})
        new = self.write("new.json", {"energy/4": [t / 1000 for t in self.TIMES]}, unit="us")
        self.assertIn("1.000", self.compare(old, new)[2])
        lines = self.compare("--metric", "instructions", old, old)
        self.assertEqual(lines[2].split()[1], "80.2")

    def test_sorted_by_name_and_size(self):
        path = self.write("a.json", {name: self.TIMES for name in ("ida/16", "energy/64", "ida/4")})
        lines = self.compare(path, path)[2:5]
        self.assertEqual([line.split()[0] for line in lines], ["energy/64", "ida/4", "ida/16"])

    def test_names_what_only_one_has(self):
        old = self.write("old.json", {"energy/4": self.TIMES, "gone": self.TIMES})
        new = self.write("new.json", {"energy/4": self.TIMES, "few": self.TIMES[:2]})
        self.assertEqual(self.compare(old, new)[-1], f"in {old} alone: gone")

    def test_bad_input_is_one_line(self):
        good = self.write("good.json", {"energy/4": self.TIMES})
        self.expect_complaint("No such file", good, "missing.json")
        self.expect_complaint("not the JSON", good, self.write_text("text.json", "no JSON"))
        self.expect_complaint("not the JSON", self.write_text("list.json", "[1]"), good)
        self.expect_complaint("not the JSON", self.write_text("other.json", '{"benchmarks": [1]}'), good)
        single = self.write("single.json", {"energy/4": [10.0]})
        self.expect_complaint("--benchmark_repetitions", good, single)
        self.expect_complaint("in common", good, self.write("other.json", {"gradient/4": self.TIMES}))
        self.expect_complaint("no benchmark has cycles", "--metric", "cycles", good, good)
        self.expect_complaint("--alpha", "--alpha", "5", good, good)
        self.expect_complaint("not positive", good, self.write("zero.json", {"energy/4": [0.0] * 4}))


if __name__ == "__main__":
    unittest.main()
