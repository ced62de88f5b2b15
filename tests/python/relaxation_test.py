"""The certificate and the staircase against CSDP: the semidefinite relaxation of a spring system, solved by another's interior-point method.

E is linear in the Gram matrix G of the points but for the lengths r = sqrt(d), d = G_ii + G_jj - 2 G_ij. The relaxation is
    min  sum k_i/2 (G_ii - 2 a_i . x_i + |a_i|^2) + sum k_ij/2 (d - 2 mu t + mu^2)
    with [[I, X], [X^T, G]] and every [[d, t], [t, 1]] positive semi-definite,
and a placement is its minimum just where the stress matrix W is positive semi-definite.
"""

import os
import shutil
import subprocess
import tempfile
import unittest

import asterism
import numpy as np


def random_system(nodes, dim, rng, contradiction):
    """Springs of the lengths of a random shape, times up to 1 +- contradiction."""
    topology = asterism.Topology.full(nodes)
    system = asterism.SpringSystem(topology, dim=dim)
    shape = rng.uniform(0, 1, (nodes, dim))
    lengths = np.linalg.norm(shape[topology.links[:, 0]] - shape[topology.links[:, 1]], axis=1)
    system.anchors = rng.uniform(0, 1, (nodes, dim))
    system.anchor_stiffness = rng.uniform(0.1, 1, nodes)
    system.rest_length = lengths * rng.uniform(1 - contradiction, 1 + contradiction, lengths.size)
    system.link_stiffness = rng.uniform(0.5, 2, lengths.size)
    return system


def relaxation(system, folder):
    """The least value of the relaxation, by CSDP. Its form is max tr(C X) with tr(A_c X) = b_c: entries (c, block, row, column),
    those off the diagonal counting twice; c = 0 is C."""
    dim, nodes, links = system.dim, system.nodes, system.topology.links
    entries, right = [], []
    for row in range(dim):
        for column in range(row, dim):
            right.append(float(row == column))
            entries.append((len(right), 1, row + 1, column + 1, 1 if row == column else 0.5))
    for i in range(nodes):
        k = system.anchor_stiffness[i]
        entries.append((0, 1, dim + i + 1, dim + i + 1, -k / 2))
        entries += [(0, 1, d + 1, dim + i + 1, k * system.anchors[i, d] / 2) for d in range(dim)]
    for number, (i, j) in enumerate(links):
        i, j = sorted((dim + i + 1, dim + j + 1))
        k, mu, block = system.link_stiffness[number], system.rest_length[number], number + 2
        entries += [(0, block, 1, 1, -k / 2), (0, block, 1, 2, k * mu / 2)]
        right.append(1)
        entries.append((len(right), block, 2, 2, 1))
        right.append(0)
        entries += [(len(right), block, 1, 1, 1), (len(right), 1, i, i, -1), (len(right), 1, j, j, -1), (len(right), 1, i, j, 1)]
    path = os.path.join(folder, "relaxation.dat-s")
    with open(path, "w", encoding="ascii") as file:
        sizes = " ".join(map(str, [dim + nodes] + [2] * len(links)))
        file.write(f"{len(right)}\n{len(links) + 1}\n{sizes}\n{' '.join(map(repr, map(float, right)))}\n")
        file.writelines(f"{c} {block} {row} {column} {float(value)!r}\n" for c, block, row, column, value in sorted(entries))
    result = subprocess.run(["csdp", path], capture_output=True, text=True, check=False, timeout=60)
    value = [line.split(":")[1] for line in result.stdout.splitlines() if line.startswith("Primal objective value")]
    assert result.returncode == 0 and value, result.stdout + result.stderr
    constant = 0.5 * np.sum(system.anchor_stiffness * np.sum(system.anchors**2, axis=1))
    return constant + 0.5 * np.sum(system.link_stiffness * system.rest_length**2) - float(value[0])


@unittest.skipIf(shutil.which("csdp") is None, "needs csdp (Debian package coinor-csdp)")
class RelaxationTest(unittest.TestCase):
    def test_verdicts_and_bounds(self):
        rng = np.random.default_rng(7)
        accuracy = 1e-5  # relative, of CSDP's values
        certified = loose = 0
        with tempfile.TemporaryDirectory() as folder:
            for number in range(100):
                nodes, dim = 3 + number % 4, 2 + number % 2
                with self.subTest(number=number, nodes=nodes, dim=dim):
                    system = random_system(nodes, dim, rng, 0.8)
                    x = system.anchors.copy()
                    summary = asterism.solve(system, x, "staircase")
                    energy, value = summary.final_energy, relaxation(system, folder)
                    self.assertAlmostEqual(summary.lower_bound / energy, value / energy, delta=accuracy)
                    if asterism.certify(system, x).certified:
                        certified += 1
                        self.assertAlmostEqual(value / energy, 1, delta=accuracy)
                    elif summary.lower_bound < (1 - 2 * accuracy) * energy:
                        loose += 1
                        self.assertLess(value, (1 - accuracy) * energy)
        self.assertGreater(certified, 50)
        self.assertGreater(loose, 10)


if __name__ == "__main__":
    unittest.main()
