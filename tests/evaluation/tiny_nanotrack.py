"""tiny_nanotrack.py FOLDER: writes two networks with the inputs and outputs of NanoTrack's. backbone.onnx: the means of the colors
in cells of 16 x 16 pixels. head.onnx: for each cell of the search window, the score of the background is 0, that of the object is
3 (blue - green) / 255, and the distances to the left, top, right and bottom are 60, 70, 66 and 60. The template is a third output,
because OpenCV refuses an input that is not used."""

import os
import sys

sys.path.append(os.path.join(os.path.dirname(os.path.abspath(__file__)), os.pardir, "parts"))
from tiny_network import integers, node, write

folder = sys.argv[1]
os.makedirs(folder, exist_ok=True)
write(os.path.join(folder, "backbone.onnx"),
      [node("AveragePool", ["input"], "features", integers("kernel_shape", [16, 16]) + integers("strides", [16, 16]))], [],
      [("input", [1, 3, 255, 255])], [("features", [1, 3, 15, 15])])
pointwise = integers("kernel_shape", [1, 1])
write(os.path.join(folder, "head.onnx"),
      [node("Conv", ["input2", "scores", "no_bias"], "output1", pointwise),
       node("Conv", ["input2", "nothing", "distances"], "output2", pointwise),
       node("Relu", ["input1"], "template")],
      [("scores", [2, 3, 1, 1], [0, 0, 0, 3 / 255, -3 / 255, 0]), ("no_bias", [2], [0, 0]),
       ("nothing", [4, 3, 1, 1], [0] * 12), ("distances", [4], [60, 70, 66, 60])],
      [("input1", [1, 3, 7, 7]), ("input2", [1, 3, 15, 15])],
      [("output1", [1, 2, 15, 15]), ("output2", [1, 4, 15, 15]), ("template", [1, 3, 7, 7])])
