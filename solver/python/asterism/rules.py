"""Rules that a drawing keeps to: boxes without overlap, layers, directions, alignment, groups."""

from __future__ import annotations

from typing import Any, Iterable, Mapping

import numpy as np
import numpy.typing as npt

from . import _asterism, inputs

_Floats = npt.NDArray[np.float64]
_Indices = npt.NDArray[np.intp]
_AXES = "xyz"


def remove_overlaps(x: npt.ArrayLike, sizes: npt.ArrayLike, *, held: npt.ArrayLike | None = None) -> _Floats:
    """Points that are moved little, so that boxes around them do not overlap: labels, or the drawing of another program.

    x: (N, 2), the middles of the boxes. sizes: (N, 2), their widths and heights, >= 0, or (2,) for all.
    held: (N,), True for points that stay where they are. ValueError if no room is found between them.

    Returns an array (N, 2), in which no two boxes overlap, but may touch. A drawing that is so already is returned as it is. Passes move
    the two boxes of each pair that overlaps apart, each by half, along the axis in which they overlap less; if 300 passes do not
    suffice, the order of the boxes is kept from there on, and they are moved apart by the sweeps of a scan line.
    """
    points = inputs.numbers(x, "x")
    if points.ndim != 2 or points.shape[1] != 2:
        raise ValueError(f"x: expected shape (N, 2), found {points.shape}")
    if not np.isfinite(points).all():
        raise ValueError("x: expected finite numbers")
    n = len(points)
    stay = np.zeros(n, dtype=bool)
    if held is not None:
        inputs.numbers(held, "held")
        stay = np.asarray(held)
        if stay.dtype != bool or stay.shape != (n,):
            raise ValueError(f"held: expected shape {(n,)} of bool, found {stay.shape} of {stay.dtype}")
    rules = _asterism._Rules(
        sizes_of(sizes, n), np.empty((0, 3), dtype=np.int64), np.empty(0), np.where(stay[:, None], points, np.nan), *2 * [np.empty(0, dtype=np.int64)]
    )
    moved, summary = _asterism._apply_rules(points, rules)
    if not summary:
        raise ValueError(f"rules: {summary.message}")
    return moved


def sizes_of(sizes: Any, n: int) -> _Floats:
    """(n, 2)"""
    values = inputs.numbers(sizes, "sizes")
    if values.shape not in ((2,), (n, 2)):
        raise ValueError(f"sizes: expected shape {(n, 2)} or (2,), found {values.shape}")
    values = np.ascontiguousarray(np.broadcast_to(values, (n, 2)))
    if len(bad := np.flatnonzero(~((values >= 0) & np.isfinite(values)).all(axis=1))):
        raise ValueError(f"sizes: row {bad[0]} is {values[bad[0]].tolist()}; expected >= 0 and finite")
    return values


def _listed(values: Any, name: str, what: str) -> list[Any]:
    return [] if values is None else inputs.items(values, name, f"a list of {what}")


