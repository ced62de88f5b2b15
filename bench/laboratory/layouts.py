#!/usr/bin/env python3
"""Programs that draw graphs, on the graphs of files: the stress that they reach and the CPU time that they take.

    layouts.py [FILE...] [--made N [--kinds KIND,...] [--seed S]]

reads lists of edges, `NODE NODE [LENGTH]` a line, as docs/examples/debian_graph.py writes them, or Graphviz's .gv and .gv.gz files. Of
each graph the largest component is drawn, without directions. The stress of every drawing is computed by asterism.layout_stress from
the same distances, after the drawing is scaled to its least stress, because the programs have different units; over 20,000 nodes it is
estimated from the paths of the same 50 nodes for all. It is relative to the least one of the table. "ours" is the CPU time in which
asterism.layout (one start) first has no more stress than that program's drawing, with everything before it; "-" if it never has. --made
draws ten kinds of random graphs of about N nodes, with a fifth more edges (graphs.py), and ends with a table of all. A program of Graphviz
or of JavaScript that takes longer than --limit is stopped, and a line says so. Needs the Python module of Asterism; graphviz,
python3-igraph, python3-networkx, python3-sklearn and nodejs with node-d3-force and the npm package webcola add their programs if
installed. Packages of npm are found in the folder that is current, or by NODE_PATH.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import gzip
import json
import pathlib
import resource
import shlex
import shutil
import subprocess
import sys
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

try:
    import graphs
except ImportError:
    graphs = None
try:
    import asterism
except ImportError as error:
    sys.exit(f"layouts.py: {error}")
try:
    import igraph
except ImportError:
    igraph = None
try:
    import networkx
except ImportError:
    networkx = None
try:
    from sklearn import manifold
except ImportError:
    manifold = None

Edges = list[tuple[int, int, float]]
Row = tuple[str, float, float]  # program, stress, CPU seconds


class limit:
    seconds = 600.0  # of wall-clock time for a program of Graphviz or JavaScript


class BadInput(Exception):
    """What is wrong with a file, in one line."""


def lines_of(path: pathlib.Path) -> list[str]:
    """The lines of a list of edges. Graphviz's gvpr reads its files."""
    try:
        data = gzip.decompress(path.read_bytes()) if path.suffix == ".gz" else path.read_bytes()
    except OSError as error:
        raise BadInput(f"{path}: {error.strerror or error}") from error
    if ".gv" in path.suffixes:
        if not shutil.which("gvpr"):
            raise BadInput(f"{path}: needs gvpr (Debian package graphviz)")
        program = 'E{print(gsub($.tail.name, " ", "_"), " ", gsub($.head.name, " ", "_"))}'
        data = subprocess.run(["gvpr", program], input=data, capture_output=True, check=True).stdout
    return data.decode(errors="replace").splitlines()


def largest_component(lines: list[str], source: str) -> Edges:
    index: dict[str, int] = {}
    edges: Edges = []
    for number, line in enumerate(lines, 1):
        if not (words := line.split()):
            continue
        try:
            i, j = (index.setdefault(word, len(index)) for word in words[:2])
            edges.append((i, j, float(words[2]) if len(words) > 2 else 1.0))
        except ValueError as error:
            raise BadInput(f"{source}:{number}: expected NODE NODE [LENGTH]") from error
    root = list(range(len(index)))

    def find(node: int) -> int:
        while root[node] != node:
            root[node] = node = root[root[node]]
        return node

    for i, j, _ in edges:
        root[find(i)] = find(j)
    roots = np.array([find(node) for node in range(len(index))], dtype=int)
    if not len(roots):
        raise BadInput(f"{source}: no edges")
    nodes = np.flatnonzero(roots == np.bincount(roots).argmax())
    place = {int(node): k for k, node in enumerate(nodes)}
    return [(place[i], place[j], length) for i, j, length in edges if i in place and i != j]


@dataclass
class Program:
    name: str
    most: int  # nodes: it takes too much time or memory for more
    draw: Callable[[Edges, int], np.ndarray]


def graphviz(command: str) -> Callable[[Edges, int], np.ndarray]:
    def draw(edges: Edges, n: int) -> np.ndarray:
        nodes = "".join(f"{k};" for k in range(n))
        text = f"graph {{{nodes}" + "".join(f"{i}--{j}[len={length}];" for i, j, length in edges) + "}"
        out = subprocess.run(
            [*shlex.split(command), "-Goverlap=true", "-Gsplines=", "-Nshape=point", "-Nlabel=", "-Tplain"],
            input=text, capture_output=True, text=True, check=True, timeout=limit.seconds,
        ).stdout  # fmt: skip
        x = np.zeros((n, 2))
        for words in map(str.split, out.splitlines()):
            if words and words[0] == "node":
                x[int(words[1])] = float(words[2]), float(words[3])
        return x

    return draw


