import asterism
import numpy as np

anchors = np.array([[0.0, 0], [40, 0], [0, 40], [40, 40]])  # four parts in a square of 40 px
system = asterism.SpringSystem(asterism.Topology.full(4))
system.set_rest_lengths(anchors)
system.anchors, system.anchor_stiffness, system.link_stiffness = anchors, (0.5, 0.5, 0.5, 0.05), 1
system.anchors[3] = 70, 55  # the last part was seen far off, with little certainty
x = system.anchors.copy()  # the start, then the result: one row per part
print(asterism.solve(system, x))
print(x.round(4))
