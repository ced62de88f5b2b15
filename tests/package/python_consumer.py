"""What python3-asterism is for, with NumPy alone: a solve, copies, and an object followed."""

import pickle

import asterism
import numpy as np

x = np.array([[0.0, 0], [4, 0]])
system = asterism.SpringSystem(asterism.Topology.full(2))
system.anchors, system.anchor_stiffness, system.rest_length, system.link_stiffness = x, 1, 2, 0.5
assert asterism.solve(pickle.loads(pickle.dumps(system)), x)
assert abs(x[1, 0] - x[0, 0] - 3) < 1e-6  # k (4 - d) / 2 = k_12 (d - 2)

random = np.random.default_rng(1)
background, square = (random.integers(0, 255, (*size, 3), np.uint8) for size in ((120, 160), (30, 30)))


def frame(k):
    image = background.copy()
    image[40 + k : 70 + k, 50 + 2 * k : 80 + 2 * k] = square
    return image


tracker = asterism.Tracker("dpt", {"grid_rows": 2})
tracker.init(frame(0), (50, 40, 30, 30))
for k in range(1, 10):
    left, top, *_ = tracker.update(frame(k)).box
    assert abs(left - 50 - 2 * k) < 3 and abs(top - 40 - k) < 3, (k, left, top)
print("asterism", asterism.__version__, "for Python")
