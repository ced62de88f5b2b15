"""Gradients of a function of a system's solution by the system's values."""

import copy
import enum
from dataclasses import dataclass

import numpy as np

from . import _asterism

__all__ = ["Sensitivity", "SensitivityStatus", "sensitivity"]


class SensitivityStatus(enum.IntEnum):
    """Whether a system of a batch has derivatives of its solution, or why not; an int to NumPy."""

    COMPUTED = 0  #: the only one with derivatives
    NOT_STATIONARY = 1  #: x is not a stationary point to the option `stationarity`
    NOT_POSITIVE_DEFINITE = 2  #: x is not a strict local minimum
    COINCIDENT_NODES = 3  #: linked nodes coincide and push each other apart
    NUMERICAL_FAILURE = 4  #: a number leaves the range of float64
    INVALID_INPUT = 5  #: a value that a solver would refuse, or a grad_x that is not finite
    OUT_OF_MEMORY = 6

    # It would be printed as its number, which says less.
    __str__ = enum.Enum.__str__
    __format__ = enum.Enum.__format__


@dataclass(frozen=True, eq=False)
class Sensitivity:
    """dL/d(values) of a system for a function L of its solution: arrays of the shapes that the system's have.

    Of a batch of M systems, the arrays have a first axis of M.
    """

    anchors: np.ndarray  #: (N, dim)
    anchor_stiffness: np.ndarray  #: (N,)
    rest_length: np.ndarray  #: one for each link
    link_stiffness: np.ndarray  #: one for each link
    rest_offset: np.ndarray | None = None  #: (L, dim); None if the links have no offsets
    loads: np.ndarray | None = None  #: (N, dim); None if no node has a load
    status: np.ndarray | None = None  #: of a batch: (M,), values of SensitivityStatus

    def copy(self):
        """An object of its own with the same values."""
        return copy.deepcopy(self)


def sensitivity(system, x, grad_x, *, stationarity=1e-6):
    """dL/d(values) of `system` at its solution x (N, dim) for grad_x = dL/dx (N, dim), a Sensitivity.

    At a strict local minimum the solution follows the values of the system: H dx = -d(gradient), H the Hessian of the energy. One
    factorisation and one solve give the derivatives by all values (reverse mode). grad_x at fixed nodes does not count. A link between
    nodes in one place, of rest length 0 or stiffness 0, has no direction: the derivatives by its rest length and its stiffness are 0, the
    mean of those for opposite directions.

    A SpringBatch has a method of this name for all of its solutions.

    numpy.linalg.LinAlgError if there are no derivatives, with the reason: x is not stationary to `stationarity`, it is not a strict
    local minimum, or linked nodes coincide and push each other apart. ValueError for values that a solver would refuse, MemoryError if
    memory runs out.
    """
    return Sensitivity(*_asterism._sensitivity(system, x, grad_x, stationarity))
