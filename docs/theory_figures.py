#!/usr/bin/env python3
"""theory_figures.py FOLDER: the figures of docs/theory.md, docs/covariance.md and docs/gradients.md as SVG, computed by the library (`import asterism`).

Ends with an error where a figure does not show what its page says.
"""
import pathlib
import sys

import asterism
import matplotlib
matplotlib.use('svg')
import matplotlib.pyplot as plt
from matplotlib.patches import Ellipse
import numpy as np

plt.rcParams.update({'svg.hashsalt': 'asterism', 'font.size': 9, 'svg.fonttype': 'none', 'axes.spines.top': False,
                     'axes.spines.right': False})


def spring_system(anchors, anchor_stiffness, rest_length, link_stiffness):
    """Fully linked."""
    system = asterism.SpringSystem(asterism.Topology.full(len(anchors)))
    system.anchors, system.anchor_stiffness = anchors, anchor_stiffness
    system.rest_length, system.link_stiffness = rest_length, link_stiffness
    return system


def solved(system, start):
    """Where IDA goes from a start, and its energy there."""
    x = np.array(start, dtype=float)
    summary = asterism.solve(system, x, 'ida', tolerance=1e-10)
    if not summary.usable:
        sys.exit(f'theory_figures.py: {summary}')
    return x, summary.final_energy


def draw(axes, system, x, color):
    for link in system.topology.links:
        axes.plot(*x[link].T, color=color, linewidth=1)
    axes.plot(*x.T, 'o', color=color, markersize=5)


def minima(path):
    system = spring_system([[0, 0], [1, 0], [0.5, 0.2]], [1, 1, 0.05], 1, 1)
    ends, found = zip(*(solved(system, [[0, 0], [1, 0], [0.5, y]]) for y in (0.2, -0.2)))
    if not np.allclose(found, [0.01044740, 0.02675862], atol=5e-9):
        sys.exit(f'theory_figures.py: the minima are {found}')

    figure, (left, right) = plt.subplots(1, 2, figsize=(7.2, 4), sharey=True, layout='constrained')
    u, v = np.meshgrid(np.linspace(-0.4, 1.4, 91), np.linspace(-1.2, 1.2, 121))
    system.fix(2)
    lowest = np.reshape([solved(system, [[0, 0], [1, 0], third])[1] for third in zip(u.flat, v.flat)], u.shape)
    left.contour(u, v, lowest, levels=np.geomspace(0.0105, 1, 14), cmap='viridis', linewidths=0.8)
    for end, value in zip(ends, found):
        left.plot(*end[2], 'o', color='tab:red', markersize=5)
        left.text(*end[2] + (0, 0.05), f'{value:.4f}', color='tab:red', ha='center', va='bottom', fontsize=8,
                  bbox={'facecolor': 'white', 'edgecolor': 'none', 'pad': 1})
    left.set_title('least E for each place of the third node', fontsize=9)
    draw(right, system, ends[0], 'tab:blue')
    draw(right, system, ends[1], 'tab:orange')
    right.plot(*system.anchors.T, '+', color='black', markersize=9, label='anchors')
    right.set_title('the two minima', fontsize=9)
    right.legend(frameon=False, loc='upper left', bbox_to_anchor=(0.9, 1))
    for axes in (left, right):
        axes.set_aspect('equal')
        axes.set_xlabel('x')
    left.set_ylabel('y')
    figure.savefig(path, metadata={'Date': None})


class Line:
    """A node on the line (y, 0.4): its anchor is at (-0.4, 0.4), of stiffness 0.3, a spring holds it to the origin."""
    ida = 0.3 + 1  # IDA's matrix

    def __init__(self):
        self.system = spring_system([[-0.4, 0.4], [0, 0]], [0.3, 0], 1, 1)
        self.system.fix(1)

    def energy(self, y):
        return asterism.energy(self.system, np.array([[y, 0.4], [0, 0]]))

    def slope(self, y):
        return asterism.gradient(self.system, np.array([[y, 0.4], [0, 0]]))[0, 0]

    def w(self, y):
        """The matrix of the quadratic below."""
        return 0.3 + 1 - 1 / np.hypot(y, 0.4)

    def quadratic(self, x, curvature, y):
        """That touches the energy at x."""
        return self.energy(x) + self.slope(x) * (y - x) + curvature / 2 * (y - x) ** 2


def majoriser(path):
    line = Line()
    e, slope, stiffness = line.energy, line.slope, line.ida
    y = np.linspace(-1.7, 1.9, 361)
    energies = np.array([e(at) for at in y])
    figure, axes = plt.subplots(figsize=(6.6, 3.1), layout='constrained')
    axes.plot(y, energies, color='black', label='E')
    for x, color in ((0.9, 'tab:orange'), (-0.15, 'tab:blue')):
        def bound(at):
            return line.quadratic(x, stiffness, at)
        following = x - slope(x) / stiffness
        if not (np.all(bound(y) >= energies - 1e-12) and e(following) < e(x)):
            sys.exit('theory_figures.py: not a majoriser')
        axes.plot(y, bound(y), '--', color=color, linewidth=1, label=f'majoriser at {x}')
        axes.plot(x, e(x), 'o', color=color, markersize=5)
        axes.plot(following, bound(following), 'v', color=color, markersize=6)
    axes.set_ylim(0, 1)
    axes.set_xlabel('y')
    axes.legend(frameon=False, loc='upper left', bbox_to_anchor=(1, 1))
    figure.savefig(path, metadata={'Date': None})


