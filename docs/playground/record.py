#!/usr/bin/env python3
"""record.py [FILE]: draws a clip, runs trackers on it and writes trackers-data.js, which trackers.html shows.

Needs the package asterism (docs/python.md), NumPy and Pillow:

    PYTHONPATH=build/release/solver/python python3 docs/playground/record.py

The clip is the same on each run: a textured object bends, turns and grows while it passes behind a post and then enters a
shadow. The trackers see the frames as drawn; the file holds them as JPEG, as one background and the part of each frame
that differs from it.
"""
import base64
import io
import json
import pathlib
import sys

import asterism
import numpy as np
from PIL import Image

WIDTH, HEIGHT, FRAMES, RATE = 320, 240, 120, 25
HALF = np.array([30.0, 38.0])  # half the object's size [px]
POST = (142, 164)              # columns
SHADOW = 0.45                  # brightness in it
QUALITY = 62
TRACKERS = [
    ('dpt', {'grid_rows': 3}, 'DPT with six parts, each a correlation filter, under a filter of the whole object'),
    ('dpt_plus', {'grid_rows': 3}, 'DPT with a root that learns from its surroundings, and a scale filter'),
    ('lgt', {}, 'many small histograms whose number changes, and maps of color, motion and shape'),
    ('kcf', {}, 'one correlation filter on the whole object, without parts'),
]


def smooth(values, step):
    """A grid of random values, enlarged by smooth interpolation."""
    for axis in (0, 1):
        size = (values.shape[axis] - 1) * step
        place = np.arange(size) / step
        low = place.astype(int)
        share = place - low
        share = (share * share * (3 - 2 * share)).reshape([-1 if a == axis else 1 for a in range(3)])
        values = values.take(low, axis) * (1 - share) + values.take(low + 1, axis) * share
    return values


def texture(random, height, width, step, low, high):
    """Blobs of `step` pixels; low and high are colors (red, green, blue)."""
    size = height // step + 2, width // step + 2
    grid = 0.75 * random.random((*size, 1)) + 0.25 * random.random((*size, 3))
    return np.array(low) + (np.array(high) - low) * smooth(grid, step)[:height, :width]


def sample(image, x, y):
    """Bilinear interpolation; beyond the border, the nearest pixel."""
    x, y = np.clip(x, 0, image.shape[1] - 1.001), np.clip(y, 0, image.shape[0] - 1.001)
    left, top = x.astype(int), y.astype(int)
    a, b = (x - left)[..., None], (y - top)[..., None]
    return ((image[top, left] * (1 - a) + image[top, left + 1] * a) * (1 - b)
            + (image[top + 1, left] * (1 - a) + image[top + 1, left + 1] * a) * b)


class Clip:
    def __init__(self):
        random = np.random.default_rng(5)
        self.ground = texture(random, HEIGHT, WIDTH, 16, (92, 112, 84), (176, 184, 150))
        self.object = texture(random, 2 * int(HALF[1]) + 20, 2 * int(HALF[0]) + 20, 7, (70, 8, 24), (255, 190, 70))
        self.post = 60 + 70 * np.sin(np.linspace(0.35, 2.9, POST[1] - POST[0]))[:, None]  # round, lit from the front
        self.y, self.x = np.mgrid[0:HEIGHT, 0:WIDTH].astype(float)
        edge = np.clip((self.x + 0.25 * self.y - 240) / 14, 0, 1)
        self.light = (1 - (1 - SHADOW) * edge * edge * (3 - 2 * edge))[..., None]

    def frame(self, t, with_object=True):
        """The pixels (blue, green, red) of frame t, the object's true box, and which shares of it are hidden and shaded."""
        image, box, shares = self.ground, None, None
        if with_object:
            u, v, inside = self.placed(t)
            cover = np.clip(0.5 + 8 * (1 - inside), 0, 1)[..., None]
            centre = (np.array(self.object.shape[1::-1]) - 1) / 2
            image = image * (1 - cover) + sample(self.object, u + centre[0], v + centre[1]) * cover
            rows, columns = np.nonzero(inside <= 1)
            in_post = (columns >= POST[0]) & (columns < POST[1])
            shares = [in_post.mean(), (self.light[rows, columns, 0] < (1 + SHADOW) / 2).mean()]
            box = [float(columns.min()), float(rows.min()), float(np.ptp(columns) + 1), float(np.ptp(rows) + 1)]
        image = image * self.light
        image[:, POST[0]:POST[1]] = self.post
        return np.ascontiguousarray(np.clip(image + 0.5, 0, 255).astype(np.uint8)[..., ::-1]), box, shares

    def placed(self, t):
        """The object's coordinates at each pixel, and a function that is 1 on the object's outline."""
        s = t / (FRAMES - 1)
        x, y = self.x - (58 + 196 * s), self.y - (118 + 16 * np.sin(2 * np.pi * s))
        angle, scale = 0.22 * np.sin(2.4 * np.pi * s), 1 + 0.15 * s
        x, y = (np.cos(angle) * x + np.sin(angle) * y) / scale, (np.cos(angle) * y - np.sin(angle) * x) / scale
        x = x - 9 * np.sin(4 * np.pi * s) * ((y / HALF[1]) ** 2 - 1 / 3)  # bends
        return x, y, (np.abs(x / HALF[0]) ** 4 + np.abs(y / HALF[1]) ** 4) ** 0.25


