"""Pictorial structures: the best placement of parts that have whole maps of costs."""

from __future__ import annotations

import dataclasses
import operator
from typing import Any, Iterable, Sequence

import numpy as np
import numpy.typing as npt

from . import _asterism, inputs

_SHAPES = {"quadratic": 0.0, "absolute": 1.0}


@dataclasses.dataclass(frozen=True)
class Joint:
    """An edge between two parts: what it costs that the child is at d from its parent [px].

    Along each axis, weight (d - offset)^2, or weight |d - offset| if the shape is "absolute", but no more than the truncation.
    weight and truncation are a number, or one each for x and y. With a length, the cost is that of a spring, weight
    (|d| - length)^2, for displacements within reach of the rounded offset on each axis; others are forbidden, also if the weight is 0.
    """

    parent: int
    child: int
    #: The displacement (x, y) that costs nothing [px].
    offset: Sequence[float] = (0.0, 0.0)
    weight: float | Sequence[float] = 1.0
    shape: str = "quadratic"
    truncation: float | Sequence[float] = float("inf")
    #: The distance that costs nothing [px].
    length: float | None = None
    #: Of the window, for a length [px], up to 255.
    reach: int = 8
    #: scaled_structure: what it costs that the child is one layer from its parent; n layers cost n^2 times as much.
    layer_weight: float = 1.0


@dataclasses.dataclass(frozen=True, eq=False)
class PictorialResult:
    """The result of pictorial_structure."""

    #: Of the best placement.
    energy: float
    #: The best placement: (N, 2), the column x and the row y of each part in its map.
    positions: npt.NDArray[np.int32]
    #: The root of the tree: the part that is not a child.
    root: int
    #: For each position of the root, an array like its map: the least energy of a placement that has it there.
    min_marginals: npt.NDArray[np.float32]
    #: The energy and the positions of each placement that was asked for, the best one first.
    placements: list[tuple[float, npt.NDArray[np.int32]]]

    __repr__ = inputs.brief


def pictorial_structure(
    maps: Iterable[npt.ArrayLike], joints: Iterable[Joint], *, count: int = 1, distance: float = 0.0
) -> PictorialResult:
    """The placement of the parts with the least energy, the sum of the maps at the parts' positions and of the joints' costs.

    maps: an array (height, width) of costs for each part, of any sizes; infinity, or a mask, forbids a position. Arrays of float32
    are not copied; larger numbers than those of float32 are a ValueError. joints: a tree of all parts, in any order. count: how many placements to find; each further one is the best of all
    whose root is farther than distance [px] from the roots of those before it. The best placement is exact, in time linear in
    the number of pixels: see docs/pictorial-structures.md. ValueError, which names the joint or the map, for bad input.
    """
    return PictorialResult(*_asterism._pictorial_structure(*_problem(maps, joints), *_several(count, distance)))


def m_best_placements(
    maps: Iterable[npt.ArrayLike], joints: Iterable[Joint], *, count: int, distance: float = 0.0
) -> list[tuple[float, npt.NDArray[np.int32]]]:
    """The energies and the positions of the count best placements, exactly; fewer if no others are allowed.

    Each further one is the best of all placements that differ from each one before it in a part that is farther than distance [px]
    away; with a distance of 0, these are the placements of the least energies. maps and joints as for pictorial_structure, whose
    count compares the roots only and takes much less time.
    """
    return _asterism._m_best_placements(*_problem(maps, joints), *_several(count, distance))


@dataclasses.dataclass(frozen=True, eq=False)
class ScaledResult:
    """The result of scaled_structure."""

    #: Of the best placement.
    energy: float
    #: The best placement: (N, 2), the column x and the row y of each part in its maps.
    positions: npt.NDArray[np.int32]
    #: The layer of each part in it, from 0.
    layers: npt.NDArray[np.int32]
    #: The root of the tree: the part that is not a child.
    root: int
    #: For each layer and position of the root, the least energy of a placement that has it there.
    min_marginals: npt.NDArray[np.float32]
    #: The energy, the positions and the layers of each placement that was asked for, the best one first.
    placements: list[tuple[float, npt.NDArray[np.int32], npt.NDArray[np.int32]]]

    __repr__ = inputs.brief