class Rules:
    """The rules of layout's arguments, by the numbers of nodes."""

    def __init__(
        self,
        nodes: list[Any],
        edges: _Indices,
        dim: int,
        sizes: Any,
        layers: Any,
        downward: Any,
        aligned: Iterable[tuple[str, Iterable[Any]]] | None,
        groups: Iterable[Iterable[Any]] | None,
    ) -> None:
        self._nodes = nodes
        self._index = {node: k for k, node in enumerate(nodes)}
        n = len(nodes)
        if dim != 2 and (sizes is not None or groups is not None):
            raise ValueError(f"{'sizes' if sizes is not None else 'groups'}: only with dim 2")
        self.sizes = np.empty((0, 2)) if sizes is None else sizes_of(sizes, n)
        self.layers = np.full(n, np.nan)
        if layers is not None:
            self.layers = inputs.array(layers, "layers", (n,), missing=np.nan)
            if np.isinf(self.layers).any():
                raise ValueError("layers: expected finite numbers, or NaN for a node without a layer")
        self.orders, self.gap = np.empty((0, 3), dtype=np.int64), 0.0
        self.heights: _Floats = self.layers
        if downward is not None:
            self._order(edges, downward)
        self.aligned = np.full((n, dim), -1, dtype=np.int64)
        self.is_aligned = np.zeros(dim, dtype=bool)
        for number, entry in enumerate(_listed(aligned, "aligned", "pairs of an axis and nodes")):
            if isinstance(entry, str) or not hasattr(entry, "__len__") or len(entry) != 2 or not isinstance(entry[0], str) or entry[0] not in tuple(_AXES[:dim]):
                raise ValueError(f"aligned: entry {number} is {inputs.shown(entry)}; expected an axis of {', '.join(map(repr, _AXES[:dim]))}, and nodes")
            self._align(_AXES.index(entry[0]), self._numbers(entry[1], f"aligned: entry {number}"))
        self.groups = np.empty(0, dtype=np.int64)
        if groups is not None:
            self.groups = np.full(n, -1, dtype=np.int64)
            if isinstance(groups, Mapping):
                raise TypeError(f"groups: expected a list of lists of nodes, found {type(groups).__name__}; of a dict from name to nodes, give list(groups.values())")
            for number, group in enumerate(_listed(groups, "groups", "lists of nodes")):
                members = self._numbers(group, f"groups: group {number}")
                if (self.groups[members] >= 0).any():
                    raise ValueError(f"groups: {nodes[members[self.groups[members] >= 0][0]]!r} is in two groups")
                self.groups[members] = number
            for axis in range(dim):
                for number in np.unique(self.aligned[self.aligned[:, axis] >= 0, axis]):
                    line = np.flatnonzero(self.aligned[:, axis] == number)
                    if len(other := line[self.groups[line] != self.groups[line[0]]]):
                        raise ValueError(f"aligned: {nodes[line[0]]!r} and {nodes[other[0]]!r} are not in the same group")

    def _numbers(self, some: Any, name: str) -> _Indices:
        some = inputs.items(some, name, "a list of nodes")
        for node in some:
            if getattr(node, "__hash__", None) is None or node not in self._index:
                raise ValueError(f"{name}: {inputs.shown(node)} is not a node of the graph")
        return np.array([self._index[node] for node in some], dtype=np.intp)

    def _align(self, axis: int, members: _Indices) -> None:
        """Sets that share a node become one."""
        if not len(members):
            return
        numbers = self.aligned[:, axis]
        joined = np.isin(numbers, numbers[members][numbers[members] >= 0])
        numbers[members] = numbers[joined] = numbers.max() + 1
        self.is_aligned[axis] = True

    def _order(self, edges: _Indices, downward: Any) -> None:
        gap = inputs.numbers(downward, "downward", ())
        if not (gap >= 0 and np.isfinite(gap)):
            raise ValueError(f"downward: expected >= 0 and finite, found {gap}")
        self.gap = float(gap)
        n = len(self.layers)
        part = strong_components(n, edges)
        down = np.unique(edges[part[edges[:, 0]] != part[edges[:, 1]]], axis=0)
        self.orders = np.column_stack([down[:, 1], down[:, 0], np.ones(len(down), dtype=np.int64)]).astype(np.int64)
        # The start's heights: the longest path to a node. Components are numbered so that edges lead to lower ones.
        depth = np.zeros(part.max(initial=-1) + 1)
        for a, b in down[np.argsort(-part[down[:, 0]], kind="stable")]:
            depth[part[b]] = max(depth[part[b]], depth[part[a]] + 1)
        self.heights = np.where(np.isnan(self.layers), -depth[part] * (self.gap or 1.0), self.layers)

    @property
    def have_heights(self) -> bool:
        return bool(np.isfinite(self.heights).any())

    def native(self, at: _Floats, hold: _Floats, hubs: int) -> _asterism._Rules:
        """at, hold: anchors and their weights, of which infinite ones fix a node. hubs: nodes in the middle of groups, after all others."""
        fixed = np.where(np.isinf(hold)[:, None], at, np.nan)
        in_layer = ~np.isnan(self.layers)
        if len(bad := np.flatnonzero(in_layer & ~np.isnan(fixed[:, 1]) & (fixed[:, 1] != self.layers))):
            raise ValueError(f"layers: {self._nodes[bad[0]]!r} is held on {fixed[bad[0]].tolist()}, which is not in its layer {self.layers[bad[0]]}")
        fixed[in_layer, 1] = self.layers[in_layer]
        for axis in np.flatnonzero(self.is_aligned):
            known = np.flatnonzero(~np.isnan(fixed[:, axis]) & (self.aligned[:, axis] >= 0))
            first = dict(reversed(list(zip(self.aligned[known, axis], known))))
            for node in known:
                if fixed[node, axis] != fixed[other := first[self.aligned[node, axis]], axis]:
                    a, b = self._nodes[other], self._nodes[node]
                    raise ValueError(f"aligned: {a!r} and {b!r} have to be at {_AXES[axis]} {fixed[other, axis]} and {fixed[node, axis]}")
        self._check_heights(fixed[:, 1])
        more = np.arange(hubs)
        return _asterism._Rules(
            np.concatenate([self.sizes, np.zeros((hubs, 2))]) if len(self.sizes) else self.sizes,
            self.orders,
            np.full(len(self.orders), self.gap),
            np.concatenate([fixed, np.full((hubs, fixed.shape[1]), np.nan)]),
            np.concatenate([self.aligned, np.full((hubs, self.aligned.shape[1]), -1)]) if self.is_aligned.any() else np.empty(0, dtype=np.int64),
            np.concatenate([self.groups, more]) if len(self.groups) else self.groups,
        )

    def _check_heights(self, y: _Floats) -> None:
        """ValueError if no heights are in the order of `downward` and those given, NaN where none is."""
        if not len(self.orders):
            return
        n = len(y)
        line = np.where(self.aligned[:, 1] >= 0, n + self.aligned[:, 1], np.arange(n))
        lines, of = np.unique(line, return_inverse=True)  # nodes of one height
        above, below = self.orders[:, 1], self.orders[:, 0]
        part = strong_components(len(lines), np.column_stack([of[above], of[below]]))
        if len(bad := np.flatnonzero(part[of[above]] == part[of[below]])):
            a, b = self._nodes[above[bad[0]]], self._nodes[below[bad[0]]]
            raise ValueError(f"downward: {a!r} cannot be above {b!r}, as nodes of the same y make a circle of the edges")
        held = {int(part[of[k]]): int(k) for k in np.flatnonzero(~np.isnan(y))}
        heights, highest, by = y.tolist(), [np.inf] * (int(part.max()) + 1), {}
        # Edges lead from higher components to lower ones, whose limits are known when their turn comes.
        for high, low in sorted(zip(part[of[above]].tolist(), part[of[below]].tolist()), reverse=True):
            top, node = (heights[held[high]], held[high]) if high in held else (highest[high], by.get(high, -1))
            if top - self.gap < highest[low]:
                highest[low], by[low] = top - self.gap, node
        for part_of, node in held.items():
            height, limit = heights[node], highest[part_of]
            if height > limit + 1e-9 * (abs(height) + abs(limit) + self.gap):
                a, b = self._nodes[by[part_of]], self._nodes[node]
                raise ValueError(f"downward: {b!r} has to be at y {limit:g} or below, as {a!r} is at {heights[by[part_of]]:g}, but is at {height:g}")

    def hubs(self, unit: float) -> tuple[_Indices, _Floats]:
        """Edges between groups' middles, nodes N, N + 1 and so on, and their members, and the lengths: of a disc of so many nodes."""
        n = len(self.layers)
        members = np.flatnonzero(self.groups >= 0)
        of = self.groups[members]
        radii = np.sqrt(np.bincount(of) / np.pi) if len(of) else np.empty(0)
        return np.column_stack([n + of, members]).astype(np.intp), unit * np.maximum(radii, 0.5)[of]

    def turned(self, x: _Floats) -> _Floats:
        """x turned about its middle in the plane of x and y, so that it ascends with the heights."""
        known = np.flatnonzero(np.isfinite(self.heights))
        off = self.heights[known] - self.heights[known].mean()
        way = off @ (x[known, :2] - x[known, :2].mean(axis=0))
        if not (length := np.hypot(*way)) > 0:
            return x
        c, s = way[1] / length, way[0] / length
        middle = x[:, :2].mean(axis=0)
        x = x.copy()
        x[:, :2] = (x[:, :2] - middle) @ np.array([[c, s], [-s, c]]) + middle
        return x

    def in_a_row(self, x: _Floats, components: list[_Indices], unit: float) -> _Floats:
        """x with the components side by side along x."""
        half = self.sizes[:, 0] / 2 if len(self.sizes) else np.zeros(len(x))
        x, right = x.copy(), 0.0
        for nodes in sorted(components, key=len, reverse=True):
            left = (x[nodes, 0] - half[nodes]).min()
            x[nodes, 0] += right - left
            right = (x[nodes, 0] + half[nodes]).max() + unit
        return x


def strong_components(n: int, edges: _Indices) -> _Indices:
    """The strongly connected component of each node (Tarjan 1972): edges between two lead from the higher number to the lower one."""
    order = np.argsort(edges[:, 0], kind="stable")
    ends = edges[order, 1].tolist()
    first = np.searchsorted(edges[order, 0], np.arange(n + 1)).tolist()
    number, low, part = [-1] * n, [0] * n, np.full(n, -1, dtype=np.intp)
    stack: list[int] = []
    seen = count = 0
    for root in range(n):
        if number[root] >= 0:
            continue
        path = [(root, first[root])]
        number[root] = low[root] = seen
        seen += 1
        stack.append(root)
        while path:
            node, k = path.pop()
            if k < first[node + 1]:
                path.append((node, k + 1))
                if number[to := ends[k]] < 0:
                    number[to] = low[to] = seen
                    seen += 1
                    stack.append(to)
                    path.append((to, first[to]))
                elif part[to] < 0:
                    low[node] = min(low[node], number[to])
                continue
            if path:
                low[path[-1][0]] = min(low[path[-1][0]], low[node])
            if low[node] < number[node]:
                continue
            while True:
                part[member := stack.pop()] = count
                if member == node:
                    break
            count += 1
    return part
