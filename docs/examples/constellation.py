import asterism
import numpy as np

anchors = np.array([[0.0, 0], [40, 0], [0, 40], [40, 40]])  # (N, dim): one row for each node
system = asterism.SpringSystem(asterism.Topology.full(4), dim=2)
system.set_rest_lengths(anchors)
system.anchors = anchors
system.anchors[3] = 70, 55  # the last part was seen far off, with little certainty
system.anchor_stiffness = 0.5, 0.5, 0.5, 0.05
system.link_stiffness = 1

x = system.anchors.copy()  # the start, then the result
summary = asterism.solve(system, x)
print(np.round(x, 3))
print(summary.status.name, round(summary.final_energy, 4))
