#!/usr/bin/env python3
"""asterism.pictorial_structure and its kin on NumPy maps, against all placements."""

import itertools
import unittest

import asterism
import numpy as np
from asterism import Joint, Status, loopy_structure, m_best_placements, pictorial_structure, scaled_structure


def cost(joint, d):
    if joint.length is not None:
        is_inside = np.abs(np.subtract(d, joint.offset)).max() <= joint.reach
        return joint.weight * (np.hypot(*d) - joint.length) ** 2 if is_inside else np.inf
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

    def all_placements(self, maps, joints):
        """The energies and the positions (x, y), the least energy first."""
        all = []
        for places in itertools.product(*(np.ndindex(m.shape) for m in maps)):
            energy = sum(m[p] for m, p in zip(maps, places))
            energy += sum(cost(j, np.subtract(places[j.child], places[j.parent])[::-1]) for j in joints)
            if np.isfinite(energy):
                all.append((energy, np.array(places)[:, ::-1]))
        return sorted(all, key=lambda one: one[0])

    def test_the_best_placements_in_order(self):
        rng = np.random.default_rng(3)
        maps = [rng.uniform(-1, 1, (3, 4)), rng.uniform(-1, 1, (4, 3)), rng.uniform(-1, 1, (3, 3))]
        joints = [Joint(0, 1, (1, 0), weight=0.3), Joint(0, 2, (-1, 1), weight=0.5, length=1.5, reach=2)]
        for distance in [0, 1.5]:
            left = self.all_placements(maps, joints)
            found = m_best_placements(maps, joints, count=6, distance=distance)
            self.assertEqual(len(found), 6)
            for energy, positions in found:
                self.assertAlmostEqual(energy, left[0][0], places=5)
                left = [one for one in left if np.linalg.norm(one[1] - positions, axis=1).max() > distance]

    def test_a_window_counts_whatever_the_weight_is(self):
        """Without the window, the child would go to the place of least cost, 3 px away."""
        maps = [np.zeros((1, 1)), np.array([[5.0, 4.0, 3.0, 0.0]])]
        for weight, reach, least, x in [(0, 0, 5, 0), (0, 2, 3, 2), (1e-300, 2, 3, 2), (0, 3, 0, 3), (0.25, 2, 3.25, 2), (0.25, 3, 1, 3)]:
            joints = [Joint(0, 1, weight=weight, length=1.0, reach=reach)]
            with self.subTest(weight=weight, reach=reach):
                for energy, positions in [
                    (lambda r: (r.energy, r.positions))(pictorial_structure(maps, joints)),
                    m_best_placements(maps, joints, count=1)[0],
                    (lambda r: (r.energy, r.positions))(loopy_structure(maps, joints)),
                    (lambda r: (r.energy, r.positions))(scaled_structure([m[None] for m in maps], joints, [1.0])),
                ]:
                    self.assertAlmostEqual(energy, least, places=6)
                    self.assertEqual(positions[1].tolist(), [x, 0])
        # In a larger scale, a window of 2 px reaches to 3 px; one of 255 px is refused, as it could not grow.
        found = scaled_structure([m[None] for m in maps], [Joint(0, 1, weight=0, length=1.0, reach=2)], [1.5])
        self.assertEqual(found.positions[1].tolist(), [3, 0])
        with self.assertRaisesRegex(ValueError, "joint 0 has a cost that is out of range at one of the scales"):
            scaled_structure([m[None] for m in maps], [Joint(0, 1, weight=0, length=1.0, reach=255)], [1.5])
        with self.assertRaisesRegex(ValueError, "joint 0 has a reach below 0 or above 255 px"):
            pictorial_structure(maps, [Joint(0, 1, weight=0, length=1.0, reach=-1)])

    def test_numbers_at_the_ends_of_float(self):
        """3e38 may stand for a place that is forbidden, but not for the energy of all placements."""
        large, mixed = np.full((2, 2), 3e38, np.float32), np.array([[3e38, 2.0]], np.float32)
        away = Joint(0, 1, (1e6, 0), weight=1e38)
        solvers = {
            "pictorial_structure": pictorial_structure,
            "m_best_placements": lambda maps, joints: m_best_placements(maps, joints, count=2),
            "loopy_structure": loopy_structure,
            "scaled_structure": lambda maps, joints: scaled_structure([m[None] for m in maps], joints, [1.0]),
        }
        for name, solver in solvers.items():
            for maps, joints, message in [
                ([large, large], [Joint(0, 1, weight=0)], "maps leave no placement with an energy in the range of float"),
                ([mixed * 0, mixed * 0], [away], "maps leave no placement with an energy in the range of float"),
                ([-large, -large], [Joint(0, 1, weight=0)], "maps have negative numbers whose sum is below the range of float"),
            ]:
                with self.subTest(name):
                    if name == "loopy_structure" and maps[0] is large:  # whose messages are differences
                        self.assertEqual(solver(maps, joints).energy, 2 * float(large[0, 0]))
                        continue
                    with self.assertRaisesRegex(ValueError, message):
                        solver(maps, joints)
            found = solver([mixed, mixed], [Joint(0, 1, weight=0)])
            energy = found[0][0] if isinstance(found, list) else found.energy
            self.assertEqual(energy, 4)

    def test_cycles_are_bounded(self):
        rng = np.random.default_rng(4)
        for trial in range(5):
            maps = [rng.uniform(-1, 1, (3, 4)) for _ in range(3)]
            joints = [Joint(0, 1, weight=0.3), Joint(1, 2, (1, 1), weight=0.4), Joint(2, 0, weight=0.4, length=2.0, reach=3)]
            found = loopy_structure(maps, joints, tolerance=1e-4)
            least = self.all_placements(maps, joints)[0][0]
            self.assertIn(found.status, [Status.CONVERGED, Status.NO_PROGRESS, Status.MAX_ITERATIONS])
            self.assertLessEqual(found.lower_bound, least + 1e-5)
            self.assertGreaterEqual(found.energy, least - 1e-5)
            self.assertGreaterEqual(found.iterations, 1)
            energy = sum(m[y, x] for m, (x, y) in zip(maps, found.positions))
            energy += sum(cost(j, found.positions[j.child] - found.positions[j.parent]) for j in joints)
            self.assertAlmostEqual(found.energy, energy, places=5)
        with self.assertRaisesRegex(ValueError, "option tolerance is negative"):
            loopy_structure(maps, joints, tolerance=-1)

    def test_layers_of_scale(self):
        rng = np.random.default_rng(5)
        scales = [1.0, 1.5]
        maps = [rng.uniform(-1, 1, (2, 4, 4)).astype(np.float32), rng.uniform(-1, 1, (2, 3, 5))]
        joint = Joint(0, 1, (1, 0.5), weight=0.4, layer_weight=0.2)
        least = np.full(maps[0].shape, np.inf)
        for root, child in itertools.product(np.ndindex(maps[0].shape), np.ndindex(maps[1].shape)):
            d = np.subtract(child[1:], root[1:])[::-1] / scales[root[0]]
            energy = maps[0][root] + maps[1][child] + cost(joint, d) + 0.2 * (child[0] - root[0]) ** 2
            least[root] = min(least[root], energy)
        found = scaled_structure(maps, [joint], scales, count=3, distance=1)
        self.assertAlmostEqual(found.energy, least.min(), places=5)
        np.testing.assert_allclose(found.min_marginals, least, atol=1e-5)
        self.assertEqual(found.root, 0)
        x, y = found.positions[0]
        self.assertAlmostEqual(least[found.layers[0], y, x], found.energy, places=5)
        self.assertEqual(len(found.placements), 3)
        self.assertEqual(found.placements[0][0], found.energy)
        for wrong in [maps[0][0], maps[0][:1]]:
            with self.assertRaisesRegex(ValueError, r"maps of part 1: expected the shape \(2, height, width\)"):
                scaled_structure([maps[0], wrong], [joint], scales)

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
            ([good, good], [Joint(0, 1, shape="cubic")], {}, "joint 0: shape: expected 'quadratic' or 'absolute', found 'cubic'"),
            ([good, good], [Joint(0, 1, offset=(1, 2, 3))], {}, "joint 0: expected offset"),
            ([good, good], [Joint(0, 1, length=2, weight=(1, 2))], {}, "joint 0: expected offset, weight, length and reach"),
            ([good, good], [Joint(0, 1, length=2, truncation=1)], {}, "joint 0: a cost of a length is quadratic"),
            ([good, good], [Joint(0, 1, length=-2)], {}, "joint 0 has a length that is negative"),
            ([good, good], [Joint(0, 1, length=2, reach=300)], {}, "joint 0 has a reach below 0 or above 255 px"),
            ([good, good[0]], [Joint(0, 1)], {}, r"map 1: expected two dimensions, found shape \(3,\)"),
            ([good, good], [Joint(-1, 1)], {}, "joint 0: parent: expected >= 0, found -1"),
            ([good], [], {"count": 0}, "count: expected >= 1, found 0"),
            ([good], [], {"distance": np.nan}, "distance: expected >= 0, found nan"),
        ]:
            with self.assertRaisesRegex(ValueError, message):
                pictorial_structure(maps, joints, **options)
        for arguments, message in (((3, []), "maps: expected a list of arrays, found int"), (([np.zeros((2, 2))], 3), "joints: expected a list of Joints, found int")):
            with self.subTest(message), self.assertRaisesRegex(TypeError, message):
                pictorial_structure(*arguments)
        with self.assertRaisesRegex(TypeError, "map 0: expected numbers, found <U3"):
            pictorial_structure(["map"], [])
        two, joint = [good, good], [Joint(0, 1)]
        for call, message in [
            (lambda: pictorial_structure(two, [(0, 1)]), r"joint 0: expected a Joint, found \(0, 1\)"),
            (lambda: pictorial_structure(two, [Joint(0, 1.0)]), "joint 0: child: expected an integer, found 1.0"),
            (lambda: pictorial_structure(two, joint, count=2.0), "^count: expected an integer, found 2.0"),
            (lambda: asterism.m_best_placements(two, joint, count=2, distance="2"), "^distance: expected numbers"),
            (lambda: asterism.loopy_structure(two, joint, max_iterations=9.5), "^max_iterations: expected an integer, found 9.5"),
            (lambda: asterism.loopy_structure(two, joint, progress=None), "^progress: expected numbers"),
        ]:
            with self.assertRaisesRegex(TypeError, message):
                call()
        with self.assertRaisesRegex(ValueError, r"scales: expected shape \(layers,\), found \(\)"):
            asterism.scaled_structure([good[None]], [], 1.0)
        self.assertIn("pictorial_structure", asterism.__all__)


if __name__ == "__main__":
    unittest.main()
