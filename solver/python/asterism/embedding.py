"""Points with given distances: multidimensional scaling and the layout of graphs."""

from __future__ import annotations

import dataclasses
import inspect
import operator
import warnings
from collections.abc import Mapping
from typing import Any, Callable, Iterable, Sequence

import numpy as np
import numpy.typing as npt

from . import _asterism, inputs, names
from .rules import Rules

_Floats = npt.NDArray[np.float64]
_Indices = npt.NDArray[np.intp]
_MANY = 1000  # over it, layout's default method is "sgd"
_FEW = 100  # over it and up to _SAMPLED, layout also starts from its drawing by "sgd", as random starts do not unfold long graphs
_SAMPLED = 300  # over it, starts are classical scaling and a sample's placement, and not random ones
_Distances = Callable[[_Indices, _Indices], _Floats]  # (C, S, T), for each row of sources (C, S) to that of targets (C, T)


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Embedding:
    """The result of mds or layout."""

    #: (N, dim): a row for each node.
    x: _Floats
    #: sum w_ij (d_ij - |x_i - x_j|)^2 over the known pairs, each once, plus sum w_i |x_i - a_i|^2 over the anchors. Of layout's
    #: method "sgd" an estimate, from a sample of the pairs.
    stress: float
    #: No placement has less stress than this; 0 if nothing is proven.
    lower_bound: float
    #: Another placement may have less stress by this share of it (or of 1e-10 sum w_ij (d_ij + |x_i - x_j|)^2, if that is more,
    #: for placements whose stress is rounding); NaN if nothing is proven.
    gap: float
    #: Of the placement: whether it is proven to have the least stress, and if not, why. None of a sparse stress and of
    #: layout's method "sgd".
    certificate: _asterism.Certificate | None
    #: Of the solve; its energy is half the stress.
    summary: _asterism.Summary
    #: The spring system that was solved. None of layout's method "sgd", which has none.
    system: _asterism.SpringSystem | None
    #: The nodes in the order of the rows of x: 0 .. N - 1, or those of the graph.
    nodes: list[Any]
    #: How many parts the nodes are in that neither a known pair nor an anchor relates to each other: they are placed side by
    #: side, and how they lie to each other means nothing, whatever is proven of the stress.
    parts: int = 1

    @property
    def pos(self) -> dict[Any, _Floats]:
        """The place of each node, by its name: what networkx.draw takes."""
        return dict(zip(self.nodes, self.x))

    @property
    def certified(self) -> bool:
        """The placement is proven to have the least stress."""
        return self.certificate is not None and self.certificate.certified

    def __bool__(self) -> bool:
        """Whether x is a result: the summary's truth value."""
        return bool(self.summary)

    def __repr__(self) -> str:
        proven = "proven least" if self.certified else "nothing proven" if np.isnan(self.gap) else f"gap {self.gap:.3g}"
        n, dim = self.x.shape
        parts = f", {self.parts} unrelated parts" if self.parts > 1 else ""
        return f"<asterism.Embedding: {inputs.counted(n, 'node')}, dim {dim}, stress {self.stress:.6g}, {proven}{parts}>"


@dataclasses.dataclass(frozen=True, eq=False)
class Known:
    """What is known of the places of nodes."""

    nodes: list[Any]
    #: (N, dim): of the anchors; 0 for nodes without one.
    at: _Floats
    #: (N,): the anchors' weights; 0 for nodes without one, infinite for those that are held.
    hold: _Floats
    #: (N, dim), if it is given.
    start: _Floats | None = None


@dataclasses.dataclass(frozen=True, eq=False)
class _Edges:
    """A graph and its components."""

    graph: _asterism._Graph
    components: list[_Indices]
    unit: float  # the longest edge; 1 if there is none


def mds(
    distances: Any,
    weights: Any = None,
    anchors: npt.ArrayLike | None = None,
    dim: int = 2,
    *,
    anchor_weights: npt.ArrayLike = 1.0,
    start: npt.ArrayLike | None = None,
    method: str = "multi-start",
    **options: bool | float,
) -> Embedding:
    """Metric multidimensional scaling: points whose distances are those given, in the sense of least weighted squares.

    Minimises the stress sum w_ij (d_ij - |x_i - x_j|)^2 over the known pairs (scikit-learn's MDS has the same for metric=True),
    plus sum w_i |x_i - a_i|^2 over the anchors.

    distances: (N, N), symmetric, >= 0; a pair that is NaN or masked is missing, and the diagonal is not read. Of a scipy.sparse
        matrix the stored entries are the known pairs; one triangle suffices, and entries given twice are summed.
        The names of a matrix of pandas become the result's `nodes`.
        Entries [i, j] and [j, i] may differ by a billionth, or by 8 units in the last place of the matrix's type: then their
        mean counts.
    weights: (N, N), symmetric, >= 0, as distances; a pair of 0, or masked, is missing. None: 1 for each known pair.
    anchors: (N, dim), known positions of nodes; rows of NaN (or masked) for nodes without one. A row that is known in part is a
        ValueError. None: the result is centred on the origin.
    anchor_weights: one for all anchors, or (N,); inf holds a node on its anchor exactly.
    dim: 2 or 3; other dimensions are a ValueError.
    start: (N, dim); None: classical scaling, in which a missing distance is that of the shortest path (over 500 nodes: from the
        distances to 200 of them, the pivots).
    method, options: as for solve. "multi-start" tries 32 starts up to 100 nodes, 8 up to 300 (its option `starts`, with `spread` 2
        here), and for more nodes two: classical scaling, and the best placement of a sample of 100 of them, about which the others
        are placed. "staircase" searches for the least stress from above and below.

    Parts that no known pair joins and no anchor holds are placed side by side: the result's `parts` counts them. ValueError names
    what is wrong with the input, such as distances of which none is known, without anchors. The stress may have several local
    minima: `gap` says what is proven of the one found.
    """
    _check_options("mds()", mds, method, options)
    _check_dim(dim, "; asterism.MDS takes 1 to 64 as n_components")
    pairs, lengths, n = _known_pairs(distances)
    if n == 0:
        raise ValueError("distances: expected those of one node or more, found shape (0, 0)")
    stiffness = _weights_of(weights, pairs, n)
    pairs, lengths, stiffness = pairs[stiffness > 0], lengths[stiffness > 0], stiffness[stiffness > 0]
    at, hold = _anchors_of(anchors, anchor_weights, n, dim)
    _check_any_known("distances", n, pairs, hold)
    given = None if start is None else inputs.array(start, "start", (n, dim))
    if given is not None and not np.isfinite(given).all():
        raise ValueError("start: expected finite numbers")
    return embed(Known(_names_of(distances) or list(range(n)), at, hold, given), pairs, lengths, stiffness, method, options)


