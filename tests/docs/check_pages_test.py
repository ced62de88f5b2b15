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

<!-- file: docs/examples/good.cpp -->
```cpp
#include <iostream>

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

PROGRAM = '#include <iostream>\n\nint main() {}\n'
SHOWN = f'<!-- file: docs/examples/good.cpp -->\n```cpp\n{PROGRAM}```\n'

BAD = {
    'an indented block': '    int x;\n',
    'not at the left margin': '  ```cpp\n',
    'output that nothing': '```text\nx\n```\n',
    'not JSON': '```json\n{\n```\n',
    'a program that is no file': '```cpp\nint main() {}\n```\n',
    'docs/examples/none.cpp is not in the project': '<!-- file: docs/examples/none.cpp -->\n```cpp\nint main() {}\n```\n',
    'no block follows': '<!-- file: docs/examples/good.cpp -->\n\nA sentence.\n',
    'nor does tests/python run the blocks': '```python\nx\n```\n',
    'which no test knows': '```perl\nx\n```\n',
    'does not include README_1.inc once': '```cpp fragment\nf();\n```\n',
    'knows no option --unknown': '```sh\nasterism-fake run --unknown\n```\n',
    'knows no option --color': '```sh\npython3 bench/draw.py --color\n```\n',
    'is no program of the project': '```sh\nasterism-none\n```\n',
    'is not a known command': '```sh\nfrobnicate x\n```\n',
    'bench/none.py is not in the project': '```sh\npython3 bench/none.py\n```\n',
    'no option ASTERISM_UNKNOWN': '```sh\ncmake -DASTERISM_UNKNOWN=ON\n```\n',
    'no preset': '```sh\ncmake --preset none\n```\n',
    '160 columns, more than 150': 'word ' * 31 + 'words\n',
    'there is no such file': '[x](docs/none.md)\n',
    'there is no such heading': '[x](docs/other.md#none)\n',
    'is no URL': '[x](https://nowhere)\n',
}


