#!/usr/bin/env python3
"""theory_figures.py FOLDER: the figures of docs/theory.md as SVG, by its equations.

Ends with an error where the two minima are not those that the page gives, and the library's tests hold.
"""
import pathlib
import sys

import matplotlib
matplotlib.use('svg')
import matplotlib.pyplot as plt
import numpy as np

plt.rcParams.update({'svg.hashsalt': 'asterism', 'font.size': 9, 'svg.fonttype': 'none', 'axes.spines.top': False,
                     'axes.spines.right': False})

ANCHORS = np.array([[0, 0], [1, 0], [0.5, 0.2]])
ANCHOR_STIFFNESS = np.array([1, 1, 0.05])
LINKS = [(0, 1), (0, 2), (1, 2)]  # all of rest length and stiffness 1


def energy(x):
    """x: ... x 3 x 2."""
    anchors = (ANCHOR_STIFFNESS * ((x - ANCHORS) ** 2).sum(-1)).sum(-1)
    springs = sum((np.linalg.norm(x[..., i, :] - x[..., j, :], axis=-1) - 1) ** 2 for i, j in LINKS)
    return (anchors + springs) / 2


def ida(x, fixed=0, iterations=2000):
    """IDA from x on, the last `fixed` nodes held."""
    matrix = np.diag(ANCHOR_STIFFNESS).astype(float)
    for i, j in LINKS:
        matrix[[i, j], [i, j]] += 1
        matrix[[i, j], [j, i]] -= 1
    free = 3 - fixed
    inverse = np.linalg.inv(matrix[:free, :free])
    for _ in range(iterations):
        gradient = ANCHOR_STIFFNESS[:, None] * (x - ANCHORS)
        for i, j in LINKS:
            d = x[..., i, :] - x[..., j, :]
            length = np.maximum(np.linalg.norm(d, axis=-1, keepdims=True), 1e-12)
            force = (length - 1) * d / length
            gradient[..., i, :] += force
            gradient[..., j, :] -= force
        x = x.copy()
        x[..., :free, :] -= np.einsum('ij,...jd->...id', inverse, gradient[..., :free, :])
    return x


def draw(axes, x, colour):
    for i, j in LINKS:
        axes.plot(*x[[i, j]].T, color=colour, linewidth=1)
    axes.plot(*x.T, 'o', color=colour, markersize=5)


def minima(path):
    ends = [ida(np.array([[0, 0], [1, 0], [0.5, y]])) for y in (0.2, -0.2)]
    found = [float(energy(x)) for x in ends]
    if not np.allclose(found, [0.01044740, 0.02675862], atol=5e-9):
        sys.exit(f'theory_figures.py: the minima are {found}')

    figure, (left, right) = plt.subplots(1, 2, figsize=(7.2, 3.1), sharey=True, layout='constrained')
    u, v = np.meshgrid(np.linspace(-0.4, 1.4, 91), np.linspace(-1.2, 1.2, 121))
    x = np.broadcast_to(ANCHORS, (*u.shape, 3, 2)).copy()
    x[..., 2, 0], x[..., 2, 1] = u, v
    lowest = energy(ida(x, fixed=1, iterations=60))
    left.contour(u, v, lowest, levels=np.geomspace(0.0105, 1, 14), cmap='viridis', linewidths=0.8)
    for end, value, offset in zip(ends, found, (0.12, -0.18)):
        left.plot(*end[2], 'o', color='tab:red', markersize=5)
        left.text(end[2, 0], end[2, 1] + offset, f'{value:.4f}', color='tab:red', ha='center')
    left.set_title('least E for each place of the third node', fontsize=9)
    draw(right, ends[0], 'tab:blue')
    draw(right, ends[1], 'tab:orange')
    right.plot(*ANCHORS.T, '+', color='black', markersize=9, label='anchors')
    right.set_title('the two minima', fontsize=9)
    right.legend(frameon=False, loc='upper right')
    for axes in (left, right):
        axes.set_aspect('equal')
        axes.set_xlabel('x')
    left.set_ylabel('y')
    figure.savefig(path, metadata={'Date': None})


def majoriser(path):
    """A node on a line: an anchor at -0.4 of stiffness 0.6 and a spring of rest length 1 to a node held at 0."""
    def e(x):
        return 0.3 * (x + 0.4) ** 2 + 0.5 * (abs(x) - 1) ** 2

    def bound(y, x):
        return 0.3 * (y + 0.4) ** 2 + 0.5 * (y - np.sign(x)) ** 2

    y = np.linspace(-1.7, 1.7, 341)
    figure, axes = plt.subplots(figsize=(5.4, 3.1), layout='constrained')
    axes.plot(y, e(y), color='black', label='E')
    for x, colour in ((1.45, 'tab:orange'), (-0.15, 'tab:blue')):
        axes.plot(y, bound(y, x), '--', color=colour, linewidth=1, label=f'majoriser at {x}')
        step = (np.sign(x) - 0.6 * 0.4) / 1.6
        axes.plot(x, e(x), 'o', color=colour, markersize=5)
        axes.plot(step, bound(step, x), 'v', color=colour, markersize=6)
    axes.set_ylim(0, 2)
    axes.set_xlabel('y')
    axes.legend(frameon=False, loc='upper center')
    figure.savefig(path, metadata={'Date': None})


if len(sys.argv) != 2:
    sys.exit('usage: theory_figures.py FOLDER')
folder = pathlib.Path(sys.argv[1])
folder.mkdir(parents=True, exist_ok=True)
minima(folder / 'theory-minima.svg')
majoriser(folder / 'theory-majoriser.svg')
