"""The smallest systems with several minima, as bench/laboratory/smallest.py checks them: smallest_test.py PROJECT."""

import dataclasses
import json
import pathlib
import sys
import unittest

import asterism
import numpy as np

PROJECT = pathlib.Path(sys.argv.pop(1))
sys.path.insert(0, str(PROJECT / "bench/laboratory"))

import smallest  # noqa: E402


class Smallest(unittest.TestCase):
    def test_every_entry_has_the_minima_that_it_states(self):
        page = (PROJECT / "docs/smallest-systems.md").read_text()
        names = []
        for stored, record in smallest.stored_systems(smallest.FILE):
            with self.subTest(stored.name):
                found = smallest.check(stored, record)
                self.assertIn(found.row() + "\n", page)
                names.append(stored.name)
        self.assertEqual(names, [kind.name for kind in smallest.KINDS])

    def test_what_does_not_hold_is_found(self):
        stored, record = next(iter(smallest.stored_systems(smallest.FILE)))

        def with_origin(**changes):
            return dataclasses.replace(stored, origin={**stored.origin, **changes})

        first, second = stored.origin["minima"][:2]
        moved = {**second, "x": (np.array(second["x"]) + 1e-3).tolist()}
        for wrong, what in [
            (with_origin(minima=[first]), "one minimum"),
            (with_origin(minima=[first, first]), "are the same"),
            (with_origin(minima=[second, first]), "not the lowest"),
            (with_origin(minima=[first, moved]), "leads elsewhere"),
            (with_origin(minima=[first, {**second, "energy": second["energy"] * 1.01}]), "energy differs"),
            (with_origin(proof="boxes"), "not proven"),
        ]:
            with self.assertRaisesRegex(ValueError, what):
                smallest.check(wrong, record)

    def test_no_proof_where_there_is_less(self):
        """From the higher minimum, neither boxes nor a certificate may prove anything."""
        for stored, record in smallest.stored_systems(smallest.FILE):
            origin = stored.origin["minima"]
            highest = smallest.Minimum(np.array(origin[-1]["x"]), origin[-1]["energy"], np.array(origin[-1]["start"]))
            if highest.energy < 1.01 * origin[0]["energy"] + 1e-9:
                continue
            with self.subTest(stored.name):
                problem = smallest.point_problem(record) if isinstance(stored.system, asterism.System) else None
                if problem:  # boxes would be halved for ever about the lower minimum, where the bound is not reached
                    self.assertLess(problem.least(problem.point(np.array(origin[0]["x"]))[None], 0)[0], highest.energy)
                    self.assertEqual(problem.prove(highest.energy), -np.inf)
                else:
                    _, bound = smallest.lower_bound(stored.system, highest, record)
                    self.assertLessEqual(bound, origin[0]["energy"] * (1 + 1e-9) + 1e-12)

    def test_boxes_bound_the_energy_from_below(self):
        rng = np.random.default_rng(3)
        for stored, record in smallest.stored_systems(smallest.FILE):
            problem = smallest.point_problem(record) if isinstance(stored.system, asterism.System) else None
            if problem is None:
                continue
            centres = rng.uniform(-2, 6, (50, problem.dim))
            for radius in (0.01, 0.5, 3):
                inside = centres + rng.uniform(-1, 1, centres.shape) * radius / np.sqrt(problem.dim)
                self.assertTrue((problem.least(centres, radius) <= problem.least(inside, 0) + 1e-12).all(), stored.name)

    def test_smaller_systems_and_convex_kinds_have_one_minimum(self):
        self.assertEqual(smallest.search(20), 0)
        springs = next(kind for kind in smallest.KINDS if kind.name == "springs")
        self.assertEqual(len(smallest.minima_of(*springs.make(), 20)), 2)  # which the same search finds in the system of the table

    def test_version_of_the_file(self):
        lines = smallest.FILE.read_text().splitlines()
        self.assertEqual({json.loads(line)["asterism_system"] for line in lines}, {1, 2})


if __name__ == "__main__":
    unittest.main()