def layout(
    graph: Any,
    dim: int = 2,
    *,
    power: float = 2.0,
    partners: int | None = None,
    anchors: npt.ArrayLike | None = None,
    anchor_weights: npt.ArrayLike = 1.0,
    start: npt.ArrayLike | None = None,
    method: str | None = None,
    length: str | None = "length",
    sizes: npt.ArrayLike | None = None,
    layers: npt.ArrayLike | None = None,
    downward: float | None = None,
    aligned: Iterable[tuple[str, Iterable[Any]]] | None = None,
    groups: Iterable[Iterable[Any]] | None = None,
    **options: bool | float,
) -> Embedding:
    """Draws a graph: nodes at distances near those along the graph (Kamada and Kawai 1989; Gansner, Koren and North 2004).

    The stress is that of mds for all pairs of nodes, with d_ij the length of the shortest path and w_ij = d_ij ** -power.
    Directions of edges are ignored. Components are placed side by side, by the method "sgd" in rows.

    graph: a list of edges, (a, b) or (a, b, length), or a table of pandas with such rows, between nodes of any names that can be keys of a
        dict; if all are integers, the nodes are 0 .. N - 1, with a warning for those that have no edge; numbers of which few are nodes are
        given as names (str). Or an adjacency matrix (N, N), of NumPy, scipy.sparse or pandas (with names), whose entries other than 0 are
        the lengths of edges (a masked one is not an edge). Or a graph of networkx.
    length: the attribute that is the length of an edge of networkx; edges without it, and all edges for None, have the length 1.
        There is a warning if the edges have a "weight" instead, which may be a length or a strength.
    method: None: "sgd" over 1000 nodes, otherwise "multi-start", which for 101 to 300 nodes also starts from the drawing by "sgd",
        unless `start` or `starts` is given. "sgd" is stochastic gradient descent (Zheng, Pawar and Goodman 2018) over pairs that
        are drawn in each iteration, with weights that make the stress of all pairs their expected value. It takes memory of N and
        time of N log N, finds shortest paths only between the pairs drawn, and ends with 0 to 6 % more stress than the other methods.
        Nothing is proven of its result, and its stress is an estimate: layout_stress gives the stress of all pairs. All other methods
        are those of mds, and take memory and time of N^2, unless `partners` is given.
    partners: a number k: a sparse stress, as a spring system for one of the methods of mds, by default "lbfgs-jacobi" with the
        tolerance 1e-6. Its pairs are the edges, and each node with k others of its component, drawn at random, whose weight is
        multiplied by the number of pairs that they stand for: its expected value is the stress of all pairs. It takes memory of
        k N; only the shortest paths take time of N times the number of nodes and edges. A component of at most 2 k + 1 nodes
        keeps all its pairs. The result's stress is the sparse one, of which nothing is proven.
    start: (N, dim). The result stays near it, which suits a graph whose earlier drawing is known and of which a few edges have changed.
    options: of "sgd" `seed` (1), `iterations` (60 up to 100,000 nodes, 20 for more) and `threads` (at most 4 are used; 0: as
        many as the machine runs at once; the result does not depend on it). Otherwise as for mds.
    dim, anchors, anchor_weights: as for mds.
    anchors, anchor_weights, start, sizes and layers may also be dicts from node to value, as networkx has them.

    Rules, which the drawing keeps to exactly, as it does to anchors of infinite weight. Without a start, the graph is first drawn freely;
    then the method "sgd" goes on, and moves apart what breaks a rule after each iteration. Nothing is proven of the result.
    sizes: (N, 2), the width and the height of each node's box, or (2,) for all: no two boxes overlap. Only in the plane.
    layers: (N,), the y of each node; NaN for those without a layer.
    downward: the end of each edge is below its beginning by at least this. Edges of a circle (of a strongly connected component) may have
        any direction.
    aligned: pairs of an axis, "x", "y" or "z", and nodes: these have the same x, or y, or z.
    groups: lists of nodes, which are kept together: the boxes that bound groups overlap neither each other nor other nodes' boxes. Only
        in the plane. To stay compact, each group has one more node in its middle while it is drawn, whose edges count in `stress`.
    ValueError if rules contradict each other, or no room is found between nodes that are held.

    The result's `nodes` are the graph's in the order of x; its `pos` is the dict from node to place that networkx.draw takes.
    """
    _check_dim(dim)
    nodes, edges, joined_nodes, joined_lengths = _graph_of(graph, length)
    n = len(nodes)
    if n == 0:
        raise ValueError("graph: it has no nodes")
    if method is None:
        method = "lbfgs-jacobi" if partners is not None else "sgd" if n > _MANY else "multi-start"
    power = inputs.number(power, "power")
    if not isinstance(method, str) or method != "sgd":
        _check_options("layout()", layout, method, options)
    anchors, anchor_weights = inputs.by_node(anchors, "anchors", nodes), inputs.by_node(anchor_weights, "anchor_weights", nodes)
    if isinstance(start, Mapping) and not start and nodes:
        raise ValueError("start: expected a place for each node, found an empty dict")
    if isinstance(sizes, Mapping) and sizes and (left := [node for node in nodes if node not in sizes]):
        raise ValueError(f"sizes: expected one for each node, found none for {inputs.shown(left[0])}")
    start, sizes, layers = (inputs.by_node(v, name, nodes) for v, name in ((start, "start"), (sizes, "sizes"), (layers, "layers")))
    given = None if start is None else inputs.array(start, "start", (n, dim))
    if given is not None and not np.isfinite(given).all():
        bad = int(np.flatnonzero(~np.isfinite(given).all(axis=1))[0])
        raise ValueError(f"start: expected finite numbers for all nodes, found {given[bad]} for {inputs.shown(nodes[bad])}")
    known = Known(nodes, *_anchors_of(anchors, anchor_weights, n, dim), given)
    if method == "sgd" and partners is not None:
        raise ValueError("partners: the method 'sgd' draws the pairs itself; give one of the two")
    if any(rule is not None for rule in (sizes, layers, downward, aligned, groups)):
        found = Rules(nodes, joined_nodes, dim, sizes, layers, downward, aligned, groups)
        return _ruled(found, known, joined_nodes, joined_lengths, power, method, partners, options)
    return _free(known, edges, power, method, partners, options)


