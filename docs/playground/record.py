#!/usr/bin/env python3
"""record.py [FILE] [--video VTEST_AVI]: runs trackers on a clip and writes what trackers.html shows.

Needs the package asterism (docs/python.md), NumPy and Pillow; --video also needs OpenCV's Python module:

    PYTHONPATH=build/release/solver/python python3 docs/playground/record.py
    PYTHONPATH=build/release/solver/python python3 docs/playground/record.py --video build/demo/data/vtest.avi

The first command draws the clip, the same on each run, and writes trackers-data.js: a textured object bends, turns and grows while it
passes behind a post and then enters a shadow. The second one takes a pedestrian of a public video, which trackers/tools/demo.sh
fetches, and writes pedestrian-data.js; where the object truly is was not annotated there. The trackers see the frames as they are; the
files hold them as JPEG, as one background and a part of each frame: what differs from it, or the surroundings of the boxes.
"""
import argparse
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
# Of vtest.avi, as in trackers/tools/demo.sh: the first frame's number, how many frames, the box, the frames behind the lamp post and its sign.
PEDESTRIAN_START, PEDESTRIAN_FRAMES, PEDESTRIAN_BOX, BEHIND = 244, 133, (641, 264, 42, 108), ((277, 283), (354, 359))
PEDESTRIAN_QUALITY, VIEW, MARGIN = 45, (216, 130, 496, 310), 8  # the part of the image that is shown, and around the boxes [px]
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


def jpeg(pixels, quality=QUALITY):
    with io.BytesIO() as file:
        Image.fromarray(pixels[..., ::-1]).save(file, 'JPEG', quality=quality, optimize=True)
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


def follow(name, options, frames, box, corner=(0, 0)):
    """The recorded answers of a tracker, relative to the corner. The first frame, in which the box is given, has only a box."""
    tracker = asterism.Tracker(name, options)
    tracker.init(frames[0], box)
    left, top = corner

    def placed(b):
        return rounded([b[0] - left, b[1] - top, b[2], b[3]])

    answers, links = [{'box': placed(box)}], None
    for image in frames[1:]:
        result = tracker.update(image)
        parts = [[*rounded([*(p.position - corner), *(p.visual_best - corner)], 1), round(p.weight, 3), int(p.updated)] for p in result.parts]
        answer = {'box': placed(result.box), 'angle': round(result.angle, 4), 'confidence': round(result.confidence, 4),
                  'lost': bool(result.lost), 'threshold': round(result.update_threshold, 4), 'parts': parts}
        if result.parts:
            assert len({tuple(p.size) for p in result.parts}) == 1  # true of these trackers
            answer['size'] = rounded(result.parts[0].size, 1)
        if np.array(result.links).tolist() != links:  # left out if they are those of the frame before
            answer['links'] = links = np.array(result.links).tolist()
        answers.append(answer)
    return answers


def surroundings(image, background, boxes):
    """[x, y, image] of the part around the boxes."""
    boxes = np.array(boxes)
    low = np.clip(boxes[:, :2].min(0) - MARGIN, 0, None).astype(int)
    high = np.clip((boxes[:, :2] + boxes[:, 2:]).max(0) + MARGIN, 0, background.shape[1::-1]).astype(int)
    return [int(low[0]), int(low[1]), jpeg(np.ascontiguousarray(image[low[1]:high[1], low[0]:high[0]]), PEDESTRIAN_QUALITY)]


def read_video(path):
    """The frames of the pedestrian."""
    import cv2
    if not pathlib.Path(path).is_file():
        sys.exit(f'record.py: {path}: no such file; `bash trackers/tools/demo.sh` fetches it to build/demo/data/vtest.avi')
    video = cv2.VideoCapture(str(path))
    last = PEDESTRIAN_START + PEDESTRIAN_FRAMES - 1  # numbers are from 1
    frames = [video.read()[1] for _ in range(last)][PEDESTRIAN_START - 1:]
    if any(frame is None for frame in frames):
        sys.exit(f'record.py: {path}: no video, or it ends before frame {last}')
    return frames


def pedestrian(path):
    """The recording of the pedestrian."""
    frames = read_video(path)
    left, top, width, height = VIEW
    shown = [frame[top:top + height, left:left + width] for frame in frames]
    background = np.median(shown[::4], axis=0).astype(np.uint8)
    trackers = []
    for name, options, about in TRACKERS:
        answers = follow(name, options, frames, PEDESTRIAN_BOX, (left, top))
        trackers.append({'name': name, 'options': options, 'about': about, 'frames': answers})
        print(f'{name}: {len(answers[-1]["parts"])} parts, last box {answers[-1]["box"]}')
    patches = [surroundings(image, background, [tracker['frames'][t]['box'] for tracker in trackers]) for t, image in enumerate(shown)]
    hidden = [1 if any(a <= t + PEDESTRIAN_START <= b for a, b in BEHIND) else 0 for t in range(len(frames))]
    clip = {'width': width, 'height': height, 'rate': 10, 'background': jpeg(background), 'frames': patches,
            'hidden': hidden, 'shaded': [0] * len(frames)}
    return {'clip': clip, 'trackers': trackers}


def drawn():
    """The recording of the drawn clip."""
    clip = Clip()
    frames, boxes, shares = zip(*(clip.frame(t) for t in range(FRAMES)))
    background, _, _ = clip.frame(0, with_object=False)
    data = {'clip': {'width': WIDTH, 'height': HEIGHT, 'rate': RATE, 'background': jpeg(background),
                     'frames': [changed(frame, background) for frame in frames], 'boxes': boxes,
                     'hidden': [round(float(h), 3) for h, _ in shares], 'shaded': [round(float(s), 3) for _, s in shares]},
            'trackers': []}
    for name, options, about in TRACKERS:
        answers = follow(name, options, frames, boxes[0])
        for answer, box in zip(answers[1:], boxes[1:]):
            answer['overlap'] = round(overlap(answer['box'], box), 4)
        data['trackers'].append({'name': name, 'options': options, 'about': about, 'frames': answers})
        overlaps = [a['overlap'] for a in answers[1:]]
        print(f'{name}: {len(answers[-1]["parts"])} parts, mean overlap {np.mean(overlaps):.3f}, smallest {min(overlaps):.3f}')
    return data


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('file', nargs='?', type=pathlib.Path)
    parser.add_argument('--video', type=pathlib.Path)
    arguments = parser.parse_args()
    name, variable = ('pedestrian-data.js', 'PEDESTRIAN') if arguments.video else ('trackers-data.js', 'RECORDING')
    output = arguments.file or pathlib.Path(__file__).with_name(name)
    data = pedestrian(arguments.video) if arguments.video else drawn()
    text = json.dumps(data, separators=(',', ':'), allow_nan=False)
    output.write_text(f'// Written by record.py; not edited by hand.\nconst {variable} = ' + text + ';\n')
    print(f'{output.name}: {output.stat().st_size / 1000:.0f} kB')


if __name__ == '__main__':
    main()
