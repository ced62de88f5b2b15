"""Pictorial structures: the best placement of parts that have whole maps of costs."""

from __future__ import annotations

import dataclasses
import operator
from typing import Any, Iterable, Sequence

import numpy as np
import numpy.typing as npt

from . import _asterism

_SHAPES = {"quadratic": 0.0, "absolute": 1.0}


@dataclasses.dataclass(frozen=True)
class Joint:
    """An edge of a tree of parts: what it costs that the child is at d from its parent [px].

    Along each axis, weight (d - offset)^2, or weight |d - offset| if the shape is "absolute", but no more than the truncation.
    weight and truncation are a number, or one each for x and y.
    """

    parent: int
    child: int
    #: The displacement (x, y) that costs nothing [px].
    offset: Sequence[float] = (0.0, 0.0)
    weight: float | Sequence[float] = 1.0
    shape: str = "quadratic"
    truncation: float | Sequence[float] = float("inf")


@dataclasses.dataclass(frozen=True, eq=False)
class PictorialResult:
    """What pictorial_structure finds."""

    #: Of the best placement.
    energy: float
    #: The best placement: (N, 2), the column x and the row y of each part in its map.
    positions: npt.NDArray[np.int32]
    #: The part that is no child.
    root: int
    #: For each position of the root, an array like its map: the least energy of a placement that has it there.
    min_marginals: npt.NDArray[np.float32]
    #: The energy and the positions of each placement that was asked for, the best one first.
    placements: list[tuple[float, npt.NDArray[np.int32]]]


def pictorial_structure(
    maps: Iterable[npt.ArrayLike], joints: Iterable[Joint], *, count: int = 1, distance: float = 0.0
) -> PictorialResult:
    """The placement of the parts with the least energy, the sum of the maps at the parts' positions and of the joints' costs.

    maps: an array (height, width) of costs for each part, of any sizes; infinity forbids a position. Arrays of float32 are not
    copied. joints: a tree of all parts, in any order. count: how many placements to find; each further one is the best of all
    whose root is farther than distance [px] from the roots of those before it. The best placement is exact, in time linear in
    the number of pixels: see docs/pictorial-structures.md. ValueError, which names the joint or the map, for bad input.
    """
    ends: list[tuple[int, int]] = []
    costs: list[Any] = []
    for number, joint in enumerate(joints):
        if joint.shape not in _SHAPES:
            raise ValueError(f"joint {number}: expected the shape 'quadratic' or 'absolute', found {joint.shape!r}")
        ends.append((operator.index(joint.parent), operator.index(joint.child)))
        values = joint.weight, joint.offset, _SHAPES[joint.shape], joint.truncation
        try:
            costs.append(np.stack([np.broadcast_to(np.asarray(value, float), 2) for value in values], axis=1))
        except ValueError:
            raise ValueError(f"joint {number}: expected offset, weight and truncation to be (x, y) or a number") from None
    if count < 1 or not distance >= 0:
        raise ValueError("expected a count of 1 or more, and a distance of 0 or more")
    found = _asterism._pictorial_structure(
        list(maps), np.reshape(np.array(ends, float), (-1, 2)), np.reshape(np.array(costs, float), (-1, 2, 4)), count, distance
    )
    return PictorialResult(*found)
