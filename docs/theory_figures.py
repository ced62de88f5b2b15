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

    figure, (left, right) = plt.subplots(1, 2, figsize=(7.2, 4), sharey=True, layout='constrained')
    u, v = np.meshgrid(np.linspace(-0.4, 1.4, 91), np.linspace(-1.2, 1.2, 121))
    x = np.broadcast_to(ANCHORS, (*u.shape, 3, 2)).copy()
    x[..., 2, 0], x[..., 2, 1] = u, v
    lowest = energy(ida(x, fixed=1, iterations=60))
    left.contour(u, v, lowest, levels=np.geomspace(0.0105, 1, 14), cmap='viridis', linewidths=0.8)
    for end, value in zip(ends, found):
        left.plot(*end[2], 'o', color='tab:red', markersize=5)
        left.text(*end[2] + (0, 0.05), f'{value:.4f}', color='tab:red', ha='center', va='bottom', fontsize=8,
                  bbox={'facecolor': 'white', 'edgecolor': 'none', 'pad': 1})
    left.set_title('least E for each place of the third node', fontsize=9)
    draw(right, ends[0], 'tab:blue')
    draw(right, ends[1], 'tab:orange')
    right.plot(*ANCHORS.T, '+', color='black', markersize=9, label='anchors')
    right.set_title('the two minima', fontsize=9)
    right.legend(frameon=False, loc='upper left', bbox_to_anchor=(0.9, 1))
    for axes in (left, right):
        axes.set_aspect('equal')
        axes.set_xlabel('x')
    left.set_ylabel('y')
    figure.savefig(path, metadata={'Date': None})


def majoriser(path):
    """A node on the line (y, 0.4): its anchor's part on it is at -0.4, of stiffness 0.3, a spring holds it to the origin."""
    off = 0.4

    def e(y):
        return 0.15 * (y + 0.4) ** 2 + 0.5 * (np.hypot(y, off) - 1) ** 2

    def bound(y, x):
        return 0.15 * (y + 0.4) ** 2 + 0.5 * (y ** 2 + off ** 2 + 1) - (x * y + off ** 2) / np.hypot(x, off)

    y = np.linspace(-1.7, 1.9, 361)
    figure, axes = plt.subplots(figsize=(6.6, 3.1), layout='constrained')
    axes.plot(y, e(y), color='black', label='E')
    for x, colour in ((0.9, 'tab:orange'), (-0.15, 'tab:blue')):
        following = (x / np.hypot(x, off) - 0.3 * 0.4) / 1.3
        if not (np.all(bound(y, x) >= e(y) - 1e-12) and e(following) < e(x)):
            sys.exit('theory_figures.py: not a majoriser')
        axes.plot(y, bound(y, x), '--', color=colour, linewidth=1, label=f'majoriser at {x}')
        axes.plot(x, e(x), 'o', color=colour, markersize=5)
        axes.plot(following, bound(following, x), 'v', color=colour, markersize=6)
    axes.set_ylim(0, 1)
    axes.set_xlabel('y')
    axes.legend(frameon=False, loc='upper left', bbox_to_anchor=(1, 1))
    figure.savefig(path, metadata={'Date': None})


if len(sys.argv) != 2:
    sys.exit('usage: theory_figures.py FOLDER')
folder = pathlib.Path(sys.argv[1])
folder.mkdir(parents=True, exist_ok=True)
minima(folder / 'theory-minima.svg')
majoriser(folder / 'theory-majoriser.svg')
