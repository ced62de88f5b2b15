"""Writes a spring system to a file in PETSc's binary format, which processes read together: NumPy alone."""

import sys

import numpy as np


def write_petsc(path, anchors, anchor_stiffness, start, links, rest_length, link_stiffness, fixed=(), integer=">i4"):
    """Points are (N, Dim), links (L, 2) node numbers. integer=">i8" is for a PETSc of 64-bit indices."""
    n, dim = np.shape(anchors)
    with open(path, "wb") as file:

        def vector(values):  # PETSc's Vec: its class, the size, numbers
            file.write(np.array([1211214, np.size(values)], integer).tobytes())
            file.write(np.ascontiguousarray(values, ">f8").tobytes())

        def numbers(values):  # PETSc's IS
            file.write(np.array([1211218, np.size(values)], integer).tobytes())
            file.write(np.ascontiguousarray(values, integer).tobytes())

        vector([1, dim, n, len(links)])  # version of the format, Dim, nodes, links
        vector(anchors)
        vector(anchor_stiffness)
        vector(start)
        numbers(links)
        vector(rest_length)
        vector(link_stiffness)
        numbers(fixed)


if __name__ == "__main__":
    # A net of side x side nodes that hangs on its four corners, each node held weakly where it starts.
    side = int(sys.argv[2]) if len(sys.argv) > 2 else 100
    x, y = np.meshgrid(np.arange(side), np.arange(side), indexing="ij")
    nodes = np.stack([x.ravel(), y.ravel()], axis=1).astype(float)
    index = np.arange(side * side).reshape(side, side)
    links = np.concatenate(
        [
            np.stack([index[:-1].ravel(), index[1:].ravel()], axis=1),
            np.stack([index[:, :-1].ravel(), index[:, 1:].ravel()], axis=1),
        ]
    )
    count = len(links)
    write_petsc(sys.argv[1], nodes, np.full(side * side, 0.01), nodes, links, np.full(count, 0.9), np.ones(count),
                fixed=[index[0, 0], index[0, -1], index[-1, 0], index[-1, -1]])
