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

    def test_what_has_no_numbers_is_named(self):
        values = [value.detach() for value in self.values]
        for k, name in enumerate(("anchors", "anchor_stiffness", "rest_length", "link_stiffness")):
            for change, message in (
                (lambda v: v.to_sparse(), "expected a dense tensor, found torch.sparse_coo"),
                (lambda v: v.to("meta"), "a tensor of the device 'meta' has no numbers"),
                (lambda v: v.to(torch.complex64), "expected real numbers, found torch.complex64"),
            ):
                with self.assertRaisesRegex(TypeError, f"^{name}: {message}"):
                    self.solve(*values[:k], change(values[k]), *values[k + 1 :])
        with self.assertRaisesRegex(TypeError, "^topology: expected asterism.Topology, found 3"):
            asterism.torch.solve(3, *values)
        with self.assertRaisesRegex(TypeError, "^solver: expected asterism.Solver or None, found 'newton'"):
            self.solve(*values, solver="newton")

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
        anchors, stiffness, lengths, link_stiffness = self.values
        for values, error, message in (
            ((anchors, stiffness[:, :3], lengths, link_stiffness), ValueError, r"anchor_stiffness: expected a number or shape \(4,\) or \(3, 4\), found \(3, 3\)"),
            ((anchors, stiffness, lengths[:2], link_stiffness), ValueError, r"rest_length: expected a number or shape \(6,\)"),
            ((anchors[:, :3], stiffness, lengths, link_stiffness), ValueError, r"anchors: expected 4 nodes of 2 or 3"),
            ((anchors, stiffness, lengths, link_stiffness.to(torch.complex64)), TypeError, "link_stiffness: expected real numbers, found torch.complex64"),
            ((anchors, np.ma.masked_array(np.ones(4), np.arange(4) == 1), lengths, link_stiffness), TypeError, "anchor_stiffness: expected numbers, found masked"),
            ((anchors, "stiff", lengths, link_stiffness), TypeError, "anchor_stiffness: expected numbers, found <U5"),
        ):
            with self.subTest(message), self.assertRaisesRegex(error, message):
                self.solve(*values)
        with self.assertRaisesRegex(ValueError, "start: expected shape"):
            self.solve(*self.values, start=anchors[0])

    def test_no_value_is_rounded_to_the_type_of_another(self):
        whole = self.values[0].detach().round()
        values = [whole, *(value.detach() for value in self.values[1:])]
        expected = self.solve(*values)
        for dtype, of_result in (
            (torch.int64, torch.float64),  # of the other values
            (torch.int8, torch.float64),
            (torch.float16, torch.float64),
            (torch.float32, torch.float64),
            (torch.float64, torch.float64),
        ):
            given = [value.clone().requires_grad_() for value in values[1:]]
            with self.subTest(dtype):
                x = self.solve(whole.to(dtype), *given)
                self.assertEqual(x.dtype, of_result)
                torch.testing.assert_close(x, expected, rtol=1e-12, atol=1e-12)
                x.square().sum().backward()
                self.assertTrue(all(value.grad.dtype == torch.float64 and value.grad.abs().sum() > 0 for value in given))
        # The result of narrower values is that of the same values in double precision, rounded once.
        narrow = [whole.to(torch.int32), *(value.float() for value in values[1:])]
        x = self.solve(*narrow)
        self.assertEqual(x.dtype, torch.float32)
        torch.testing.assert_close(x, self.solve(*(value.double() for value in narrow)).float(), rtol=0, atol=0)
        integers = self.solve(whole.to(torch.int64), 1, 3, 2)
        self.assertEqual(integers.dtype, torch.get_default_dtype())
        torch.testing.assert_close(integers.double(), self.solve(whole, 1.0, 3.0, 2.0), rtol=1e-6, atol=1e-5)

    def test_each_gradient_has_the_type_of_its_value(self):
        values = [value.detach().to(dtype).requires_grad_() for value, dtype in zip(self.values, (torch.float32, torch.float64, torch.float16, torch.float32))]
        x = self.solve(*values)
        self.assertEqual(x.dtype, torch.float64)
        x.pow(3).sum().backward()
        exact = [value.detach().double().requires_grad_() for value in values]
        self.solve(*exact).pow(3).sum().backward()
        for value, other in zip(values, exact):
            self.assertEqual(value.grad.dtype, value.dtype)
            torch.testing.assert_close(value.grad, other.grad.to(value.dtype), rtol=2e-3, atol=1e-3)

    def test_plain_numbers_and_arrays(self):
        anchors = self.values[0].detach()
        expected = self.solve(anchors, torch.full((4,), 0.9), torch.full((6,), 3.0), torch.full((6,), 0.5))
        for values in (
            (0.9, 3, 0.5),
            (np.float64(0.9), np.int8(3), torch.tensor(0.5)),
            (np.full(4, 0.9), [3] * 6, np.full((3, 6), 0.5, np.float32)),
        ):
            torch.testing.assert_close(self.solve(anchors, *values), expected.to(torch.float64), rtol=1e-6, atol=1e-6)
        torch.testing.assert_close(self.solve(anchors.numpy(), 0.9, 3, 0.5), self.solve(anchors, 0.9, 3.0, 0.5))
        self.assertEqual(self.solve(anchors.float(), 0.9, 3, 0.5).dtype, torch.float32)
        stiffness = torch.tensor(0.9, dtype=torch.float64, requires_grad=True)  # one for all nodes
        each = torch.full((4,), 0.9, dtype=torch.float64, requires_grad=True)
        for value in (stiffness, each):
            self.solve(anchors, value, 3.0, 0.5).pow(2).sum().backward()
        torch.testing.assert_close(stiffness.grad, each.grad.sum())


if __name__ == "__main__":
    if torch is None:
        print("skipped: PyTorch is not installed")
    unittest.main()
