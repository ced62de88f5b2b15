#!/usr/bin/env python3
"""check_names.py PROJECT: names of files in comments and pages that are not in the project, a line each; no output if all are.

A name counts where its path ends like that of a file of the project. Files of others, and those that programs write, are
listed here.
"""
import pathlib
import re
import sys

ROOMS = ['solver', 'parts', 'trackers', 'bench', 'tests', 'docs', '.ci', '.cmake', '.packaging']
NAME = re.compile(r'(?<![\w./<>*$}-])((?:[\w.-]+/)*[\w-]+\.(?:hpp|cpp|py|pyi|sh|cmake|md))(?![\w/(-])')
COMMENT = {'.hpp': r'//.*', '.cpp': r'//.*', '.py': r'(?<!\S)# [^\n]*|""".*?"""', '.sh': r'(?<!\S)# .*', '.cmake': r'(?<!\S)# .*', '.txt': r'(?<!\S)# .*', '.md': r'.*'}
OTHERS = set('''
multistart.py supervised.py vot/analysis/supervised.py vot/analysis/multistart.py vot.py
bench/laboratory/solvers/spectral.cpp my_tracker.py
'''.split())


def names_in(path):
    text = path.read_text(encoding='utf-8', errors='replace')
    for part in re.finditer(COMMENT[path.suffix], text, re.DOTALL if path.suffix == '.py' else 0):
        for name in NAME.findall(part.group()):
            yield text.count('\n', 0, part.start()) + 1, name


def main():
    root = pathlib.Path(sys.argv[1]).resolve()
    files = [path for room in ROOMS for path in (root / room).rglob('*') if path.is_file() and '__pycache__' not in path.parts]
    files += [path for path in root.iterdir() if path.is_file()]
    ends = {'/'.join(path.relative_to(root).parts[-depth:]) for path in files for depth in range(1, 9)}
    found = False
    for path in sorted(files):
        if path.suffix not in COMMENT or 'corpus' in path.parts or path.name in ('CHANGELOG.md', 'check_pages_test.py'):
            continue
        for line, name in names_in(path):
            placeholder = re.search(r'[A-Z]{3}', name)  # e.g. NAME.cpp
            if name.removeprefix('../') not in ends and name not in OTHERS and not placeholder:
                print(f'{path.relative_to(root)}:{line}: no file is named {name}')
                found = True
    sys.exit(found)


main()