def layout_stress(
    graph: Any, x: npt.ArrayLike, *, power: float = 2.0, scaled: bool = False, length: str | None = "length"
) -> float:
    """The stress of a drawing, also one of another program: that of layout, over all pairs of nodes that a path joins.

    graph, power, length: as for layout. x: (N, 2) or (N, 3), a row for each node, in the order of layout's `nodes`; or a dict from node
        to place, as networkx has it.
    scaled: of the drawing enlarged or shrunk to its least stress, for programs that draw in a unit of their own.

    Takes memory of N and time of N^2, twice that if scaled.
    """
    power, scaled = inputs.number(power, "power"), inputs.choice(scaled, "scaled", (True, False))
    nodes, edges, _, _ = _graph_of(graph, length)
    points = np.array(inputs.numbers(inputs.by_node(x, "x", nodes), "x"))
    if points.shape not in ((len(nodes), 2), (len(nodes), 3)):
        raise ValueError(f"x: expected shape {(len(nodes), 2)} or {(len(nodes), 3)}, found {points.shape}")
    if not np.isfinite(points).all():
        raise ValueError("x: expected finite numbers")
    if scaled and len(points):
        # Scaled first: the difference of sums that are much larger than the stress would be their rounding.
        points -= points.min(axis=0) / 2 + points.max(axis=0) / 2
        points /= np.abs(points).max() or 1.0
        _, product, square = edges.graph.stress_sums(points, power)
        points *= product / square if square > 0 else 1.0
    stress = float(edges.graph.stress_sums(points, power)[0])
    if not np.isfinite(stress):
        raise ValueError(f"x: coordinates of up to {np.abs(points).max():g}: another unit is needed, as the stress would leave the range of float64")
    return stress


def _path_weights(lengths: _Floats, power: float) -> _Floats:
    with np.errstate(over="ignore", under="ignore"):
        weights = lengths ** -float(power)
    if len(bad := np.flatnonzero(~((weights > 0) & np.isfinite(weights)))):
        raise ValueError(
            f"graph: a path of length {lengths[bad[0]]} has the weight {lengths[bad[0]]} ** {-float(power)}, which is out of range"
        )
    return weights


def _check_options(of: str, function: Callable[..., Any], method: str, options: dict[str, Any]) -> None:
    """TypeError for an option that neither the function nor the method has."""
    if not isinstance(method, str):
        raise TypeError(f"method: expected a name, found {inputs.shown(method)}")
    if function is layout and method.lower() == "sgd":
        raise ValueError(f"unknown method '{method}', did you mean 'sgd'?")
    own = [name for name, p in inspect.signature(function).parameters.items() if p.kind != p.VAR_KEYWORD]
    known = [*own, *(name for name in _asterism.Solver(method).options if name != "hold_floating"), "on_iteration"]
    for name in options:
        if name not in known:
            raise TypeError(names.no_option(of, name, known))


def _check_dim(dim: int, hint: str = "") -> None:
    try:
        found = operator.index(dim)
    except TypeError:
        raise TypeError(f"dim: expected an integer, found {inputs.shown(dim)}") from None
    if found not in (2, 3):
        raise ValueError(f"dim: expected 2 or 3, found {found}{hint}")


# What mds is given instead of a matrix of distances.
_NOT_DISTANCES = {
    1: "; SciPy's squareform makes a matrix of the distances that pdist returns",
    2: "; for points, use asterism.MDS().fit_transform(points)",
}


def _known_pairs(distances: Any, name: str = "distances") -> tuple[npt.NDArray[np.intp], _Floats, int]:
    if _is_networkx(distances):
        raise TypeError(f"{name}: expected a matrix (N, N), found {type(distances).__name__}; asterism.layout draws a graph")
    inputs.square(distances, name, _NOT_DISTANCES)
    pairs, lengths = inputs.pairs_of(distances, name, missing=np.nan)
    if not (known := ~np.isnan(lengths)).all():
        pairs, lengths = pairs[known], lengths[known]
    if len(bad := np.flatnonzero((lengths < 0) | np.isinf(lengths))):
        i, j = pairs[bad[0]]
        raise ValueError(f"{name}: [{i}, {j}] is {lengths[bad[0]]}; expected >= 0 and finite, or NaN for a missing pair")
    return pairs, lengths, inputs.square(distances, name)


def _weights_of(weights: Any, pairs: npt.NDArray[np.intp], n: int) -> _Floats:
    if weights is None:
        return np.ones(len(pairs))
    if (found := inputs.square(weights, "weights")) != n:
        raise ValueError(f"weights: expected shape {(n, n)}, found {(found, found)}")
    those, values = inputs.pairs_of(weights, "weights", missing=0)
    matrix = np.zeros((n, n))
    matrix[those[:, 0], those[:, 1]] = values
    result = matrix[pairs[:, 0], pairs[:, 1]]
    if len(bad := np.flatnonzero(~((result >= 0) & np.isfinite(result)))):
        i, j = pairs[bad[0]]
        raise ValueError(f"weights: [{i}, {j}] is {result[bad[0]]}; expected >= 0 and finite")
    return result


def _anchors_of(anchors: Any, anchor_weights: Any, n: int, dim: int) -> tuple[_Floats, _Floats]:
    """Anchors and their weights, both 0 for nodes without an anchor."""
    if anchors is None:
        return np.zeros((n, dim)), np.zeros(n)
    if isinstance(anchors, Mapping):  # layout has put those of its nodes in order
        raise TypeError(f"anchors: expected shape {(n, dim)}, with NaN in the rows of nodes without an anchor, found {type(anchors).__name__}")
    at = inputs.array(anchors, "anchors", (n, dim), missing=np.nan)
    there = ~np.isnan(at).all(axis=1)
    if len(bad := np.flatnonzero(there & ~np.isfinite(at).all(axis=1))):
        raise ValueError(
            f"anchors: row {bad[0]} is {at[bad[0]].tolist()}; expected finite numbers, or NaN in all of the row of a node without an anchor"
        )
    weights = inputs.numbers(anchor_weights, "anchor_weights", missing=np.nan)
    if weights.shape not in ((), (1,), (n,)):
        raise ValueError(f"anchor_weights: expected a number or shape {(n,)}, found {weights.shape}")
    hold = np.where(there, weights, 0)
    if not (hold >= 0).all():
        raise ValueError("anchor_weights: expected >= 0")
    at[~there] = 0
    return at, hold


