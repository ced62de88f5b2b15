"""The solution of spring systems as a layer of PyTorch: `import asterism.torch` needs torch, which Asterism does not install.

    x = asterism.torch.solve(topology, anchors, anchor_stiffness, rest_length, link_stiffness)
    x.square().sum().backward()         # gradients of all four

The values may be of one system or of a batch of them.
"""

import functools
import warnings

import numpy as np
import torch

from . import Solver, SpringBatch, SpringSystem, Status, Topology
from .gradients import SensitivityStatus, sensitivity
from .inputs import numbers, shown

__all__ = ["solve"]

_NAMES = ("anchors", "anchor_stiffness", "rest_length", "link_stiffness")
_TOLERANCE = 1e-12
# A tolerance below the rounding of the coordinates ends without progress, at the minimum.
_SETTLED = 1e-9


def _system(topology, values, b):
    """System b of a batch."""
    system = SpringSystem(topology, values[0].shape[2])
    for name, value in zip(_NAMES, values):
        setattr(system, name, value[b])
    return system


def _solve_one(solver, system, x, b):
    summary = solver.solve(system, x, check=False)
    if summary.status != Status.CONVERGED and not (summary.usable and summary.stationarity <= _SETTLED):
        raise RuntimeError(f"system {b} was not solved: {summary.message}")


def _fill_gradients(gradients, systems, xs, grad_xs):
    """Row b of every array of gradients, for each (b, system) and its solution xs[b]; returns why some have none, whose rows become 0."""
    reasons = []
    for b, system in systems:
        try:
            rows = (getattr(sensitivity(system, xs[b], grad_xs[b]), name) for name in _NAMES)
            for gradient, row in zip(gradients, rows):
                gradient[b] = row
        except np.linalg.LinAlgError as error:
            for gradient in gradients:
                gradient[b] = 0
            if grad_xs[b].any():  # otherwise 0 is right
                reasons.append(f"system {b} has no gradient: {error}")
    return reasons


class _OneByOne:
    """The solutions x of a batch by a solver."""

    def __init__(self, solver, topology, start, values):
        self.x = np.array(start)
        self.systems = [_system(topology, values, b) for b in range(len(start))]
        for b, system in enumerate(self.systems):
            _solve_one(solver, system, self.x[b], b)

    def gradients(self, grad_x):
        shapes = ([getattr(system, name) for system in self.systems] for name in _NAMES)
        gradients = [np.empty_like(np.stack(values)) for values in shapes]
        return gradients, _fill_gradients(gradients, enumerate(self.systems), self.x, grad_x)


class _InLanes:
    """The same by Newton's method, many at once."""

    def __init__(self, topology, start, values):
        self.topology, self.values = topology, values
        self.batch = SpringBatch(topology, len(start), start.shape[2])
        self.batch.x = start
        for name, value in zip(_NAMES, values):
            setattr(self.batch, name, value)
        self.batch.solve(torch.get_num_threads(), tolerance=_TOLERANCE)
        status = self.batch.status
        settled = np.isin(status, (Status.NO_PROGRESS, Status.MAX_ITERATIONS)) & (self.batch.stationarity <= _SETTLED)
        self.x = np.ascontiguousarray(self.batch.x)
        for b in np.flatnonzero((status != Status.CONVERGED) & ~settled):
            self.x[b] = start[b]
            _solve_one(Solver("newton", tolerance=_TOLERANCE), _system(topology, values, b), self.x[b], b)  # says why
            self.batch.x[b] = self.x[b]

    def gradients(self, grad_x):
        gradient = self.batch.sensitivity(grad_x, threads=torch.get_num_threads())
        gradients = [np.array(getattr(gradient, name)) for name in _NAMES]
        left = np.flatnonzero(gradient.status != SensitivityStatus.COMPUTED)
        systems = ((b, _system(self.topology, self.values, b)) for b in left)
        return gradients, _fill_gradients(gradients, systems, self.x, grad_x)


class _Solve(torch.autograd.Function):
    """Batches of values, (B, ...), to solutions (B, N, dim) of a type; each gradient has the type and device of its values."""

    @staticmethod
    def forward(ctx, solver, topology, start, dtype, *tensors):
        values = [tensor.detach().to("cpu", torch.float64).numpy() for tensor in tensors]
        ctx.solved = _InLanes(topology, start, values) if solver is None else _OneByOne(solver, topology, start, values)
        ctx.of = [(tensor.device, tensor.dtype) for tensor in tensors]
        return torch.from_numpy(ctx.solved.x.copy()).to(tensors[0].device, dtype)

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx, grad):
        grad_x = grad.detach().to("cpu", torch.float64).numpy()
        gradients, reasons = ctx.solved.gradients(grad_x)
        if reasons:
            if len(reasons) == np.count_nonzero(grad_x.any(axis=(1, 2))):
                raise RuntimeError(reasons[0])
            more = f", and {len(reasons) - 1} more" if len(reasons) > 1 else ""
            warnings.warn(f"0 is taken as the gradient where there is none: {reasons[0]}{more}", RuntimeWarning, stacklevel=2)
        needed = ctx.needs_input_grad[4:]
        return None, None, None, None, *(
            torch.from_numpy(np.ascontiguousarray(values)).to(*of) if is_needed else None
            for values, of, is_needed in zip(gradients, ctx.of, needed)
        )