def minoriser(path):
    """The quadratics on both sides of E at its two minima on the line."""
    line = Line()
    y = np.linspace(-1.7, 1.9, 361)
    energies = np.array([line.energy(at) for at in y])
    figure, axes = plt.subplots(figsize=(6.6, 3.1), layout='constrained')
    axes.plot(y, energies, color='black', label='E')
    for x, color, certified in ((-0.8, 'tab:blue', True), (0.5, 'tab:orange', False)):
        while abs(line.slope(x)) > 1e-12:
            x -= line.slope(x) / line.ida
        above, below = line.quadratic(x, line.ida, y), line.quadratic(x, line.w(x), y)
        if not (np.all(above >= energies - 1e-12) and np.all(below <= energies + 1e-12) and (line.w(x) > 0) == certified):
            sys.exit('theory_figures.py: not a minoriser')
        axes.plot(y, above, '--', color=color, linewidth=1, label=f'above, touching at {x:.2f}')
        axes.plot(y, below, ':', color=color, linewidth=1.5, label=f'below, W = {line.w(x):.2f}')
        axes.plot(x, line.energy(x), 'o', color=color, markersize=5)
    axes.set_ylim(-0.1, 0.8)
    axes.set_xlabel('y')
    axes.legend(frameon=False, loc='upper left', bbox_to_anchor=(1, 1))
    figure.savefig(path, metadata={'Date': None})


def samples(system, x, count):
    """Of p = exp(-E), by random walk Metropolis from x."""
    random = np.random.default_rng(1)
    x, energy = x.copy(), asterism.energy(system, x)
    kept = np.empty((count, *x.shape))
    for k in range(count):
        step = x + random.normal(scale=1.2, size=x.shape)
        proposed = asterism.energy(system, step)
        if np.log(random.uniform()) < energy - proposed:
            x, energy = step, proposed
        kept[k] = x
    return kept


def covariance(path):
    """Four parts, one of them seen with little certainty."""
    places = np.array([[0.0, 0], [40, 0], [0, 40], [40, 40]])
    system = spring_system(places, [0.1, 0.1, 0.1, 0.002], 1, 0.1)
    system.set_rest_lengths(places)
    system.anchors[3] += 12, 9
    x, _ = solved(system, places)
    drawn = samples(system, x, 60000)
    of_ida = np.linalg.inv(np.diag(system.anchor_stiffness + 0.1 * 3) - 0.1 * (1 - np.eye(4)))

    figure, axes = plt.subplots(figsize=(6, 4.4))
    draw(axes, system, x, 'black')
    axes.plot(*system.anchors.T, '+', color='black', markersize=9, label='anchors')
    axes.plot([], [], '.', color='tab:blue', label='samples')
    for node, sigma in enumerate(asterism.node_covariances(system, x)):
        d = drawn[:, node] - x[node]
        inside = (np.einsum('ki,ij,kj->k', d, np.linalg.inv(sigma), d) < 5.991).mean()
        if not 0.92 < inside < 0.97:
            sys.exit(f'theory_figures.py: {inside:.3f} of the samples of node {node} are in its region')
        variances, directions = np.linalg.eigh(sigma)
        angle = np.degrees(np.arctan2(directions[1, 0], directions[0, 0]))
        axes.plot(*drawn[::40, node].T, '.', color='tab:blue', alpha=0.3, markersize=2, rasterized=True, zorder=0)
        axes.add_patch(Ellipse(x[node], *2 * np.sqrt(5.991 * variances), angle=angle, fill=False, color='tab:red',
                               label='95 %, Laplace' if node == 0 else None))
        axes.add_patch(Ellipse(x[node], *2 * np.sqrt([5.991 * of_ida[node, node]] * 2), fill=False, color='tab:green',
                               linestyle='--', linewidth=1.5, label="by IDA's matrix" if node == 0 else None))
    axes.set_aspect('equal')
    axes.invert_yaxis()
    axes.set_xlabel('x [px]')
    axes.set_ylabel('y [px]')
    axes.legend(frameon=False, loc='upper left', bbox_to_anchor=(1, 1))
    figure.savefig(path, metadata={'Date': None}, dpi=150, bbox_inches='tight')


def grid_of_parts():
    """A grid of parts, one of them hardly seen: places, system, solution, and the number of that part."""
    places = np.array([[40.0 * column, 40.0 * row] for row in range(3) for column in range(4)])
    pairs = [(i, j) for j in range(12) for i in range(j) if np.linalg.norm(places[i] - places[j]) < 60]
    system = asterism.SpringSystem(asterism.Topology.from_links(12, pairs))
    system.set_rest_lengths(places)
    system.anchors = places + np.random.default_rng(2).normal(scale=2, size=places.shape)
    system.anchor_stiffness, system.link_stiffness = 0.3, 0.5
    weak = 6
    system.anchor_stiffness[weak] = 0.01
    return places, system, solved(system, places)[0], weak


