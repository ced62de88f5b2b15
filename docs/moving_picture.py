#!/usr/bin/env python3
"""The moving picture of README.md: moving_picture.py VTEST_AVI OUT.webp

A pedestrian of Debian's vtest.avi (trackers/tools/demo.sh fetches it) who walks behind a lamp post and back, with the box, the parts and the
springs of a tracker. Every second frame, enlarged. Needs OpenCV's Python module and Pillow.
"""
import pathlib
import sys

import asterism
import cv2
import numpy as np
from PIL import Image

START, FRAMES, BOX = 244, 132, (641, 264, 42, 108)
SCALE, WIDTH, HEIGHT = 2, 280, 180  # of the part of the image that is shown [px]
YELLOW, BLUE, RED = (0, 220, 255), (255, 120, 0), (60, 60, 255)  # blue, green, red


def drawn(image, result, corner):
    """The image around corner, enlarged, with the tracker's result."""
    def at(point):
        return tuple(int(round(16 * SCALE * value)) for value in np.asarray(point) - corner)  # 16ths of a pixel

    left, top = corner
    image = cv2.resize(image[top:top + HEIGHT, left:left + WIDTH], None, fx=SCALE, fy=SCALE, interpolation=cv2.INTER_CUBIC)
    corners = np.array([at(point) for point in result.corners()])
    cv2.polylines(image, [corners], True, YELLOW, 2, cv2.LINE_AA, 4)
    for i, j in result.links:
        cv2.line(image, at(result.parts[i].position + 0.5), at(result.parts[j].position + 0.5), BLUE, 2, cv2.LINE_AA, 4)
    for part in result.parts:  # red: it did not learn from this frame
        cv2.circle(image, at(part.position + 0.5), 16 * 5, BLUE if part.updated else RED, -1, cv2.LINE_AA, 4)
    return Image.fromarray(image[..., ::-1])


def main(video, out):
    if not pathlib.Path(video).is_file():
        sys.exit(f'moving_picture.py: {video}: no such file; `bash trackers/tools/demo.sh` fetches it to build/demo/data/vtest.avi')
    frames = cv2.VideoCapture(video)
    for _ in range(START - 1):
        frames.grab()
    tracker, pictures, middle = asterism.Tracker(), [], None
    for number in range(FRAMES):
        read, image = frames.read()
        if not read:
            sys.exit(f'moving_picture.py: {video} ends before frame {START + number}')
        if number == 0:
            tracker.init(image, BOX)
            continue
        result = tracker.update(image)
        x, y, width, height = result.box
        found = np.array([x + width / 2, y + height / 2])
        middle = found if middle is None else 0.9 * middle + 0.1 * found  # the view follows slowly
        corner = np.clip(middle - (WIDTH / 2, HEIGHT / 2), 0, (image.shape[1] - WIDTH, image.shape[0] - HEIGHT)).astype(int)
        if number % 2:
            pictures.append(drawn(image, result, corner))
    pictures[0].save(out, save_all=True, append_images=pictures[1:], duration=100, loop=0, quality=32, method=6)


if __name__ == '__main__':
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    main(*sys.argv[1:])