def _check_any_known(name: str, n: int, pairs: npt.NDArray[np.intp], hold: _Floats) -> None:
    """ValueError if nothing is known of the nodes: any placement would be the least."""
    if n > 1 and not len(pairs) and not (hold > 0).any():
        raise ValueError(f"{name}: no distance is known: every pair of the {n} nodes is missing or has the weight 0")


def _parts(components: list[_Indices], hold: _Floats) -> int:
    is_held = _any_of_each(hold > 0, components)
    return int(np.sum(~is_held)) + bool(is_held.any())


def _check_range(lengths: _Floats, weights: _Floats, at: _Floats, hold: _Floats) -> None:
    """ValueError if squares of the lengths and anchors, or the digits of the stress, would leave the range of float64."""
    of_anchors = np.where(np.isinf(hold), 1, hold)[:, None]
    with np.errstate(over="ignore", under="ignore"):
        of_pairs = float(np.sum(weights * lengths**2))
        total = of_pairs + float(np.sum(of_anchors * at**2))
    if total < 1e300 and (of_pairs > 1e-280 or not ((weights > 0) & (lengths > 0)).any()):
        return
    largest = max(lengths.max(initial=0), np.abs(at).max(initial=0))
    raise ValueError(
        f"lengths of up to {largest} and weights of up to {max(weights.max(initial=0), of_anchors.max(initial=0))}: another unit is "
        "needed, as the stress would leave the range of float64"
    )


def _graph_of(graph: Any, length: str | None) -> tuple[list[Any], _Edges, npt.NDArray[np.intp], _Floats]:
    """The nodes and the graph; also the edges' ends and their lengths."""
    nodes, pairs, lengths = _edges_of(graph, length)
    return nodes, _edges_with(len(nodes), pairs, lengths), pairs, lengths


def _edges_with(n: int, pairs: npt.NDArray[np.intp], lengths: _Floats) -> _Edges:
    graph = _asterism._Graph(n, pairs.astype(np.int64), lengths)
    return _Edges(graph, _components(graph), float(lengths.max(initial=0)) or 1.0)


def _is_networkx(graph: Any) -> bool:
    return hasattr(graph, "nodes") and callable(getattr(graph, "edges", None))


def _names_of(table: Any) -> list[Any] | None:
    """Of the rows of a matrix of pandas, where its columns have the same names."""
    if not hasattr(table, "columns") or not hasattr(table, "itertuples"):
        return None
    names = list(table.columns)
    is_same = len(table.index) == len(names) and all(row == column for row, column in zip(table.index, names))
    if is_same and names == list(range(len(names))):  # of no names, such as edges that were read without a header
        values = np.asarray(table)
        is_same = not np.diagonal(values).any() and bool((values == values.T).all())
    return names if is_same and len(set(names)) == len(names) else None


def _edges_of(graph: Any, length: str | None) -> tuple[list[Any], npt.NDArray[np.intp], _Floats]:
    """Nodes, edges and their lengths; loops are dropped, and several edges may join the same two nodes."""
    names = _names_of(graph)
    if names is not None:
        graph = np.asarray(graph)
    elif hasattr(graph, "itertuples"):  # a table of pandas with an edge in each row
        graph = list(graph.itertuples(index=False, name=None))
    if _is_networkx(graph):
        nodes = list(graph.nodes)
        index = {node: k for k, node in enumerate(nodes)}
        edges = list(graph.edges(data="length" if length is None else length))
        pairs = np.array([(index[a], index[b]) for a, b, _ in edges], dtype=np.intp).reshape(-1, 2)
        given = [None if length is None else value for *_, value in edges]
        lengths = inputs.numbers([1 if value is None else value for value in given], f"graph: the edges' {length!r}", (len(pairs),))
        if length not in (None, "length") and edges and all(value is None for value in given):
            there = sorted({str(name) for *_, attributes in graph.edges(data=True) for name in attributes})
            raise ValueError(f"length: no edge has the attribute {length!r} (they have: {', '.join(there) or 'none'})")
        if length == "length" and all(value is None for value in given) and any(w is not None for *_, w in graph.edges(data="weight")):
            warnings.warn(
                "graph: the edges have a 'weight' and no 'length', so each has the length 1; if their weights are lengths, "
                "give length='weight', otherwise length=None",
                stacklevel=4,
            )
    elif inputs.is_sparse(graph) or isinstance(graph, np.ndarray):
        n = inputs.square(graph, "graph: an adjacency matrix (give edges as a list, such as graph.tolist())")
        nodes = list(range(n)) if names is None else names
        if inputs.is_sparse(graph):
            row, column, lengths = inputs.entries(graph, "graph")
            pairs = np.column_stack([row, column])
        else:
            matrix = inputs.numbers(graph, "graph", (n, n), missing=0)
            if n == 2 and np.diagonal(matrix).any() and names is None:  # two edges, more probably than two nodes with loops
                raise ValueError("graph: an array of shape (2, 2) is an adjacency matrix, whose diagonal has to be 0; give edges as a list, such as graph.tolist()")
            pairs = np.argwhere(matrix != 0)
            lengths = matrix[pairs[:, 0], pairs[:, 1]]
        pairs, lengths = pairs[lengths != 0], lengths[lengths != 0]
    else:
        nodes, pairs, lengths = _edges_of_list(graph)
    if len(bad := np.flatnonzero(~((lengths > 0) & np.isfinite(lengths)))):
        i, j = pairs[bad[0]]
        raise ValueError(f"graph: edge ({nodes[i]}, {nodes[j]}) has length {lengths[bad[0]]}; expected > 0 and finite")
    off = pairs[:, 0] != pairs[:, 1]
    return nodes, pairs[off], lengths[off]