def jpeg(pixels):
    with io.BytesIO() as file:
        Image.fromarray(pixels[..., ::-1]).save(file, 'JPEG', quality=QUALITY, optimize=True)
        return 'data:image/jpeg;base64,' + base64.b64encode(file.getvalue()).decode()


def changed(pixels, background):
    """[x, y, image] of the part that differs from the background."""
    rows, columns = np.nonzero((pixels != background).any(axis=2))
    top, bottom, left, right = rows.min(), rows.max() + 1, columns.min(), columns.max() + 1
    return [int(left), int(top), jpeg(np.ascontiguousarray(pixels[top:bottom, left:right]))]


def overlap(a, b):
    width = min(a[0] + a[2], b[0] + b[2]) - max(a[0], b[0])
    height = min(a[1] + a[3], b[1] + b[3]) - max(a[1], b[1])
    shared = max(0, width) * max(0, height)
    return shared / (a[2] * a[3] + b[2] * b[3] - shared)


def rounded(values, digits=2):
    return [round(float(v), digits) for v in values]


def follow(name, options, frames, boxes):
    """The recorded answers of a tracker. The first frame, in which the box is given, has only a box."""
    tracker = asterism.Tracker(name, options)
    tracker.init(frames[0], boxes[0])
    answers, links = [{'box': rounded(boxes[0])}], None
    for image, box in zip(frames[1:], boxes[1:]):
        result = tracker.update(image)
        answer = {'box': rounded(result.box), 'angle': round(result.angle, 4), 'confidence': round(result.confidence, 4),
                  'lost': bool(result.lost), 'overlap': round(overlap(result.box, box), 4), 'threshold': round(result.update_threshold, 4),
                  'parts': [[*rounded([*p.position, *p.visual_best], 1), round(p.weight, 3), int(p.updated)] for p in result.parts]}
        if result.parts:
            assert len({tuple(p.size) for p in result.parts}) == 1  # true of these trackers
            answer['size'] = rounded(result.parts[0].size, 1)
        if np.array(result.links).tolist() != links:  # left out if they are those of the frame before
            answer['links'] = links = np.array(result.links).tolist()
        answers.append(answer)
    return answers


def main():
    output = pathlib.Path(sys.argv[1]) if len(sys.argv) > 1 else pathlib.Path(__file__).with_name('trackers-data.js')
    clip = Clip()
    frames, boxes, shares = zip(*(clip.frame(t) for t in range(FRAMES)))
    background, _, _ = clip.frame(0, with_object=False)
    data = {'clip': {'width': WIDTH, 'height': HEIGHT, 'rate': RATE, 'background': jpeg(background),
                     'frames': [changed(frame, background) for frame in frames], 'boxes': boxes,
                     'hidden': [round(float(h), 3) for h, _ in shares], 'shaded': [round(float(s), 3) for _, s in shares]},
            'trackers': []}
    for name, options, about in TRACKERS:
        answers = follow(name, options, frames, boxes)
        data['trackers'].append({'name': name, 'options': options, 'about': about, 'frames': answers})
        overlaps = [a['overlap'] for a in answers[1:]]
        print(f'{name}: {len(answers[-1]["parts"])} parts, mean overlap {np.mean(overlaps):.3f}, smallest {min(overlaps):.3f}')
    text = json.dumps(data, separators=(',', ':'), allow_nan=False)
    output.write_text('// Written by record.py; not edited by hand.\nconst RECORDING = ' + text + ';\n')
    print(f'{output.name}: {output.stat().st_size / 1000:.0f} kB')


if __name__ == '__main__':
    main()