def of_igraph(method: str) -> Callable[[Edges, int], np.ndarray]:
    def draw(edges: Edges, n: int) -> np.ndarray:
        graph = igraph.Graph(n, [edge[:2] for edge in edges])
        return np.array(graph.layout(method).coords)

    return draw


def of_networkx(draw_graph: str, **options: object) -> Callable[[Edges, int], np.ndarray]:
    def draw(edges: Edges, n: int) -> np.ndarray:
        graph = networkx.empty_graph(n)
        graph.add_weighted_edges_from(edges, weight="length")
        pos = getattr(networkx, draw_graph)(graph, **options)
        return np.array([pos[k] for k in range(n)])

    return draw


# Debian's packages of node, and those of npm in the current folder.
NODE_PATHS = os.pathsep.join(["node_modules", "/usr/share/nodejs", *filter(None, [os.environ.get("NODE_PATH")])])


def node(*arguments: str, text: str = "") -> str:
    environment = {**os.environ, "NODE_PATH": NODE_PATHS}
    command = ["node", "--max-old-space-size=8000", *arguments]
    return subprocess.run(command, input=text, env=environment, capture_output=True, text=True, check=True, timeout=limit.seconds).stdout


def of_javascript(method: str) -> Callable[[Edges, int], np.ndarray]:
    script = str(pathlib.Path(__file__).with_name("layouts.js"))
    return lambda edges, n: np.array(json.loads(node(script, method, text=json.dumps({"nodes": n, "edges": edges}))))


def smacof(edges: Edges, n: int) -> np.ndarray:
    graph = asterism._asterism._Graph(n, np.array([edge[:2] for edge in edges]), np.array([edge[2] for edge in edges]))
    everyone = np.arange(n)[None]
    distances = graph.distances(everyone, everyone)[0]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return manifold.smacof(distances, n_init=1, max_iter=300, eps=1e-4, random_state=1)[0]


def programs() -> Iterator[Program]:
    yield Program("asterism", 2000000, lambda edges, n: asterism.layout(edges).x)
    yield Program("asterism auto", 3000, lambda edges, n: asterism.layout(edges, method="auto").x)
    yield Program("asterism partners=50", 20000, lambda edges, n: asterism.layout(edges, partners=50).x)
    if shutil.which("neato"):
        yield Program("neato -Gmode=major", 3000, graphviz("neato -Gmode=major"))
        yield Program("sfdp", 2000000, graphviz("sfdp"))
    else:
        print("without neato and sfdp: not installed (Debian package graphviz)")
    if igraph:
        yield Program("igraph kk", 3000, of_igraph("kk"))
        yield Program("igraph mds", 3000, of_igraph("mds"))
        yield Program("igraph fr", 20000, of_igraph("fr"))
        yield Program("igraph drl", 200000, of_igraph("drl"))
    else:
        print("without igraph's layouts: not installed (Debian package python3-igraph)")
    if networkx:
        yield Program("networkx kamada_kawai", 1500, of_networkx("kamada_kawai_layout", weight="length"))
        yield Program("networkx spring", 3000, of_networkx("spring_layout", weight=None, seed=1))
    else:
        print("without networkx's layouts: not installed (Debian package python3-networkx)")
    for name, most, source in (("d3-force", 20000, "Debian package node-d3-force"), ("webcola", 500, "npm package webcola"), ("sgd", 3000, "")):
        try:
            node("-e", f'require("{name}")' if source else "")
            yield Program("sgd by its paper" if name == "sgd" else name, most, of_javascript(name))
        except (OSError, subprocess.SubprocessError):
            print(f"without {name}: not installed ({source or 'Debian package nodejs'})")
    if manifold:
        yield Program("sklearn smacof*", 3000, smacof)
    else:
        print("without scikit-learn's SMACOF: not installed (Debian package python3-sklearn)")


def cpu_seconds() -> float:
    """Of this process and of those that it has waited for [s]."""
    return sum(sum(resource.getrusage(who)[:2]) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))


def descent(edges: Edges) -> list[tuple[float, float]]:
    """CPU time [s] and stress after each iteration of asterism.layout from one start."""
    seen: list[tuple[float, float]] = []
    begin = cpu_seconds()

    def watch(_iteration: int, _x: np.ndarray, energy: float, _gradient: float) -> None:
        seen.append((cpu_seconds() - begin, 2 * energy))

    asterism.layout(edges, method="auto", on_iteration=watch)
    return seen