def _edges_of_list(graph: Iterable[Sequence[Any]]) -> tuple[list[Any], npt.NDArray[np.intp], _Floats]:
    is_edges = type(graph).__name__.endswith("EdgeView")  # G.edges of networkx, which is a mapping
    if isinstance(graph, (str, bytes)) or (isinstance(graph, Mapping) and not is_edges) or not isinstance(graph, Iterable):
        hint = "; networkx.Graph makes a graph of a dict of neighbours" if isinstance(graph, Mapping) else ""
        raise TypeError(f"graph: expected a list of edges, an adjacency matrix or a graph of networkx, found {type(graph).__name__}{hint}")
    ends, lengths = [], []
    for k, edge in enumerate(graph):
        if isinstance(edge, str) or not hasattr(edge, "__len__") or len(edge) not in (2, 3):
            raise TypeError(f"graph: edge {k} is {inputs.shown(edge)}; expected (a, b) or (a, b, length)")
        if len(edge) == 3 and isinstance(edge[2], Mapping):
            raise TypeError(f"graph: edge {k} has the length {inputs.shown(edge[2])}; expected a number, or give the graph of networkx itself")
        for node in edge[:2]:
            if isinstance(node, (float, np.floating)) or getattr(node, "__hash__", None) is None:
                raise TypeError(f"graph: edge {k} has node {inputs.shown(node)}; expected an integer or a name, which can be a key of a dict")
        ends += edge[:2]
        lengths.append(edge[2] if len(edge) == 3 else 1.0)
    values = inputs.numbers(lengths, "graph: the edges' lengths", (len(lengths),))
    if not all(hasattr(node, "__index__") for node in ends):
        nodes = list(dict.fromkeys(ends))
        index = {node: k for k, node in enumerate(nodes)}
        return nodes, np.array([index[node] for node in ends], dtype=np.intp).reshape(-1, 2), values
    numbers = [operator.index(node) for node in ends]
    if numbers and max(numbers) >= 2**31:
        raise ValueError(f"graph: node {max(numbers)}: integers are the nodes 0 .. N - 1; give numbers that only identify nodes as names (str)")
    pairs = np.array(numbers, dtype=np.intp).reshape(-1, 2)
    if len(pairs) and pairs.min() < 0:
        raise ValueError(f"graph: edge {int(pairs.min(axis=1).argmin())} has node {pairs.min()}; expected >= 0")
    n = int(pairs.max()) + 1 if len(pairs) else 0
    if n > 1_000_000 and n > 100 * (found := len(np.unique(pairs))):
        raise ValueError(f"graph: {found} of the nodes 0 to {n - 1} have an edge; give numbers that only identify nodes as names (str)")
    if len(alone := np.setdiff1d(np.arange(n), pairs)):
        warnings.warn(
            f"graph: {len(alone)} of the nodes 0 to {n - 1} have no edge, such as {alone[0]}; to leave them out, give the nodes names (str)",
            stacklevel=5,
        )
    return list(range(n)), pairs, values


def _components(graph: _asterism._Graph) -> list[npt.NDArray[np.intp]]:
    """The nodes of each component, in the order of their first nodes."""
    of = graph.components()
    return np.split(np.argsort(of, kind="stable"), np.cumsum(np.bincount(of))[:-1]) if len(of) else []


def _pivots(distances: _Distances, nodes: _Indices, count: int) -> _Floats:
    """Distances (K, N) from pivots of a component, each the farthest node from those before it (Gonzalez 1985), to its nodes."""
    pivot, rows = nodes[0], np.empty((count, len(nodes)))
    nearest = np.full(len(nodes), np.inf)
    for row in rows:
        row[:] = distances(np.array([[pivot]]), nodes[None])[0, 0]
        np.minimum(nearest, row, out=nearest)
        pivot = nodes[nearest.argmax()]
    return rows


def _scaled_by_pivots(distances: _Floats, dim: int) -> _Floats:
    """Classical scaling from the distances (K, N) of K pivots to all nodes (Brandes and Pich 2006)."""
    squares = distances.T**2
    means = squares.mean(axis=0)
    centred = -0.5 * (squares - means - squares.mean(axis=1)[:, None] + means.mean())
    values, vectors = np.linalg.eigh(centred.T @ centred)
    values, vectors = np.sqrt(np.maximum(values[::-1][:dim], 0)), vectors[:, ::-1][:, :dim]
    share = np.sqrt(squares.shape[0] / squares.shape[1])
    x = centred @ vectors * np.sqrt(share / np.maximum(values, np.finfo(float).tiny))
    return _not_flat(x, np.sqrt(means.mean()))


def _not_flat(x: _Floats, size: float) -> _Floats:
    """Coordinates of x (..., N, dim) that would be flat get a little noise, so that nodes can leave a line or plane."""
    size = np.asarray(size)[..., None, None]
    noise = 1e-3 * size * np.random.default_rng(0).normal(size=x.shape[-2:])
    return np.where(np.ptp(x, axis=-2, keepdims=True) < 1e-3 * size, noise, x)


def _classical(distances: _Floats, dim: int) -> _Floats:
    """Torgerson's scaling, (C, N, dim), of C components of as many nodes, from their distances (C, N, N)."""
    squares = distances**2
    means = squares.mean(axis=-1)
    mean = means.mean(axis=-1)
    squares -= means[:, None]
    squares -= means[..., None] - mean[:, None, None]
    squares *= -0.5
    x = np.zeros((*means.shape, dim))
    kept = min(x.shape[1], dim)
    values, vectors = _leading(squares, kept)
    x[..., :kept] = vectors * np.sqrt(np.maximum(values[:, None], 0))
    return _not_flat(x, np.sqrt(mean))


def _leading(matrices: _Floats, count: int) -> tuple[_Floats, _Floats]:
    """The largest eigenvalues of symmetric matrices (C, N, N), (C, count), and their vectors, (C, N, count): of large ones nearly,
    by Lanczos's method (1950) from a random vector."""
    n, steps = matrices.shape[-1], 20 + 2 * count
    if n < 5 * steps:
        values, vectors = np.linalg.eigh(matrices)
        return values[:, : -count - 1 : -1], vectors[..., : -count - 1 : -1]
    found = [_largest_ritz(matrix, count, steps) for matrix in matrices]
    return np.array([values for values, _ in found]), np.array([vectors for _, vectors in found])


