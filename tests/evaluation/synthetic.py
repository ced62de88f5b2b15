"""Data sets of a textured square that moves, for the tests of asterism-eval. Standard library alone."""

import random
import struct
import zlib

WIDTH, HEIGHT, FRAMES = 160, 120, 40


def png(path, pixels):
    """pixels: rows of bytes, three a pixel."""
    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
    raw = b"".join(b"\0" + row for row in pixels)
    header = struct.pack(">IIBBBBB", WIDTH, HEIGHT, 8, 2, 0, 0, 0)
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(raw, 1)) +
                     chunk(b"IEND", b""))


def make_sequence(folder, seed, frames=FRAMES):
    """A textured square that moves over a dark texture."""
    rng = random.Random(seed)
    background = [bytes(rng.randrange(80) for _ in range(3 * WIDTH)) for _ in range(HEIGHT)]
    blocks = [[bytes(rng.randrange(100, 256) for _ in range(3)) for _ in range(8)] for _ in range(8)]
    (folder / "color").mkdir(parents=True)
    truth = []
    for t in range(frames):
        x, y = 30 + t, 40 + t // 3
        rows = list(background)
        for r in range(32):
            row = b"".join(blocks[r // 4][c // 4] for c in range(32))
            rows[y + r] = rows[y + r][:3 * x] + row + rows[y + r][3 * (x + 32):]
        png(folder / "color" / f"{t + 1:08}.png", rows)
        truth.append(f"{x},{y},32,32")
    (folder / "groundtruth.txt").write_text("\n".join(truth) + "\n")
