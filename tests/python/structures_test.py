#!/usr/bin/env python3
"""asterism.pictorial_structure on NumPy maps, against all placements."""

import itertools
import unittest

import asterism
import numpy as np
from asterism import Joint, pictorial_structure


def cost(joint, d):
    excess = np.abs(np.subtract(d, joint.offset))
    grown = np.multiply(joint.weight, excess**2 if joint.shape == "quadratic" else excess)
    return np.minimum(grown, joint.truncation).sum()


class StructuresTest(unittest.TestCase):
    def test_the_best_of_all_placements(self):
        rng = np.random.default_rng(1)
        for trial in range(10):
            maps = [rng.uniform(-1, 1, (3, 4)).astype(np.float32), rng.uniform(-1, 1, (4, 2)), rng.uniform(-1, 1, (5, 3)).T]
            joints = [
                Joint(2, 0, rng.uniform(-2, 2, 2), weight=0.3),
                Joint(1, 2, (1, -1), weight=(0.2, 0.5), shape="absolute", truncation=(np.inf, 1.0)),
            ]
            of_root = np.full(maps[1].shape, np.inf)
            for places in itertools.product(*(np.ndindex(m.shape) for m in maps)):
                energy = sum(m[p] for m, p in zip(maps, places))
                energy += sum(cost(j, np.subtract(places[j.child], places[j.parent])[::-1]) for j in joints)
                of_root[places[1]] = min(of_root[places[1]], energy)
            found = pictorial_structure(maps, joints, count=3, distance=1)
            self.assertEqual(found.root, 1)
            self.assertAlmostEqual(found.energy, of_root.min(), places=5)
            np.testing.assert_allclose(found.min_marginals, of_root, atol=1e-5)
            self.assertEqual(found.positions.shape, (3, 2))
            x, y = found.positions[1]
            self.assertAlmostEqual(of_root[y, x], found.energy, places=5)
            self.assertEqual(len(found.placements), 3)
            self.assertEqual(found.placements[0][0], found.energy)
            self.assertLessEqual(found.placements[0][0], found.placements[1][0])

    def test_maps_in_place_and_copied(self):
        rng = np.random.default_rng(2)
        image = rng.uniform(0, 1, (40, 60)).astype(np.float32)
        joints = [Joint(0, 1, (3, 2), weight=0.1)]
        wanted = pictorial_structure([image[::2, 5:25].copy(), image.T.copy()], joints)
        found = pictorial_structure([image[::2, 5:25], image.T], joints)
        self.assertEqual(found.energy, wanted.energy)
        np.testing.assert_array_equal(found.positions, wanted.positions)
        self.assertEqual(pictorial_structure([[[3, 1, 2]]], []).positions.tolist(), [[1, 0]])

    def test_errors_name_what_is_wrong(self):
        good = np.zeros((3, 3), np.float32)
        bad = good.copy()
        bad[1, 1] = np.nan
        for maps, joints, options, message in [
            ([], [], {}, "maps are none"),
            ([good, bad], [Joint(0, 1)], {}, "map 1 has a number that is NaN"),
            ([good, good], [], {}, "joints are not one fewer than maps"),
            ([good, good], [Joint(0, 2)], {}, "joint 0 has an end that is out of range"),
            ([good, good], [Joint(0, 1, weight=-1)], {}, "joint 0 has a weight that is negative"),
            ([good, good], [Joint(0, 1, shape="cubic")], {}, "joint 0: expected the shape"),
            ([good, good], [Joint(0, 1, offset=(1, 2, 3))], {}, "joint 0: expected offset"),
            ([good, good[0]], [Joint(0, 1)], {}, r"map 1: expected two dimensions, found shape \(3,\)"),
            ([good], [], {"count": 0}, "expected a count"),
        ]:
            with self.assertRaisesRegex(ValueError, message):
                pictorial_structure(maps, joints, **options)
        with self.assertRaisesRegex(TypeError, "map 0: expected numbers, found str"):
            pictorial_structure(["map"], [])
        self.assertIn("pictorial_structure", asterism.__all__)


if __name__ == "__main__":
    unittest.main()