def stress_of(edges: Edges, x: np.ndarray) -> float:
    """Of the drawing enlarged or shrunk to its least stress; of large graphs estimated."""
    n = len(x)
    if n <= 20000:
        return asterism.layout_stress(edges, x, scaled=True)
    graph = asterism._asterism._Graph(n, np.array([edge[:2] for edge in edges]), np.array([edge[2] for edge in edges]))
    products = squares = 0.0
    sources = np.random.default_rng(1).integers(0, n, 50)
    for source in sources:
        d = graph.distances(np.array([[source]]), np.arange(n)[None])[0, 0]
        d[source] = np.inf
        ratio = np.linalg.norm(x - x[source], axis=1) / d
        products, squares = products + ratio.sum(), squares + np.sum(ratio**2)
    return (len(sources) * (n - 1) - products**2 / squares) * n / len(sources) / 2


def compare(name: str, edges: Edges, chosen: list[Program]) -> list[Row]:
    n = 1 + max(max(i, j) for i, j, _ in edges)
    print(f"\n{name}: {n} nodes, {len(edges)} edges", flush=True)
    rows: list[Row] = []
    for program in chosen:
        if n > program.most:
            continue
        begin = cpu_seconds()
        try:
            x = program.draw(edges, n)
        except (OSError, subprocess.SubprocessError, MemoryError, ValueError) as error:
            print(f"{program.name}: {error}")
            continue
        seconds = cpu_seconds() - begin
        rows.append((program.name, stress_of(edges, x), seconds))
    if not rows:
        return rows
    ours = descent(edges) if n <= 3000 else []
    least = min(stress for _, stress, _ in rows) or 1.0
    print(f"{'program':22} {'stress':>12} {'relative':>9} {'time [s]':>9} {'ours [s]':>9}")
    for program, stress, seconds in rows:
        reached = next((f"{at:9.3f}" for at, energy in ours if energy <= stress), f"{'-':>9}")
        print(f"{program:22} {stress:12.6g} {stress / least:9.4f} {seconds:9.3f} {reached}", flush=True)
    return rows


def compare_made(options: argparse.Namespace, chosen: list[Program]) -> None:
    """The made graphs, and a table of stress relative to the first program's."""
    if not graphs:
        raise BadInput("--made: needs SciPy (Debian package python3-scipy)")
    kinds = options.kinds.split(",") if options.kinds else list(graphs.KINDS)
    if unknown := [kind for kind in kinds if kind not in graphs.KINDS]:
        raise BadInput(f"no kind of graphs is named {unknown[0]}; there are {', '.join(graphs.KINDS)}")
    lines = []
    for kind in kinds:
        pairs = graphs.KINDS[kind](np.random.default_rng([options.seed, options.made]), options.made)
        rows = compare(kind, [(i, j, 1.0) for i, j in pairs.tolist()], chosen)
        cells = [f"{name} {stress / rows[0][1]:.3f} ({seconds:.1f} s)" for name, stress, seconds in rows]
        lines.append(f"| {kind} | {1 + pairs.max()}, {len(pairs)} | " + " | ".join(cells) + " |")
    print(f"\nstress relative to that of the first program, and CPU time; seed {options.seed}")
    print("\n".join(lines), flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("files", nargs="*", type=pathlib.Path, help="lists of edges, or files of Graphviz")
    parser.add_argument("--made", type=int, metavar="N", help="also random graphs of about so many nodes")
    parser.add_argument("--kinds", help="of --made, separated by commas (default: all)")
    parser.add_argument("--seed", type=int, default=1, help="of --made")
    parser.add_argument("--limit", type=float, default=limit.seconds, help="of the wall-clock time of a program of Graphviz or JavaScript [s] (%(default)g)")
    parser.add_argument("--programs", help="names, separated by commas (default: all)")
    options = parser.parse_args()
    if not options.files and options.made is None:
        parser.error("needs a FILE or --made")
    if options.made is not None and options.made < 100:
        parser.error("--made: expected at least 100 nodes")
    limit.seconds = options.limit
    chosen = list(programs())
    if options.programs:
        known = {program.name.rstrip("*"): program for program in chosen}
        if unknown := [name for name in options.programs.split(",") if name not in known]:
            raise BadInput(f"no program is named {unknown[0]}; there are {', '.join(known)}")
        chosen = [known[name] for name in options.programs.split(",")]
    if any(program.name.endswith("*") for program in chosen):
        print("* scikit-learn's SMACOF has no weights: it minimises another stress, with weight 1 for all pairs.")
    for path in options.files:
        compare(path.name, largest_component(lines_of(path), str(path)), chosen)
    if options.made is not None:
        compare_made(options, chosen)


if __name__ == "__main__":
    try:
        main()
    except BadInput as problem:
        sys.exit(f"layouts.py: {problem}")
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(1)