def scaled_structure(
    maps: Iterable[npt.ArrayLike], joints: Iterable[Joint], scales: Sequence[float], *, count: int = 1, distance: float = 0.0
) -> ScaledResult:
    """pictorial_structure with layers of scale: the best placement of the parts in position and layer, exactly.

    maps: an array (layers, height, width) for each part, on the image's pixels. scales: those of the layers, > 0. A joint counts its
    displacement in units of the scale of the parent's layer, and has a cost of the change of layers (layer_weight). Further
    placements have roots that are farther than distance [px] from the roots of those before them, in any layer.
    """
    scales = inputs.numbers(scales, "scales")
    if scales.ndim != 1:
        raise ValueError(f"scales: expected shape (layers,), found {scales.shape}")
    layers = len(scales)
    stacks = []
    for number, stack in enumerate(inputs.items(maps, "maps", "a list of arrays")):
        stack = np.ma.asanyarray(stack)  # keeps a mask
        if stack.ndim != 3 or len(stack) != layers:
            raise ValueError(f"maps of part {number}: expected the shape ({layers}, height, width), found {stack.shape}")
        stacks.extend(stack)
    energy, positions, of_parts, root, marginals, placements = _asterism._scaled_structure(
        *_problem(stacks, joints), scales, *_several(count, distance)
    )
    return ScaledResult(energy, positions, of_parts, root, np.stack(marginals), placements)


@dataclasses.dataclass(frozen=True, eq=False)
class LoopyResult:
    """The result of loopy_structure."""

    #: Status.CONVERGED: the energy is within tolerance of the lower bound. Status.NO_PROGRESS or Status.MAX_ITERATIONS: it is not.
    status: _asterism.Status
    iterations: int
    #: Of the placement.
    energy: float
    #: No placement has a lower energy than this, up to the rounding of floats.
    lower_bound: float
    #: The placement: (N, 2), the column x and the row y of each part in its map.
    positions: npt.NDArray[np.int32]

    __repr__ = inputs.brief


def loopy_structure(
    maps: Iterable[npt.ArrayLike],
    joints: Iterable[Joint],
    *,
    tolerance: float = 1e-3,
    progress: float = 0.01,
    max_iterations: int = 200,
) -> LoopyResult:
    """A good placement of parts that are linked in any graph, and a lower bound of the energy of all placements.

    maps and joints as for pictorial_structure, but joints may form cycles. Stops if the energy is proven to be within tolerance
    [units of the maps] of the least, or if ten iterations raise the bound by less than the share progress of its distance from the
    energy. ValueError also if no placement was found that the windows of lengths allow.
    """
    limits = inputs.number(tolerance, "tolerance"), inputs.number(progress, "progress"), inputs.count(max_iterations, "max_iterations")
    return LoopyResult(*_asterism._loopy_structure(*_problem(maps, joints), *limits))


def _several(count: int, distance: float) -> tuple[int, float]:
    if not (found := float(inputs.numbers(distance, "distance", ()))) >= 0:
        raise ValueError(f"distance: expected >= 0, found {found}")
    return inputs.count(count, "count"), found


# What the functions of _asterism take: the maps; for each joint its ends and four rows of four numbers, see discrete.cpp.
def _problem(maps: Iterable[npt.ArrayLike], joints: Iterable[Joint]) -> tuple[list[Any], Any, Any]:
    ends: list[tuple[int, int]] = []
    costs: list[Any] = []
    for number, joint in enumerate(inputs.items(joints, "joints", "a list of Joints")):
        if not isinstance(joint, Joint):
            raise TypeError(f"joint {number}: expected a Joint, found {inputs.shown(joint)}")
        inputs.choice(joint.shape, f"joint {number}: shape", tuple(_SHAPES))
        ends.append((inputs.count(joint.parent, f"joint {number}: parent", 0), inputs.count(joint.child, f"joint {number}: child", 0)))
        values = joint.weight, joint.offset, _SHAPES[joint.shape], joint.truncation
        of_length = [0.0, 0.0, -1.0, 0.0]  # no window
        try:
            axes = np.stack([np.broadcast_to(inputs.numbers(value, "value"), 2) for value in values], axis=1)
            of_layers = [float(inputs.numbers(joint.layer_weight, "value", ())), 0.0, 0.0, np.inf]
            if joint.length is not None:
                weight, length = (float(inputs.numbers(value, "value", ())) for value in (joint.weight, joint.length))
                of_length[:3] = weight, length, operator.index(joint.reach)
        except (TypeError, ValueError):
            kind = "weight, length and reach to be numbers" if joint.length is not None else "weight and truncation to be (x, y) or a number"
            raise ValueError(f"joint {number}: expected offset, {kind}, and layer_weight a number") from None
        if joint.length is not None:
            if joint.shape != "quadratic" or np.isfinite(joint.truncation).any():
                raise ValueError(f"joint {number}: a cost of a length is quadratic, and has no truncation")
            if joint.reach < 0:
                raise ValueError(f"joint {number} has a reach below 0 or above 255 px")
            axes[:, 0] = 0
        costs.append(np.vstack([axes, of_layers, of_length]))
    return inputs.items(maps, "maps", "a list of arrays"), np.reshape(np.array(ends, float), (-1, 2)), np.reshape(np.array(costs, float), (-1, 4, 4))