def _tensor(values, name):
    """A tensor of real numbers: itself, or of anything that NumPy makes an array."""
    if not isinstance(values, torch.Tensor):
        return torch.from_numpy(numbers(values, name))
    if values.is_complex():
        raise TypeError(f"{name}: expected real numbers, found {values.dtype}")
    if values.layout != torch.strided:
        raise TypeError(f"{name}: expected a dense tensor, found {values.layout}")
    if values.device.type == "meta":
        raise TypeError(f"{name}: a tensor of the device 'meta' has no numbers")
    return values


def _type_of(values):
    """The floating type of the results: as of PyTorch's sum of the values, in which plain numbers have no say."""
    types = [value.dtype for value in values if value.dim() > 0]
    result = functools.reduce(torch.promote_types, types)
    return result if result.is_floating_point else torch.get_default_dtype()


def solve(topology, anchors, anchor_stiffness, rest_length, link_stiffness, *, start=None, solver=None):
    """The solutions of spring systems with gradients by all of their values.

    anchors: (N, dim) or, for a batch, (B, N, dim). anchor_stiffness (N,), rest_length and link_stiffness (L,), one for each link of
    `topology`: of one system, for all of the batch, or with a first axis of B; or one number. All may be tensors of any real type,
    or what NumPy makes an array of float64. start: where solves begin, of the anchors' shape (the anchors); no gradient comes from
    it. solver: an asterism.Solver, which solves the systems one after another (Newton's method to a tolerance of 1e-12 in SIMD
    lanes, as asterism.SpringBatch, on torch.get_num_threads() threads).

    Returns x, of the anchors' shape and device. Solves are in double precision on the CPU, whatever the types of the values; x has
    the type that PyTorch gives to a sum of them, and its default floating type if all are integers. ValueError for other shapes,
    TypeError for a value that is not a real number. RuntimeError, with the number of the system, if one does not converge. There are no second
    derivatives.

    A solution may have no derivative: a saddle, a component that is free to turn, linked nodes that push each other apart in one place
    (asterism.sensitivity). In a batch, backward() then takes 0 for the gradient of that system, which leaves the sums over the batch
    finite, and gives a RuntimeWarning with its number and the reason (warnings.simplefilter("error", RuntimeWarning) makes it an
    exception). If no system of those that the loss depends on has one, it is a RuntimeError. A system that the loss does not depend on
    has the gradient 0 without a warning.
    """
    if not isinstance(topology, Topology):
        raise TypeError(f"topology: expected asterism.Topology, found {shown(topology)}")
    if not (solver is None or isinstance(solver, Solver)):
        raise TypeError(f"solver: expected asterism.Solver or None, found {shown(solver)}")
    anchors = _tensor(anchors, "anchors")
    is_single = anchors.dim() == 2
    if anchors.dim() not in (2, 3):
        raise ValueError(f"anchors: expected 2 or 3 axes, (N, dim) or (B, N, dim), found {anchors.dim()}")
    batch = anchors.unsqueeze(0) if is_single else anchors
    count = len(batch)
    if batch.shape[1] != topology.nodes or batch.shape[2] not in (2, 3):
        raise ValueError(f"anchors: expected {topology.nodes} nodes of 2 or 3 coordinates, found shape {tuple(anchors.shape)}")
    values, types = [batch], [anchors]
    sizes = topology.nodes, topology.link_count, topology.link_count
    for name, given, size in zip(_NAMES[1:], (anchor_stiffness, rest_length, link_stiffness), sizes):
        value = _tensor(given, name)
        types.append(value)
        if tuple(value.shape) not in ((), (size,), (1, size), (count, size)):
            raise ValueError(f"{name}: expected a number or shape ({size},) or ({count}, {size}), found {tuple(value.shape)}")
        values.append(value.expand(count, size))
    first = batch if start is None else _tensor(start, "start")
    if first.shape not in (anchors.shape, batch.shape):
        raise ValueError(f"start: expected shape {tuple(anchors.shape)}, found {tuple(first.shape)}")
    first = np.array(first.detach().to("cpu", torch.float64).reshape(batch.shape).numpy())
    x = _Solve.apply(solver, topology, first, _type_of(types), *values)
    return x.squeeze(0) if is_single else x
