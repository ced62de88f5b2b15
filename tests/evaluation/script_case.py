"""For tests of a script of bench/evaluation, SCRIPT, which is the first argument. Ends with 77 without NumPy, which these scripts need."""

import pathlib
import subprocess
import sys
import tempfile
import unittest

SCRIPT = pathlib.Path(sys.argv[1])
del sys.argv[1:]
try:
    import numpy  # noqa: F401
except ImportError:
    print("needs NumPy")
    sys.exit(77)

RETURNS_HEAD = "tracker,kind,sequence,frame,state,overlap,milliseconds\n"  # of asterism-returns


class ScriptCase(unittest.TestCase):
    """A test with a folder of its own, `root`."""

    def setUp(self):
        scratch = tempfile.TemporaryDirectory()
        self.addCleanup(scratch.cleanup)
        self.root = pathlib.Path(scratch.name)

    @staticmethod
    def run_script(*arguments):
        return subprocess.run([sys.executable, SCRIPT, *arguments], capture_output=True, text=True)