def draw_parts(axes, system, x, weak):
    draw(axes, system, x, '0.6')
    axes.plot(*system.anchors.T, '+', color='black', markersize=9, label='anchors')
    axes.plot(*x[weak], 'o', color='white', markeredgecolor='0.4', markersize=7, label='weak anchor')
    axes.set_aspect('equal')
    axes.set_ylim(95, -15)
    axes.set_xlim(-35, 155)
    axes.set_xlabel('x [px]')


ARROWS = {'angles': 'xy', 'scale_units': 'xy', 'scale': 1, 'width': 0.006}


def gradients(path):
    """What moves when one anchor is pulled, beside the part that is hardly seen."""
    places, system, x, weak = grid_of_parts()
    pulled, pull = 5, np.array([24.0, -12.0])
    tangent = np.zeros_like(places)
    tangent[pulled] = pull
    moves = asterism.solution_tangent(system, x, anchors=tangent)
    # The same by solving again, with a pull of a thousandth; and the anchors' shares of the mean's move in reverse mode.
    system.anchors[pulled] += 1e-3 * pull
    again, _ = solved(system, x)
    if not np.allclose((again - x) / 1e-3, moves, atol=1e-2):
        sys.exit('theory_figures.py: the moves are not those of a solve')
    system.anchors[pulled] -= 1e-3 * pull
    mean = asterism.sensitivity(system, x, np.full_like(x, 1 / len(x)))
    if not np.isclose(mean.anchors[pulled] @ pull, moves.mean(axis=0).sum()):
        sys.exit('theory_figures.py: forward and reverse mode differ')

    figure, axes = plt.subplots(figsize=(6.2, 4), layout='constrained')
    draw_parts(axes, system, x, weak)
    axes.quiver(*system.anchors[pulled], *pull, color='tab:red', label='pull', **ARROWS)
    axes.quiver(*x.T, *(3 * moves).T, color='tab:blue', label='moves, 3 times as long', zorder=3, **ARROWS)
    axes.set_ylabel('y [px]')
    axes.legend(frameon=False, loc='upper left', bbox_to_anchor=(1, 1))
    figure.savefig(path, metadata={'Date': None})


def influence(path):
    """How the anchor of each part moves the box, which follows the parts by a least-squares similarity."""
    places, system, x, weak = grid_of_parts()
    spokes = (places - places.mean(axis=0)) @ [1, 1j]

    def log_size(y):
        return np.log(abs(spokes.conj() @ (y @ [1, 1j])) / (abs(spokes)**2).sum())

    # The box's centre is the mean of the parts; the derivative of log_size by x is that of log |z|, z = sum of spoke* x.
    centre = asterism.sensitivity(system, x, np.tile([1 / len(x), 0], (len(x), 1)))
    z = spokes.conj() @ (x @ [1, 1j])
    by_x = spokes * z / abs(z)**2
    size = asterism.sensitivity(system, x, np.stack([by_x.real, by_x.imag], axis=1))
    if not np.allclose(centre.anchors.sum(axis=0), [1, 0]) or not np.allclose(size.anchors.sum(axis=0), 0):
        sys.exit('theory_figures.py: the box does not go along with all anchors')
    step = 1e-4 * np.random.default_rng(3).normal(size=x.shape)
    system.anchors += step
    ahead, _ = solved(system, x)
    system.anchors -= 2 * step
    behind, _ = solved(system, x)
    system.anchors += step
    if not np.isclose((log_size(ahead) - log_size(behind)) / 2, (size.anchors * step).sum(), rtol=1e-4):
        sys.exit('theory_figures.py: the change of the size is not that of two solves')

    figure, (left, right) = plt.subplots(1, 2, figsize=(7.2, 3.2), sharey=True, layout='constrained')
    for axes in (left, right):
        draw_parts(axes, system, x, weak)
    for part, share in zip(x, centre.anchors[:, 0]):
        left.text(*part + (4, -4), f'{100 * share:.1f} %', color='tab:blue', fontsize=8)
    left.set_title('x of the centre, for a move along x', fontsize=9)
    right.quiver(*x.T, *(40 / 1e-3 * size.anchors).T, color='tab:blue', zorder=3, **ARROWS)
    right.set_title('size: 40 px of arrow are 0.1 % of size per px', fontsize=9)
    left.set_ylabel('y [px]')
    figure.savefig(path, metadata={'Date': None})


if len(sys.argv) != 2:
    sys.exit('usage: theory_figures.py FOLDER')
folder = pathlib.Path(sys.argv[1])
folder.mkdir(parents=True, exist_ok=True)
minima(folder / 'theory-minima.svg')
majoriser(folder / 'theory-majoriser.svg')
minoriser(folder / 'theory-minoriser.svg')
covariance(folder / 'covariance.svg')
gradients(folder / 'gradients.svg')
influence(folder / 'influence.svg')
