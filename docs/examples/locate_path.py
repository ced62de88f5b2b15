import asterism
import numpy as np

# A robot drives along a circle in a hall with three beacons, and hears one of them at each pose [m, rad].
rng = np.random.default_rng(1)
beacons = np.array([[0, 0], [20, 0], [10, 15]])
angle = np.arange(100) * 0.1
truth = np.stack([10 + 5 * np.cos(angle), 7 + 5 * np.sin(angle)], axis=1)
steps = np.column_stack([np.full(99, 0.5), np.zeros(99), 0.1 + 0.01 * rng.normal(size=99)])  # forward, left, turn
beacon = np.arange(100) % 3
ranges = np.linalg.norm(truth - beacons[beacon], axis=1) + 0.1 * rng.normal(size=100)
ranges[::10] += 4  # some signals went around a corner

path = asterism.locate_path(steps, beacons, np.arange(100), beacon, ranges, 0.1, cutoff=2)
error = np.sqrt(np.mean(np.sum((path.x - truth) ** 2, axis=1)))
print(f"error {error:.2f} m, of the last position +-{path.covariance[-1].trace() ** 0.5:.2f} m; {path.outliers.sum()} outliers")
