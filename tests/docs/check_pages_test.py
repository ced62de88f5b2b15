#!/usr/bin/env python3
"""check_pages.py finds what it is for, and nothing in a page that is right."""
import pathlib
import sys
import tempfile
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).parent))
import check_pages

GOOD = '''# A page

See [below](#what-it-is-for), [the other](docs/other.md#its-heading) and [a host](https://example.org/x).

```cpp
int main() {}
```

```text
printed
```

```sh
asterism-fake run --known 3 && cmake -DASTERISM_KNOWN=ON -S . -B build
python3 bench/draw.py --size 4
```

<!-- not run: needs a camera -->
```text
whatever
```

## What it is for
'''

BAD = {
    'an indented block': '    int x;\n',
    'not at the left margin': '  ```cpp\n',
    'output that nothing': '```text\nx\n```\n',
    'not JSON': '```json\n{\n```\n',
    'does not run the blocks': '```python\nx\n```\n',
    'which no test knows': '```perl\nx\n```\n',
    'does not include README_1.inc once': '```cpp fragment\nf();\n```\n',
    'knows no option --unknown': '```sh\nasterism-fake run --unknown\n```\n',
    'knows no option --color': '```sh\npython3 bench/draw.py --color\n```\n',
    'is no program of the project': '```sh\nasterism-none\n```\n',
    'is not a known command': '```sh\nfrobnicate x\n```\n',
    'bench/none.py is not in the project': '```sh\npython3 bench/none.py\n```\n',
    'no option ASTERISM_UNKNOWN': '```sh\ncmake -DASTERISM_UNKNOWN=ON\n```\n',
    'no preset': '```sh\ncmake --preset none\n```\n',
    'there is no such file': '[x](docs/none.md)\n',
    'there is no such heading': '[x](docs/other.md#none)\n',
    'is no URL': '[x](https://nowhere)\n',
}


class CheckPages(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.root = pathlib.Path(self.folder.name).resolve()
        for file, text in {'docs/other.md': '# Other\n\n## Its `heading`\n', 'bench/draw.py': "'--size'\n",
                           'CMakePresets.json': '{"configurePresets": [{"name": "release"}]}',
                           'CMakeLists.txt': 'option(ASTERISM_KNOWN "known" ON)\n'}.items():
            (self.root / file).parent.mkdir(exist_ok=True)
            (self.root / file).write_text(text)
        self.tool = self.root / 'asterism-fake'
        self.tool.write_text('#!/bin/sh\necho "  --help"\n[ "$1" != run ] || echo "  --known INT"\n')
        self.tool.chmod(0o755)

    def tearDown(self):
        self.folder.cleanup()

    def problems(self, text):
        (self.root / 'README.md').write_text(text)
        return list(check_pages.problems_of(self.root, [str(self.tool)]))

    def test_good(self):
        self.assertEqual(self.problems(GOOD), [])

    def test_bad(self):
        for problem, text in BAD.items():
            with self.subTest(problem):
                found = self.problems(text)
                self.assertEqual(len(found), 1, found)
                self.assertIn(problem, found[0])
                self.assertTrue(found[0].startswith('README.md:'))


if __name__ == '__main__':
    unittest.main()
