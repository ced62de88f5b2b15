"""A scene that any tracker follows: a bright textured square that moves over dim texture."""

import numpy as np
from PIL import Image

#: The box in the first frame.
BOX = (60, 50, 48, 40)


def true_box(frame):
    """Frames count from 0."""
    return (BOX[0] + 3 * frame, BOX[1] + frame, BOX[2], BOX[3])


def _texture(height, width, low, high, seed):
    random = np.random.default_rng(seed)
    blocks = random.integers(low, high, (-(-height // 4), -(-width // 4), 3), dtype=np.uint16).astype(np.uint8)
    return blocks.repeat(4, axis=0).repeat(4, axis=1)[:height, :width]


def draw_frame(frame):
    """(240, 320, 3), blue, green, red."""
    image = _texture(240, 320, 20, 90, 1)
    x, y, width, height = true_box(frame)
    image[y : y + height, x : x + width] = _texture(height, width, 100, 256, 2)
    return np.ascontiguousarray(image)


def write_png(path, image):
    Image.fromarray(image[..., ::-1]).save(path)
