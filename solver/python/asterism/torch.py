"""The solution of spring systems as a layer of PyTorch: `import asterism.torch` needs torch, which Asterism does not install.

    x = asterism.torch.solve(topology, anchors, anchor_stiffness, rest_length, link_stiffness)
    x.square().sum().backward()         # gradients of all four

The values may be of one system or of a batch of them.
"""

import numpy as np
import torch

from . import Solver, SpringSystem, Status
from .gradients import sensitivity

__all__ = ["solve"]


class _Solve(torch.autograd.Function):
    """Batches of values, (B, ...), to solutions (B, N, dim)."""

    @staticmethod
    def forward(ctx, solver, topology, start, anchors, anchor_stiffness, rest_length, link_stiffness):
        values = [tensor.detach().to("cpu", torch.float64).numpy() for tensor in (anchors, anchor_stiffness, rest_length, link_stiffness)]
        x = np.array(start, dtype=np.float64)
        systems = []
        for b in range(len(x)):
            system = SpringSystem(topology, x.shape[2])
            system.anchors, system.anchor_stiffness, system.rest_length, system.link_stiffness = (value[b] for value in values)
            summary = solver.solve(system, x[b])
            # A tolerance below the rounding of the coordinates ends without progress, at the minimum.
            if summary.status != Status.CONVERGED and not (summary.usable and summary.stationarity <= 1e-9):
                raise RuntimeError(f"system {b} was not solved: {summary.message}")
            systems.append(system)
        ctx.systems, ctx.x = systems, x
        return torch.from_numpy(x.copy()).to(anchors)

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx, grad):
        grad_x = grad.detach().to("cpu", torch.float64).numpy()
        gradients = []
        for b, system in enumerate(ctx.systems):
            try:
                gradients.append(sensitivity(system, ctx.x[b], grad_x[b]))
            except np.linalg.LinAlgError as error:
                raise RuntimeError(f"system {b} has no gradient: {error}") from error
        stacked = (
            np.stack([getattr(gradient, name) for gradient in gradients])
            for name in ("anchors", "anchor_stiffness", "rest_length", "link_stiffness")
        )
        return None, None, None, *(torch.from_numpy(values).to(grad) for values in stacked)


def solve(topology, anchors, anchor_stiffness, rest_length, link_stiffness, *, start=None, solver=None):
    """The solutions of spring systems with gradients by all of their values.

    anchors: (N, dim) or, for a batch, (B, N, dim). anchor_stiffness (N), rest_length and link_stiffness (one for each link of
    `topology`): of one system, for all of the batch, or with a first axis of B. start: where solves begin, an array or tensor of
    the anchors' shape (the anchors); no gradient comes from it. solver: an asterism.Solver (Newton's method to a tolerance of 1e-12).

    Returns x, of the anchors' shape, type and device. Solves are in double precision on the CPU, one after another. RuntimeError,
    with the number of the system, if one does not converge, or in backward() if its solution has no derivative. There are no second
    derivatives.
    """
    is_single = anchors.dim() == 2
    if anchors.dim() not in (2, 3):
        raise ValueError(f"anchors: expected 2 or 3 axes, (N, dim) or (B, N, dim), found {anchors.dim()}")
    batch = anchors.unsqueeze(0) if is_single else anchors
    count = len(batch)
    first = batch if start is None else torch.as_tensor(start).expand(batch.shape)
    values = (torch.as_tensor(value).to(anchors) for value in (anchor_stiffness, rest_length, link_stiffness))
    values = [value.expand(count, value.shape[-1]) for value in values]
    if solver is None:
        solver = Solver("newton", tolerance=1e-12)
    x = _Solve.apply(solver, topology, first.detach().cpu().numpy(), batch, *values)
    return x.squeeze(0) if is_single else x
