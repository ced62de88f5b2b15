#!/usr/bin/env python3
"""Tracks an object through a video or a folder of images, and draws frames with its parts and the confidence.

Videos need OpenCV's Python module (Debian package python3-opencv), images in a folder do not.
"""

import argparse
import pathlib
from typing import Iterator

import asterism
import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from PIL import Image

IMAGES = {".jpg", ".jpeg", ".png", ".bmp", ".ppm", ".pgm", ".tif", ".tiff"}


def frames(path: pathlib.Path) -> Iterator[np.ndarray]:
    """The images of a video or, by name, of a folder: (height, width, 3) in the order blue, green, red."""
    if path.is_dir():
        for file in sorted(file for file in path.iterdir() if file.suffix.lower() in IMAGES):
            yield np.ascontiguousarray(np.asarray(Image.open(file).convert("RGB"))[..., ::-1])
        return
    import cv2

    video = cv2.VideoCapture(str(path))
    video.set(cv2.CAP_PROP_ORIENTATION_AUTO, 0)  # frames are turned below, as OpenCV 4.6.0 turns them the wrong way
    degrees = int(video.get(cv2.CAP_PROP_ORIENTATION_META)) * (-1 if cv2.__version__ == "4.6.0" else 1)
    while True:
        read, image = video.read()
        if not read:
            return
        yield np.rot90(image, -degrees // 90)


def draw(axes: plt.Axes, image: np.ndarray, result: asterism.TrackResult, frame: int) -> None:
    axes.imshow(image[..., ::-1])
    for link in result.links:
        axes.plot(*np.stack([result.parts[node].position for node in link]).T, color="tab:blue", linewidth=1)
    for part in result.parts:
        color = "tab:blue" if part.updated else "tab:red"
        axes.plot(*part.position, "o", color=color, markersize=4)
    corners = result.corners() - 0.5  # shifted so that the centre of the top left pixel is (0, 0)
    axes.plot(*np.vstack([corners, corners[:1]]).T, color="yellow")
    axes.set_title(f"frame {frame}", fontsize=9)
    axes.set_axis_off()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("video", type=pathlib.Path, help="a video, or a folder of images")
    parser.add_argument("--box", required=True, help="x,y,width,height in the first frame")
    parser.add_argument("--tracker", default="dpt_plus", choices=asterism.tracker_names())
    parser.add_argument("--frames", type=int, default=0, help="frames at most (default: all)")
    parser.add_argument("--out", default="track.png", help="the figure (default: %(default)s)")
    arguments = parser.parse_args()
    box = tuple(float(number) for number in arguments.box.split(","))

    tracker = asterism.Tracker(arguments.tracker)
    results = []
    shown, every = {}, 1  # frames for the figure, thinned out as they come
    for frame, image in enumerate(frames(arguments.video), 1):
        if frame == 1:
            tracker.init(image, box)
            continue
        results.append(tracker.update(image))
        if frame % every == 0:
            shown[frame] = image, results[-1]
        if len(shown) == 8:
            every *= 2
            shown = {kept: shown[kept] for kept in shown if kept % every == 0}
        if frame == arguments.frames:
            break
    if not results:
        raise SystemExit(f"{arguments.video}: fewer than two images")
    milliseconds = np.mean([result.milliseconds for result in results])
    print(f"{arguments.tracker}: {len(results)} frames, {milliseconds:.2f} ms each, last box {np.round(results[-1].box, 1)}")

    figure = plt.figure(figsize=(11, 5.5), layout="constrained")
    rows = figure.subfigures(2, 1, height_ratios=[2, 1])
    for axes, (frame, (image, result)) in zip(rows[0].subplots(1, len(shown), squeeze=False)[0], shown.items()):
        draw(axes, image, result, frame)
    axes = rows[1].subplots()
    numbers = np.arange(2, len(results) + 2)
    axes.plot(numbers, [result.confidence for result in results], label="confidence")
    lost = numbers[[result.lost for result in results]]
    axes.plot(lost, np.zeros(len(lost)), "|", color="tab:red", label="lost")
    axes.set(xlabel="frame", ylim=(-0.05, 1.05))
    axes.legend()
    figure.savefig(arguments.out, dpi=120)


if __name__ == "__main__":
    main()
