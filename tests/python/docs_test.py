#!/usr/bin/env python3
"""Runs the ```python blocks of a page, one after the other as in one session: docs_test.py PAGE"""

import contextlib
import os
import pathlib
import re
import sys
import tempfile

from moving_square import draw_frame, write_png

page = pathlib.Path(sys.argv[1])
text = page.read_text()
blocks = list(re.finditer(r"^```python\n(.*?)^```\n(?:\n```text\n(.*?)^```\n)?", text, re.MULTILINE | re.DOTALL))
assert len(blocks) == text.count("```python") > 0, "a block that is not found"
session = {}
with tempfile.TemporaryDirectory() as folder:
    os.chdir(folder)
    os.mkdir("images")  # for the page's video
    for frame in range(8):
        write_png(f"images/{frame:04}.png", draw_frame(frame))
    for block in blocks:
        code, expected = block.groups()
        line = text.count("\n", 0, block.start(1))
        out = pathlib.Path("out")
        with out.open("w") as file, contextlib.redirect_stdout(file):
            exec(compile("\n" * line + code, page, "exec"), session)  # errors show the page's line numbers
        assert expected is None or out.read_text() == expected, f"{page}:{line}: prints\n{out.read_text()}"
    os.chdir("/")
