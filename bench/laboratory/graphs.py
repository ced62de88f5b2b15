"""Ten kinds of connected random graphs with a fifth more edges than nodes, of any number of nodes; see layouts.py --made."""

from collections.abc import Callable

import numpy as np
import scipy.sparse
import scipy.sparse.csgraph
import scipy.spatial

Pairs = np.ndarray  # edges x 2
Rng = np.random.Generator


def connected(rng: Rng, pairs: Pairs, n: int) -> Pairs:
    """A spanning tree of edges in random order, and more of them up to 1.2 n; of the largest component."""
    weights = rng.permutation(len(pairs)) + 1.0
    graph = scipy.sparse.csr_matrix((weights, pairs.T), shape=(n, n))
    tree = scipy.sparse.csgraph.minimum_spanning_tree(graph).tocoo()
    in_tree = np.zeros(len(pairs) + 1, bool)
    in_tree[tree.data.astype(int)] = True
    others = pairs[~in_tree[weights.astype(int)]]
    more = rng.permutation(len(others))[: max(0, int(1.2 * n) - len(tree.data))]
    return largest(np.vstack([np.column_stack([tree.row, tree.col]), others[more]]), n)


def largest(pairs: Pairs, n: int) -> Pairs:
    """The largest component, its nodes numbered from 0."""
    _, label = scipy.sparse.csgraph.connected_components(scipy.sparse.coo_matrix((np.ones(len(pairs)), pairs.T), shape=(n, n)), directed=False)
    inside = label == np.bincount(label).argmax()
    place = np.cumsum(inside) - 1
    return place[pairs[inside[pairs[:, 0]]]]


def simple(pairs: Pairs) -> Pairs:
    """Without loops and repeated edges."""
    pairs = np.sort(pairs[pairs[:, 0] != pairs[:, 1]], axis=1)
    return np.unique(pairs, axis=0)


def lattice(sides: tuple[int, ...], wound: int = 0) -> Pairs:
    """Of neighbours in a grid; the first `wound` axes are rings."""
    at = np.arange(np.prod(sides)).reshape(sides)
    found = []
    for axis in range(len(sides)):
        to = np.roll(at, -1, axis)
        keep = slice(None) if axis < wound else slice(sides[axis] - 1)
        picked = [np.take(a, np.arange(sides[axis])[keep], axis).ravel() for a in (at, to)]
        found.append(np.column_stack(picked))
    return np.vstack(found)


def grid(rng: Rng, n: int) -> Pairs:
    side = int(np.sqrt(n))
    return connected(rng, lattice((side, side)), side * side)


def cylinder(rng: Rng, n: int) -> Pairs:
    around = int(np.sqrt(n / 4))
    return connected(rng, lattice((around, n // around), 1), around * (n // around))


def cube(rng: Rng, n: int) -> Pairs:
    side = round(n ** (1 / 3))
    return connected(rng, lattice((side,) * 3), side**3)


def with_chords(rng: Rng, tree: Pairs, n: int) -> Pairs:
    return simple(np.vstack([tree, rng.integers(n, size=(int(1.2 * n) - len(tree), 2))]))


def recursive_tree(rng: Rng, n: int) -> Pairs:
    """Each node hangs on any earlier one; chords between any nodes."""
    children = np.arange(1, n)
    return with_chords(rng, np.column_stack([children, (rng.random(n - 1) * children).astype(int)]), n)


def binary_tree(rng: Rng, n: int) -> Pairs:
    """Complete; chords to the node beside, of the same level as a rule."""
    children = np.arange(1, n)
    beside = rng.choice(n - 1, n // 5, replace=False)
    return simple(np.vstack([np.column_stack([children, (children - 1) // 2]), np.column_stack([beside, beside + 1])]))


def preferential(rng: Rng, n: int) -> Pairs:
    """By Barabasi and Albert: a node hangs on the end of an earlier edge; a fifth of the nodes on two."""
    second = rng.random(n) < 0.2
    count = np.where(second, 2, 1)
    count[:2] = 0, 1
    ends = np.repeat(np.arange(n), count)
    chosen = np.zeros(len(ends), int)
    picks = rng.random(len(ends))
    first = np.concatenate([[0], np.cumsum(count)])[ends]  # edges before those of this node
    for e in range(1, len(ends)):  # an end of an earlier edge: the newer or the older node
        k = int(picks[e] * 2 * first[e])
        chosen[e] = ends[k // 2] if k % 2 else chosen[k // 2]
    return simple(np.column_stack([ends, chosen]))


def uniform(rng: Rng, n: int) -> Pairs:
    """By Erdos and Renyi, with 2.4 edges at a node; the largest component."""
    return largest(simple(rng.integers(n, size=(int(1.2 * n), 2))), n)


def geometric(rng: Rng, n: int) -> Pairs:
    """Points of the plane and their six nearest."""
    points = rng.random((n, 2))
    near = scipy.spatial.cKDTree(points).query(points, 7)[1][:, 1:]
    return connected(rng, simple(np.column_stack([np.repeat(np.arange(n), 6), near.ravel()])), n)


def small_world(rng: Rng, n: int) -> Pairs:
    """A ring, and chords between any nodes."""
    return with_chords(rng, np.column_stack([np.arange(n), np.roll(np.arange(n), -1)]), n)


def communities(rng: Rng, n: int) -> Pairs:
    """Trees of about 100 nodes with chords within, joined by a tree of them and a few more edges."""
    size = 100
    groups = n // size
    n = groups * size
    child = np.arange(n)
    child = child[child % size > 0]
    group = child // size * size
    tree = np.column_stack([child, group + (rng.random(len(child)) * (child - group)).astype(int)])
    within = rng.integers(n, size=n // 5)
    chords = np.column_stack([within, within // size * size + rng.integers(size, size=len(within))])
    later = np.arange(1, groups)
    between = np.column_stack([later, (rng.random(groups - 1) * later).astype(int)])
    between = np.vstack([between, rng.integers(groups, size=(groups // 5, 2))])
    return simple(np.vstack([tree, chords, between * size + rng.integers(size, size=between.shape)]))


KINDS: dict[str, Callable[[Rng, int], Pairs]] = {
    "grid": grid,
    "cylinder": cylinder,
    "cube": cube,
    "recursive tree": recursive_tree,
    "binary tree": binary_tree,
    "Barabasi-Albert": preferential,
    "Erdos-Renyi": uniform,
    "geometric": geometric,
    "small world": small_world,
    "communities": communities,
}