def _largest_ritz(matrix: _Floats, count: int, steps: int) -> tuple[_Floats, _Floats]:
    random = np.random.default_rng(0)
    basis, images = np.empty((2, steps, len(matrix)))

    def across(v: _Floats, k: int) -> _Floats:  # to basis[:k]; twice, as the first time leaves rounding
        for _ in range(2):
            v = v - (basis[:k] @ v) @ basis[:k]
        return v

    v = random.normal(size=len(matrix))
    for k in range(steps):
        basis[k] = v / np.linalg.norm(v)
        images[k] = matrix @ basis[k]
        v = across(images[k], k + 1)
        if np.linalg.norm(v) <= 1e-10 * np.linalg.norm(images[k]):  # the basis spans what the matrix makes of it
            v = across(random.normal(size=len(matrix)), k + 1)
    values, vectors = np.linalg.eigh(basis @ images.T)
    return values[: -count - 1 : -1], (vectors.T @ basis)[: -count - 1 : -1].T


def _symmetric(n: int, pairs: npt.NDArray[np.intp], values: _Floats) -> _Floats:
    matrix = np.zeros((n, n))
    matrix[pairs[:, 0], pairs[:, 1]] = matrix[pairs[:, 1], pairs[:, 0]] = values
    return matrix


def joined(n: int, pairs: npt.NDArray[np.intp], lengths: _Floats) -> tuple[list[_Indices], _Distances]:
    """The components of the pairs, and the distances: those given, where all pairs are; else those along the shortest paths."""
    if 2 * len(pairs) < n * (n - 1):
        graph = _asterism._Graph(n, pairs.astype(np.int64), lengths)
        return _components(graph), graph.distances
    matrix = _symmetric(n, pairs, lengths)
    return [np.arange(n)], lambda sources, targets: matrix[sources[:, :, None], targets[:, None, :]]


def _to_anchors(x: _Floats, at: _Floats, weights: _Floats) -> _Floats:
    """x moved, turned and mirrored to be nearest to the anchors (Kabsch 1976)."""
    weights = np.where(np.isinf(weights), max(weights[np.isfinite(weights)].max(initial=0), 1) * 1e3, weights)
    weights = weights / weights.sum()
    here, there = weights @ x, weights @ at
    u, _, v = np.linalg.svd((x - here).T @ (weights[:, None] * (at - there)))
    return (x - here) @ (u @ v) + there


