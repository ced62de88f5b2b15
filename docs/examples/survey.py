import asterism
import numpy as np

# Twelve devices in a hall of 10 m; each adds a bias of its own, of some 30 cm, to its ranges.
rng = np.random.default_rng(1)
places = rng.uniform(0, 10, (12, 2))
bias = 0.3 * rng.normal(size=12)
ranges = np.linalg.norm(places[:, None] - places[None], axis=-1) + bias[:, None] + bias[None]
ranges = np.abs(ranges + 0.05 * rng.normal(size=(12, 12)))
ranges[3, 7] = ranges[7, 3] = np.nan  # behind a wall

for found in (asterism.survey(ranges, 0.05), asterism.survey(ranges, 0.05, bias=0.3)):
    centred = places - places.mean(axis=0)
    u, _, v = np.linalg.svd(found.x.T @ centred)  # a survey does not know where it is
    errors = np.linalg.norm(found.x @ u @ v - centred, axis=1)
    print(f"energy {found.energy:.0f}, error {np.sqrt(np.mean(errors**2)):.3f} m, of the biases {np.sqrt(np.mean((found.bias - bias)**2)):.3f} m")