class CheckPages(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.root = pathlib.Path(self.folder.name).resolve()
        for file, text in {'docs/other.md': '# Other\n\n## Its `heading`\n\n' + SHOWN, 'bench/draw.py': "'--size'\n",
                           'docs/examples/good.cpp': PROGRAM, 'docs/examples/CMakeLists.txt': 'example(good x)  # bad\n',
                           'CMakePresets.json': '{"configurePresets": [{"name": "release"}]}',
                           'CMakeLists.txt': 'option(ASTERISM_KNOWN "known" ON)\n'}.items():
            (self.root / file).parent.mkdir(parents=True, exist_ok=True)
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

    def test_block_that_is_not_its_file(self):
        before = 'A page.\n\n'
        for change in (('main()', 'main(int)'), ('\nint main', '\nint x;\nint main'), ('int main() {}\n', '')):
            with self.subTest(change):
                found = self.problems(before + SHOWN.replace(*change))
                self.assertEqual(len(found), 1, found)
                self.assertRegex(found[0], r'^README.md:7: not line 3 of docs/examples/good.cpp')

    def test_update(self):
        page = 'A page.\n\n' + SHOWN.replace('{}', '{ return 1; }') + '\nAfter it.\n\n' + SHOWN.replace('\nint', '\n\nint') + 'End.\n'
        self.assertEqual(len(self.problems(page)), 2)
        check_pages.update(self.root)
        self.assertEqual((self.root / 'README.md').read_text(), 'A page.\n\n' + SHOWN + '\nAfter it.\n\n' + SHOWN + 'End.\n')
        self.assertEqual(list(check_pages.problems_of(self.root, [])), [])

    def test_figures_of_another_page(self):
        (self.root / 'docs/other.md').write_text(
            '# Other\n\n<!-- not run: x -->\n```text\n| no | A |\n|---|---|\n| mine | 7 |\n```\n\n| t | A | B |\n|---|---|---|\n| `mine` | **0.564** (0.5 to 0.6) | 16.6 |\n'
            '| yours | 2 | 3 |\n\n## Later\n\n| t | A |\n|---|---|\n| mine | 9 |\n\nIt takes some\n9.3 s here, and 4 ms or 5 ms there.\n\n' + SHOWN)
        mark = '<!-- figure of docs/other.md: mine, A -->'
        right = (f'It has 0.56{mark} and\n{"0.564" + mark}, **17**<!-- figure of docs/other.md: B, mine --> times, later 9<!-- figure of docs/other.md#later: mine, A -->.\n\n'
                 'In 9<!-- figure of docs/other.md: "takes some # s here" --> s.\n\n'
                 '<!-- figures of docs/other.md: me = mine, size = B -->\n| | me | yours | third |\n|---|---|---|---|\n| A | **0.56** | 2.0 | 5 |\n| size | 16.6 | 3 | |\n| C | 1 | 2 | |\n\n'
                 '<!-- figures of docs/other.md -->\n| t | A |\n|---|---|\n| mine | 0.564 (0.5 to 0.6) |\n')
        self.assertEqual(self.problems(right), [])
        for old, new, line in (('0.56<', '0.57<', 1), ('0.564<', '0.565<', 2), ('**17**', '**16**', 2), ('later 9', 'later 8', 2), ('In 9', 'In 8', 4), ('**0.56**', '**0.55**', 9),
                               ('| 3 | |', '| 4 | |', 10), ('to 0.6)', 'to 0.7)', 16)):
            with self.subTest(new):
                found = self.problems(right.replace(old, new))
                self.assertEqual(len(found), 1, found)
                self.assertTrue(found[0].startswith(f'README.md:{line}: a figure differs from its page'), found)
                check_pages.update(self.root)
                self.assertEqual((self.root / 'README.md').read_text(), right)
        for text, problem in ((f'1{mark}'.replace('A -->', 'C -->'), 'docs/other.md has no figure in mine, C'), (f'1{mark}'.replace('other', 'none'), 'docs/none.md has no figure'),
                              ('9<!-- figure of docs/other.md: "takes # s" -->', 'docs/other.md has no figure in "takes # s"'),
                              ('4<!-- figure of docs/other.md: "# ms" -->', 'has no figure in "# ms"'), (f'1 {mark}', 'a figure has the form'), ('<!-- figures of docs/other.md -->\n| t | A |\n|---|---|\n| x | 1 |\n', 'have no figure of the next table')):
            with self.subTest(text):
                found = self.problems(text)
                self.assertEqual(len(found), 1, found)
                self.assertIn(problem, found[0])

    def test_long_example_of_the_readme(self):
        (self.root / 'docs/examples/good.cpp').write_text(PROGRAM + '\nint x;\n' * 12)
        (self.root / 'README.md').write_text(SHOWN)
        check_pages.update(self.root)
        found = list(check_pages.problems_of(self.root, []))
        self.assertEqual(found, ['README.md:2: 13 lines of code, more than the 12 of an example of README.md'])

    def test_example_without_page_or_target(self):
        (self.root / 'docs/examples/folder').mkdir()
        for file in ('bad.cpp', 'bad.py', 'folder/good.cpp'):
            (self.root / 'docs/examples' / file).write_text('')
        found = self.problems(GOOD)
        self.assertEqual(found, ['docs/examples/bad.cpp:1: no page shows it',
                                 'docs/examples/bad.cpp:1: docs/examples/CMakeLists.txt does not build it',
                                 'docs/examples/bad.py:1: no page names it',
                                 'docs/examples/folder/good.cpp:1: no page links to it'])
        (self.root / 'docs/other.md').write_text('# Other\n\n## Its heading\n\n`bad.py` draws [one](examples/folder/good.cpp).\n')
        self.assertEqual(self.problems(GOOD)[2:], [])


if __name__ == '__main__':
    unittest.main()
