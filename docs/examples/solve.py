import asterism
import numpy as np

anchors = np.array([[0.0, 0], [40, 0], [0, 40], [40, 40]])
system = asterism.SpringSystem(asterism.Topology.full(4))
system.set_rest_lengths(anchors)
system.anchors, system.anchor_stiffness, system.link_stiffness = anchors, 0.5, 1
system.anchors[3] = 70, 55
x = anchors.copy()
print(asterism.solve(system, x, method="ida"), x)  # x is the result