def _start(distances: _Distances, components: list[_Indices], at: _Floats, hold: _Floats, dim: int) -> _Floats:
    x = np.zeros((len(at), dim))
    of_size: dict[int, list[_Indices]] = {}
    for nodes in components:
        of_size.setdefault(len(nodes), []).append(nodes)
    for size, alike in of_size.items():
        if size > 500:
            for nodes in alike:
                x[nodes] = _scaled_by_pivots(_pivots(distances, nodes, 200), dim)
            continue
        at_once = max(4_000_000 // size**2, 1)  # 32 MB of distances
        for k in range(0, len(alike) if size > 1 else 0, at_once):
            several = np.stack(alike[k : k + at_once])
            x[several] = _classical(distances(several, several), dim)
    for nodes, is_held in zip(components, _any_of_each(hold > 0, components)):
        if is_held:
            x[nodes] = _to_anchors(x[nodes], at[nodes], hold[nodes])
    return x


def starts_by_default(n: int) -> int:
    """How many starts find, nearly always, no more stress than many."""
    return 32 if n <= _FEW else 8 if n <= _SAMPLED else 1


def sampled_starts(
    distances: _Distances,
    pairs: npt.NDArray[np.intp],
    of_pairs: _Floats,
    x: _Floats,
    components: list[_Indices],
    at: _Floats,
    hold: _Floats,
    seed: int,
) -> list[_Floats]:
    """x with each component of over 300 nodes placed about 100 of them, which are solved from 8 starts; none without such a component.

    A large map has the minima of a small one, which can be searched (as for a graph's coarser graphs; Walshaw 2001).
    of_pairs: the pairs' weights, which count where no pair is missing.
    """
    large = [nodes for nodes in components if len(nodes) > _SAMPLED]
    if not large:
        return []
    n, dim = x.shape
    is_weighted = 2 * len(pairs) == n * (n - 1) and np.ptp(of_pairs) > 0
    weights = _symmetric(n, pairs, of_pairs) if is_weighted else None
    x = x.copy()
    for nodes in large:
        sample = np.random.default_rng(seed).choice(nodes, 100, replace=False)
        to_all = distances(sample[None], nodes[None])[0]
        place = np.empty(len(x), dtype=np.intp)
        place[nodes] = np.arange(len(nodes))
        among = to_all[:, place[sample]]
        i, j = np.triu_indices(len(sample), 1)
        system = _asterism.System(len(sample), dim=dim)
        system.add_links(np.column_stack([i, j]), among[i, j], 1.0 if weights is None else weights[sample[i], sample[j]])
        held = _classical(among[None], dim)[0]
        system.solve(held, "multi-start", starts=8, spread=2.0, seed=seed, hold_floating=True, tolerance=1e-3)  # a start needs no more
        shares = np.ones((1, len(sample))) if weights is None else weights[np.ix_(nodes, sample)]
        x[nodes] = _asterism._place(held, np.ascontiguousarray(to_all.T), shares, np.empty((0, dim)), 1)
        if (hold[nodes] > 0).any():
            x[nodes] = _to_anchors(x[nodes], at[nodes], hold[nodes])
    return [x]


def proven_gap(stress: float, lower_bound: float, rounding: float) -> float:
    """How much less stress there may be, as a share of the stress; NaN if nothing is proven."""
    if lower_bound == 0 and stress > rounding:
        return np.nan  # no stress is below 0, which is no news
    return (stress - lower_bound) / scale if (scale := max(stress, rounding)) > 0 else 0.0


def lengths_of(x: _Floats, pairs: npt.NDArray[Any]) -> _Floats:
    """How long the pairs are at x."""
    return np.linalg.norm(x[pairs[:, 0]] - x[pairs[:, 1]], axis=1)


def rounding_of(x: _Floats, pairs: npt.NDArray[Any], lengths: _Floats, weights: _Floats) -> float:
    """Stress that is taken for rounding."""
    return 1e-10 * float(np.sum(weights * (lengths + lengths_of(x, pairs)) ** 2))


def _firsts(components: list[_Indices]) -> _Indices:
    """The beginning of each component in their concatenation."""
    return np.cumsum([0] + [len(nodes) for nodes in components[:-1]])


def _any_of_each(values: npt.NDArray[np.bool_], components: list[_Indices]) -> npt.NDArray[np.bool_]:
    return np.logical_or.reduceat(values[np.concatenate(components)], _firsts(components))


def _bounds(x: _Floats, components: list[_Indices]) -> tuple[_Floats, _Floats]:
    """The least and the largest coordinates of each component, (C, dim)."""
    ordered, firsts = x[np.concatenate(components)], _firsts(components)
    return np.minimum.reduceat(ordered, firsts), np.maximum.reduceat(ordered, firsts)


def _centred(x: _Floats, components: list[_Indices], hold: _Floats) -> _Floats:
    """x with each component without an anchor around the origin, so that coordinates are not rounded more than they need to be."""
    least, largest = _bounds(x, components)
    centres = np.where(_any_of_each(hold > 0, components)[:, None], 0.0, least / 2 + largest / 2)
    sizes = [len(nodes) for nodes in components]
    result = x.copy()
    result[np.concatenate(components)] -= np.repeat(centres, sizes, axis=0)
    return result


def _side_by_side(x: _Floats, components: list[_Indices], hold: _Floats) -> _Floats:
    """x with the components without an anchor in a row, right of those with one; centred on the origin if there is no anchor."""
    is_held = _any_of_each(hold > 0, components)
    free = [nodes for nodes, held in zip(components, is_held) if not held]
    held = np.flatnonzero(~np.isin(np.arange(len(x)), np.concatenate(free))) if free else []
    if not free or (len(free) == 1 and not len(held)):
        return x - x.mean(axis=0) if free else x
    x = x.copy()
    least, largest = _bounds(x, components)
    margin = float(0.1 * (largest - least).max()) or 1.0
    right, middle = (x[held, 0].max() + margin, x[held, 1:].mean(axis=0)) if len(held) else (0.0, np.zeros(x.shape[1] - 1))
    free = sorted(free, key=len, reverse=True)
    order, firsts, sizes = np.concatenate(free), _firsts(free), np.array([len(nodes) for nodes in free])
    least, largest = _bounds(x, free)
    widths = largest[:, 0] - least[:, 0] + margin
    shifts = np.empty((len(free), x.shape[1]))
    shifts[:, 0] = right + np.cumsum(widths) - widths - least[:, 0]
    shifts[:, 1:] = middle - np.add.reduceat(x[order, 1:], firsts) / sizes[:, None]
    x[order] += np.repeat(shifts, sizes, axis=0)
    return x if len(held) else x - x.mean(axis=0)


def _in_rows(x: _Floats, components: list[_Indices], hold: _Floats, unit: float) -> _Floats:
    """x with the components without an anchor in rows, right of those with one; centred on the origin if there is no anchor."""
    is_held = _any_of_each(hold > 0, components)
    free = sorted((nodes for nodes, held in zip(components, is_held) if not held), key=len, reverse=True)
    if not free or len(components) == 1:
        return x - x.mean(axis=0) if free else x
    x = x.copy()
    held = np.concatenate([nodes for nodes, is_one in zip(components, is_held) if is_one]) if is_held.any() else None
    least, largest = _bounds(x, free)
    extents = largest - least
    room = extents[:, :2] + np.maximum(unit, 0.1 * extents[:, :2].max(axis=1))[:, None]
    row_length = max(float(np.sqrt(room.prod(axis=1).sum())), float(room[:, 0].max()))
    corners, across, up, height = np.empty((len(free), 2)), 0.0, 0.0, 0.0
    for k, (wide, high) in enumerate(room.tolist()):
        if across > 0 and across + wide > row_length * (1 + 1e-9):
            across, up, height = 0.0, up + height, 0.0
        corners[k] = across, up
        across, height = across + wide, max(height, high)
    shifts = np.zeros((len(free), x.shape[1]))
    shifts[:, :2] = corners - least[:, :2]
    shifts[:, 2:] = -0.5 * (least[:, 2:] + largest[:, 2:])
    if held is not None:
        shifts[:, 0] += x[held, 0].max() + max(unit, 0.1 * float(np.ptp(x[held], axis=0).max()))
        shifts[:, 1] += x[held, 1].min()
        shifts[:, 2:] += x[held, 2:].mean(axis=0)
    x[np.concatenate(free)] += np.repeat(shifts, [len(nodes) for nodes in free], axis=0)
    return x if held is not None else x - x.mean(axis=0)


def _draw(
    known: Known, edges: _Edges, power: float, rules: _asterism._Rules | None = None, is_refining: bool | None = None, **options: Any
) -> Embedding:
    """layout's method "sgd". is_refining: by default if a start is given."""
    nodes, at, hold = known.nodes, known.at, known.hold
    if not nodes:
        raise ValueError("there are no nodes")
    own = {"seed": (1, 0), "iterations": (0, 1), "threads": (0, 0)}  # by default and at least
    if unknown := [name for name in options if name not in own]:
        raise TypeError(names.no_option(f"method 'sgd' (the default over {_MANY} nodes)", unknown[0], list(own)))
    values = {name: inputs.count(options[name], name, least) if name in options else default for name, (default, least) in own.items()}
    _check_range(np.empty(0), np.empty(0), at, hold)
    if known.start is None:
        x = edges.graph.pivot_start(at.shape[1])
        for those, is_held in zip(edges.components, _any_of_each(hold > 0, edges.components)):
            if is_held:
                x[those] = _to_anchors(x[those], at[those], hold[those])
    else:
        x = known.start.copy()
    exact = np.isinf(hold)
    x[exact] = at[exact]
    values["is_refining"] = known.start is not None if is_refining is None else is_refining
    x, summary = edges.graph.draw(x, at, hold, power, **values, **({} if rules is None else {"rules": rules}))
    if summary.status == _asterism.Status.OUT_OF_MEMORY:
        raise MemoryError(f"{summary.solver}: {summary.message}")
    if not summary:
        raise ValueError(f"{summary.solver}: {names.with_value(summary.message, None, None, options)}")
    stress = 2 * summary.final_energy
    if not (np.isfinite(stress) and np.isfinite(x).all()):
        raise ValueError(f"lengths of up to {edges.unit}: another unit is needed, as the stress would leave the range of float64")
    x = _in_rows(x, edges.components, hold, edges.unit) if rules is None else x
    return Embedding(x, stress, 0.0, np.nan, None, summary, None, nodes, _parts(edges.components, hold))


def _free(known: Known, edges: _Edges, power: float, method: str, partners: int | None, options: dict[str, Any]) -> Embedding:
    """layout without rules."""
    if method == "sgd":
        return _draw(known, edges, power, **options)
    if partners is None:
        pairs, lengths = edges.graph.pairs(sum(len(c) * (len(c) - 1) // 2 for c in edges.components))
        weights = _path_weights(lengths, power)
    else:
        options = {"tolerance": 1e-6, **options}  # below it only long paths change, and take five times as long
        pairs, lengths, shares = edges.graph.partners(inputs.count(partners, "partners"), 1)
        weights = shares * _path_weights(lengths, power)
    is_default = method == "multi-start" and partners is None and known.start is None and "starts" not in options
    drawn = [_draw(known, edges, power).x] if is_default and _FEW < len(known.nodes) <= _SAMPLED else []
    # A proof of the sparse stress would take longer than the drawing.
    return embed(known, pairs, lengths, weights, method, options, edges, prove=partners is None, drawn=drawn)


def _ruled(
    rules: Rules,
    known: Known,
    pairs: npt.NDArray[np.intp],
    lengths: _Floats,
    power: float,
    method: str,
    partners: int | None,
    options: dict[str, Any],
) -> Embedding:
    """layout with rules: the drawing without them, or the start given, and from there by the method "sgd" with them."""
    at, hold, x = known.at, known.hold, known.start
    n, dim = at.shape
    edges = _edges_with(n, pairs, lengths)
    unit = edges.unit
    hubs = int(rules.groups.max(initial=-1)) + 1
    native = rules.native(at, hold, hubs)
    if hubs:
        more, radii = rules.hubs(float(np.median(lengths)) if len(lengths) else 1.0)
        edges = dataclasses.replace(_edges_with(n + hubs, np.concatenate([pairs, more]), np.concatenate([lengths, radii])), unit=unit)
        at, hold = np.concatenate([at, np.zeros((hubs, dim))]), np.concatenate([hold, np.zeros(hubs)])
        if x is not None:
            x = np.concatenate([x, [(x[those] if (those := rules.groups == k).any() else x).mean(axis=0) for k in range(hubs)]])
    everyone = Known(list(range(n + hubs)), at, hold)
    is_given, is_held = x is not None, bool((hold > 0).any())
    if x is None:
        x = _free(everyone, edges, power, method, partners, options).x
        if rules.have_heights and not is_held:
            x = rules.turned(x)
    in_a_row = rules.have_heights and not is_held and not hubs and not rules.is_aligned[0]
    if in_a_row and not is_given:
        x = rules.in_a_row(x, edges.components, unit)
    is_refining = is_given or not rules.have_heights
    of_sgd = options if method == "sgd" else {}
    found = _draw(dataclasses.replace(everyone, start=x), edges, power, native, is_refining, **of_sgd)
    x = found.x[:n]
    if in_a_row:
        x = rules.in_a_row(x, edges.components, unit)
    if not is_held:
        middle = x.mean(axis=0)
        middle[1] = 0 if (~np.isnan(rules.layers)).any() else middle[1]
        x = x - middle
    return dataclasses.replace(found, x=x, nodes=known.nodes)


def embed(
    known: Known,
    pairs: npt.NDArray[np.intp],
    lengths: _Floats,
    weights: _Floats,
    method: str,
    options: dict[str, Any],
    edges: _Edges | None = None,
    prove: bool = True,
    drawn: Sequence[_Floats] = (),
) -> Embedding:
    """edges: for the start; by default the pairs, with their lengths. drawn: further starts, near a minimum."""
    (n, dim), at, hold = known.at.shape, known.at, known.hold
    if n == 0:
        raise ValueError("there are no nodes")
    system = _asterism.SpringSystem(_asterism.Topology.from_links(n, pairs), dim)
    _check_range(lengths, weights, at, hold)
    exact = np.isinf(hold)
    system.anchors = at
    system.anchor_stiffness = np.where(exact, 0, hold)
    system.rest_length = lengths
    system.link_stiffness = weights
    for node in np.flatnonzero(exact):
        system.fix(int(node))
    components, distances = (edges.components, edges.graph.distances) if edges else joined(n, pairs, lengths)
    start = known.start
    x = _start(distances, components, at, hold, dim) if start is None else _centred(start, components, hold)
    starts = [x]
    if method == "multi-start":
        if start is None and "starts" not in options:
            seed = options.get("seed", 1)
            seed = int(seed) if isinstance(seed, (int, np.integer)) and 0 <= seed < 2**63 else 1  # the method refuses others
            starts += sampled_starts(distances, pairs, weights, x, components, at, hold, seed)
        options = {"starts": starts_by_default(n), "spread": 2.0, **options}
    solved = []
    for x, how in [(x, options) for x in starts] + [(x, {**options, "starts": 1}) for x in drawn]:
        x[exact] = at[exact]
        summary = _asterism.solve(system, x, method, hold_floating=True, **how)
        if not summary:
            raise ValueError(names.with_value(summary.message, None, None, options))
        solved.append((summary, x))
    summary, x = min(solved, key=lambda each: each[0].final_energy)
    x = _side_by_side(x, components, hold)
    certificate = _asterism.certify(system, x) if prove else None
    stress = 2 * _asterism.energy(system, x)
    lower_bound = min(float(np.nanmax([2 * certificate.lower_bound if certificate else 0.0, 2 * summary.lower_bound, 0.0])), stress)
    gap = proven_gap(stress, lower_bound, rounding_of(x, system.topology.links, lengths, weights))
    return Embedding(x, stress, lower_bound, gap, certificate, summary, system, known.nodes, _parts(components, hold))
