import asterism
import numpy as np

shape = np.array([[0.0, 0], [40, 0], [0, 40], [40, 40]])  # one row per node
system = asterism.SpringSystem(asterism.Topology.full(4))  # or Topology.from_links(4, [(0, 1), ...])
system.set_rest_lengths(shape)
system.anchors, system.anchor_stiffness, system.link_stiffness = shape, (0.5, 0.5, 0.5, 0.05), 1
system.anchors[3] = 70, 55

x = system.anchors.copy()  # the start, then the result
print(asterism.solve(system, x).status.name)  # or solve(system, x, "lbfgs", tolerance=1e-10)
print(asterism.certify(system, x).proof)  # is it the global minimum?
print(asterism.node_covariances(system, x).shape)  # how certain is it?

points = np.random.default_rng(1).normal(size=(20, 2))
distances = np.linalg.norm(points[:, None] - points, axis=2)
print(asterism.mds(distances).stress < 1e-12)  # points from distances
print(len(asterism.layout([("a", "b"), ("b", "c"), ("c", "a")]).pos))  # the drawing of a graph
print(asterism.locate([[0, 0], [4, 0], [0, 3]], [2.5, 2.5, 2.5], 0.1).minima[0].x.round(3))  # a place from ranges

image = np.random.default_rng(2).integers(0, 256, (120, 160, 3), np.uint8)  # height, width, blue green red
tracker = asterism.Tracker("dpt_plus")  # asterism.tracker_names() lists all
tracker.init(image, (60, 40, 32, 24))  # x, y, width, height [px]
result = tracker.update(image)
print(np.round(result.box), result.lost)
