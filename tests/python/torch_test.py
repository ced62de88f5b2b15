#!/usr/bin/env python3
"""asterism.torch, where PyTorch is installed."""

import unittest
import warnings

import asterism
import numpy as np

try:
    import torch
except ImportError:
    torch = None


@unittest.skipIf(torch is None, "PyTorch is not installed")
class TorchTest(unittest.TestCase):
    def setUp(self):
        self.topology = asterism.Topology.full(4)
        random = np.random.default_rng(3)
        points = random.uniform(0, 10, (3, 4, 2))
        links = self.topology.links
        lengths = np.linalg.norm(points[:, links[:, 0]] - points[:, links[:, 1]], axis=2) * random.uniform(0.9, 1.1, (3, 6))
        values = (points, random.uniform(0.5, 2, (3, 4)), lengths, random.uniform(0.5, 2, (3, 6)))
        self.values = [torch.tensor(value, dtype=torch.float64, requires_grad=True) for value in values]

    def solve(self, *values, **options):
        import asterism.torch

        return asterism.torch.solve(self.topology, *values, **options)

    def test_gradcheck(self):
        self.assertTrue(torch.autograd.gradcheck(self.solve, self.values, eps=1e-4, atol=1e-5, rtol=1e-4))

    def test_one_system_and_values_shared_by_the_batch(self):
        anchors, stiffness, lengths, link_stiffness = self.values
        shared = [value[0].detach().clone().requires_grad_() for value in (stiffness, lengths, link_stiffness)]
        x = self.solve(anchors, *shared)
        self.assertEqual(x.shape, (3, 4, 2))
        x.square().sum().backward()
        expected = torch.zeros(6, dtype=torch.float64)
        for b in range(3):
            one = [value.detach().clone().requires_grad_() for value in (anchors[b], *shared)]
            alone = self.solve(*one)
            self.assertEqual(alone.shape, (4, 2))
            torch.testing.assert_close(alone, x[b])
            alone.square().sum().backward()
            torch.testing.assert_close(anchors.grad[b], one[0].grad)
            expected += one[3].grad
        torch.testing.assert_close(shared[2].grad, expected)

    def test_a_solver_one_by_one_gives_the_same(self):
        results = []
        for solver in (None, asterism.Solver("newton", tolerance=1e-12)):
            values = [value.detach().clone().requires_grad_() for value in self.values]
            x = self.solve(*values, solver=solver)
            x.pow(3).sum().backward()
            results.append([x.detach(), *(value.grad for value in values)])
        for in_lanes, one_by_one in zip(*results):
            torch.testing.assert_close(in_lanes, one_by_one, rtol=1e-9, atol=1e-9)

    def test_a_solution_without_gradient_is_named_and_leaves_the_others(self):
        anchors, stiffness, lengths, link_stiffness = (value.detach().clone() for value in self.values)
        stiffness[2, 1:] = 0  # free to turn about node 0
        others = [value[:2] for value in (anchors, stiffness, lengths)]
        for solver in (None, asterism.Solver("newton", tolerance=1e-12)):
            shared = link_stiffness[0].clone().requires_grad_()  # by all systems of the batch
            x = self.solve(anchors.requires_grad_(), stiffness, lengths, shared, solver=solver)
            anchors.grad = None
            with self.assertWarnsRegex(RuntimeWarning, "system 2 has no gradient: .*rotate about node 0"):
                x.square().sum().backward(retain_graph=True)
            alone = link_stiffness[0].clone().requires_grad_()
            self.solve(*others, alone).square().sum().backward()
            torch.testing.assert_close(shared.grad, alone.grad, rtol=1e-9, atol=1e-9)
            self.assertTrue(torch.all(anchors.grad[2] == 0) and torch.all(anchors.grad[:2] != 0))
            with warnings.catch_warnings():  # a loss that leaves it out
                warnings.simplefilter("error")
                x[:2].square().sum().backward(retain_graph=True)
            with self.assertRaisesRegex(RuntimeError, "system 2 has no gradient: .*rotate about node 0"):
                x[2].square().sum().backward()

    def test_a_law_is_learned(self):
        anchors, stiffness, lengths, strain = (value.detach() for value in self.values)
        with torch.no_grad():
            target = self.solve(anchors, stiffness, lengths, 0.7 * strain**1.5)
        law = torch.tensor([0.0, 1.0], dtype=torch.float64, requires_grad=True)  # the log of the scale, and the exponent
        optimiser = torch.optim.LBFGS([law], max_iter=100, tolerance_grad=1e-14, tolerance_change=1e-18, line_search_fn="strong_wolfe")

        def loss():
            optimiser.zero_grad()
            value = (self.solve(anchors, stiffness, lengths, torch.exp(law[0]) * strain ** law[1]) - target).square().sum()
            value.backward()
            return value

        optimiser.step(loss)
        np.testing.assert_allclose(law.detach(), [np.log(0.7), 1.5], atol=1e-5)

    def test_other_types_and_errors(self):
        x = self.solve(*(value.float() for value in self.values))
        self.assertEqual(x.dtype, torch.float32)
        with self.assertRaisesRegex(RuntimeError, "system 1 was not solved"):
            anchors = self.values[0].detach().clone()
            anchors[1, 0, 0] = torch.nan
            self.solve(anchors, *self.values[1:])
        with self.assertRaisesRegex(ValueError, "expected 2 or 3 axes"):
            self.solve(self.values[1][0], *self.values[1:])


if __name__ == "__main__":
    if torch is None:
        print("skipped: PyTorch is not installed")
    unittest.main()
