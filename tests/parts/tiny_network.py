"""tiny_network.py OUT: writes a network in ONNX's format (onnx.proto, opset 9), field by field: input -> Conv (3 to 4 channels, 3 x 3,
padding 1, stride 4) "edges" -> Relu "out" -> GlobalAveragePool "mean". The weight of output k, input c, row r, column s is
sin(1 + 27 k + 9 c + 3 r + s), the bias of output k is 0.1 k - 0.1."""

import math
import struct
import sys


def varint(value):
    out = bytearray()
    while value > 127:
        out.append(value & 127 | 128)
        value >>= 7
    return bytes(out + bytes([value]))


def integer(field, value):
    return varint(field << 3) + varint(value)


def block(field, content):
    content = content.encode() if isinstance(content, str) else content
    return varint(field << 3 | 2) + varint(len(content)) + content


def tensor(name, shape, values):
    dims = b"".join(integer(1, n) for n in shape)
    return dims + integer(2, 1) + block(8, name) + block(9, struct.pack(f"<{len(values)}f", *values))


def integers(name, values):
    return block(5, block(1, name) + b"".join(integer(8, v) for v in values) + integer(20, 7))


def node(kind, inputs, output, attributes=b""):
    return b"".join(block(1, i) for i in inputs) + block(2, output) + block(3, output) + block(4, kind) + attributes


def value(name, shape):
    dims = b"".join(block(1, integer(1, n)) for n in shape)
    return block(1, name) + block(2, block(1, integer(1, 1) + block(2, dims)))


def write(file, nodes, tensors, inputs, outputs):
    """tensors: name, shape and values of each; inputs, outputs: name and shape of each."""
    graph = b"".join(block(1, n) for n in nodes) + block(2, "tiny")
    graph += b"".join(block(5, tensor(*t)) for t in tensors)
    graph += b"".join(block(11, value(*i)) for i in inputs) + b"".join(block(12, value(*o)) for o in outputs)
    with open(file, "wb") as out:
        out.write(integer(1, 4) + block(8, block(1, "") + integer(2, 9)) + block(7, graph))


if __name__ == "__main__":
    nodes = [
        node("Conv", ["image", "weights", "bias"], "edges",
             integers("kernel_shape", [3, 3]) + integers("pads", [1, 1, 1, 1]) + integers("strides", [4, 4])),
        node("Relu", ["edges"], "out"),
        node("GlobalAveragePool", ["out"], "mean"),
    ]
    weights = [math.sin(1 + i) for i in range(4 * 3 * 3 * 3)]
    write(sys.argv[1], nodes, [("weights", [4, 3, 3, 3], weights), ("bias", [4], [0.1 * k - 0.1 for k in range(4)])],
          [("image", [1, 3, 128, 128])], [("mean", [1, 4, 1, 1])])
