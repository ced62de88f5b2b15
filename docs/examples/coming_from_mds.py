import asterism
import numpy as np

# Measured distances of five points; the matrix is symmetric.
distances = np.array(
    [
        [0, 380, 405, 240, 140],
        [380, 0, 435, 605, 370],
        [405, 435, 0, 545, 545],
        [240, 605, 545, 0, 380],
        [140, 370, 545, 380, 0],
    ]
)
result = asterism.mds(distances)  # from 32 starts; result.x has a row for each point
print(round(result.stress, 2))
