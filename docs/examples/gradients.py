"""How much each part's anchor moves the centre of a constellation, and what else does."""

import asterism
import numpy as np

places = np.array([[0.0, 0], [40, 0], [0, 40], [40, 40]])
system = asterism.SpringSystem(asterism.Topology.full(4))
system.set_rest_lengths(places)
system.anchors, system.anchor_stiffness, system.link_stiffness = places, [1, 1, 1, 0.1], 1
system.anchors[3] += 12, 9
x = places.copy()
asterism.solve(system, x, "newton")

# L = the x coordinate of the mean of all parts, so dL/dx is (1/4, 0) for each.
gradient = asterism.sensitivity(system, x, np.tile([0.25, 0], (4, 1)))
for part, share in enumerate(gradient.anchors[:, 0]):
    print(f"the centre follows anchor {part} by {share:.3f}")
for (i, j), slope in zip(system.topology.links, gradient.rest_length):
    print(f"and the rest length of link {i}-{j} by {slope:+.3f}")
