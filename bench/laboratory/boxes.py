#!/usr/bin/env python3
"""Boxes without overlap: asterism.layout with sizes, and what removes overlaps from its drawing without them.

    boxes.py [--nodes N] [--fills F,F]

Graphs of about N nodes (1652): a grid, a random tree, one by Barabasi and Albert, and a geometric one. Each is drawn without boxes; then
the boxes are scaled so that their areas are the share F of the drawing's bounding rectangle. "layout" draws with sizes; all other programs
start from the drawing without: asterism.remove_overlaps, and Graphviz's methods if it is installed (neato -n, without scaling).
"stress" is relative to the drawing without boxes, "scaled" is that after both are enlarged or shrunk to their least stress; "area" is that of
the bounding rectangle, relative, too; "overlaps" is counted over all pairs, for Graphviz those of over a hundredth of the sizes, as it
rounds its output. The time is CPU time, of Graphviz with reading and writing.
"""

import argparse
import resource
import shutil
import subprocess

import asterism
import numpy as np

random = np.random.default_rng(1)


def grid(n: int) -> list[tuple[int, int]]:
    rows = int(np.sqrt(n / 2))
    at = np.arange(rows * (n // rows)).reshape(rows, -1)
    return [(int(i), int(j)) for a, b in ((at[:-1], at[1:]), (at[:, :-1], at[:, 1:])) for i, j in zip(a.ravel(), b.ravel())]


def tree(n: int) -> list[tuple[int, int]]:
    return [(k, int(random.integers(k))) for k in range(1, n)]


def preferential(n: int) -> list[tuple[int, int]]:
    ends, edges = [0, 1], [(0, 1)]
    for k in range(2, n):
        for j in {ends[random.integers(len(ends))] for _ in range(2)}:
            edges.append((k, j))
            ends += [k, j]
    return edges


def geometric(n: int) -> list[tuple[int, int]]:
    """Of points of the plane, each with its 3 nearest, and with the point before it along x, which joins all."""
    points = random.random((n, 2))
    points = points[np.argsort(points[:, 0])]
    distance = np.linalg.norm(points[:, None] - points, axis=2)
    near = np.argsort(distance, axis=1)[:, 1:4]
    joining = [(k, int(distance[k, :k].argmin())) for k in range(1, n)]
    return sorted({(min(i, int(j)), max(i, int(j))) for i in range(n) for j in near[i]} | {(j, i) for i, j in joining})


def graphviz(x: np.ndarray, sizes: np.ndarray, method: str) -> np.ndarray:
    inches = 1 / sizes.mean()  # its text has five digits
    x, sizes = x * inches, sizes * inches
    nodes = "".join(f'{k} [pos="{a * 72},{b * 72}",width={w},height={h}];' for k, ((a, b), (w, h)) in enumerate(zip(x, sizes)))
    arguments = ["neato", "-n", f"-Goverlap={method}", "-Goverlap_scaling=0", "-Goverlap_shrink=false", "-Gsep=+0", "-Gsplines=", "-Nshape=box", "-Nlabel=", "-Nfixedsize=true"]
    out = subprocess.run([*arguments, "-Tplain"], input=f"graph {{{nodes}}}", capture_output=True, text=True, check=True).stdout
    result = np.zeros_like(x)
    for words in map(str.split, out.splitlines()):
        if words and words[0] == "node":
            result[int(words[1])] = float(words[2]), float(words[3])
    return result / inches


def cpu_seconds() -> float:
    return sum(sum(resource.getrusage(who)[:2]) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))


def overlaps(x: np.ndarray, sizes: np.ndarray, slack: float) -> int:
    apart = np.abs(x[:, None] - x) >= (1 - slack) * (sizes[:, None] + sizes) / 2
    return int((~apart.any(axis=2)).sum() - len(x)) // 2


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--nodes", type=int, default=1652)
    parser.add_argument("--fills", default="0.1,0.2,0.3")
    options = parser.parse_args()
    methods = ("prism", "vpsc") if shutil.which("neato") else ()
    if not methods:
        print("without Graphviz's methods: not installed (Debian package graphviz)")
    print(f"{'graph':14} {'fill':>5} {'program':16} {'overlaps':>8} {'stress':>7} {'scaled':>7} {'area':>6} {'time [s]':>8}")
    for build in (grid, tree, preferential, geometric):
        edges = build(options.nodes)
        begin = cpu_seconds()
        free = asterism.layout(edges).x
        seconds = cpu_seconds() - begin
        n = len(free)
        shape = random.uniform(0.5, 2, (n, 1)) * [1, 0] + [0, 0.5]  # labels: of one height, and of many widths
        area = np.ptp(free, axis=0).prod()
        stress, scaled = (asterism.layout_stress(edges, free, scaled=by) for by in (False, True))
        for fill in map(float, options.fills.split(",")):
            sizes = shape * np.sqrt(fill * area / shape.prod(axis=1).sum())
            rows = [("without", lambda: free), ("layout", lambda: asterism.layout(edges, sizes=sizes).x)]
            rows += [("remove_overlaps", lambda: asterism.remove_overlaps(free, sizes))]
            rows += [(f"graphviz {method}", lambda method=method: graphviz(free, sizes, method)) for method in methods]
            for name, draw in rows:
                begin = cpu_seconds()
                x = draw()
                took = cpu_seconds() - begin if name != "without" else seconds
                of = (asterism.layout_stress(edges, x) / stress, asterism.layout_stress(edges, x, scaled=True) / scaled)
                count = overlaps(x, sizes, 1e-2 if name.startswith("graphviz") else 0)
                print(
                    f"{build.__name__:14} {fill:5.2f} {name:16} {count:8} {of[0]:7.3f} {of[1]:7.3f} "
                    f"{np.ptp(x, axis=0).prod() / area:6.2f} {took:8.2f}",
                    flush=True,
                )


if __name__ == "__main__":
    main()
