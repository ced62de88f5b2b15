#!/usr/bin/env python3
"""check_pages.py [--update] PROJECT TOOL...: what is wrong with README.md and docs/, a line each; no output if nothing is.

- Every block of code is fenced, at the left margin, in a language that a test knows. A ```cpp is a file of docs/examples, which is
  compiled (and run), a ```cpp fragment is included by fragments_test.cpp, a ```text right after a ```cpp compared with its output, a
  ```cmake configured, a ```python is a file of docs/examples or run by tests/python; here, ```json is parsed and ```sh read: its
  commands are known, scripts are there, and our programs' options exist.
  Anything else says why not, on the line before: <!-- not run: REASON -->
- A block that is a file has its name on the line before, <!-- file: docs/examples/NAME -->, and is the same, line by line. --update
  first copies the files into the pages. Every file of docs/examples is on a page, those of its folders by a link, and every C++ file
  is built.
- Figures that a page takes from another one are those of that page (figures.py says how they are marked); --update copies them.
- Lines of prose have at most 150 columns, except on the pages that are made by programs.
- Every link to a file, and every anchor in a page of ours, is there; URLs of others are well formed.

TOOL: the built programs, to be asked for their help; commands of others of ours are not read.
"""
import itertools
import json
import pathlib
import re
import shlex
import subprocess
import sys
import urllib.parse

import figures

OURS = re.compile(r'asterism-[a-z-]+$')
# Programs of others, whose options are not checked.
FOREIGN = {'apt-cache', 'apt-get', 'cat', 'cd', 'cmake', 'conan', 'cpack', 'ctest', 'g++', 'git', 'mkdir', 'mpirun', 'ninja', 'pip', 'pkg-config', 'printf', 'sudo', 'vcpkg',
           'vot'}
INTERPRETERS = {'bash', 'python3'}
KEYWORDS = {'do', 'done', 'then', 'fi', 'else', '(', ')', '{', '}'}


SHOWN = re.compile(r'<!-- file: (\S+) -->')
MAX_COLUMNS = 150
MADE = {'docs/options.md', 'docs/python-reference.md'}  # by docs/options_page.py and docs/python_reference_page.py
MAX_README_LINES = 12  # of a program, without blank lines and includes: one screen


def pages_of(root):
    return [root / 'README.md', *(page for page in sorted((root / 'docs').rglob('*.md')) if page.parent.name != 'site')]


def problems_of(root, tools):
    pages = pages_of(root)
    yield from example_problems(root, [page.read_text(encoding='utf-8') for page in pages])
    help_of = Help({pathlib.Path(tool).name: tool for tool in tools})
    fragments = root / 'tests/docs/fragments_test.cpp'
    included = fragments.read_text() if fragments.exists() else ''
    source = figures.Source(root, slug_of)
    for page in pages:
        name = page.relative_to(root).as_posix()
        text = page.read_text(encoding='utf-8')
        lines = text.split('\n')
        for line, problem in block_problems(root, name, lines, help_of, included):
            yield f'{name}:{line}: {problem}'
        for line, problem in shown_problems(root, name, lines):
            yield f'{name}:{line}: {problem}'
        for line, problem in figures.figure_problems(lines, source):
            yield f'{name}:{line}: {problem}'
        for line, problem in link_problems(root, page, lines):
            yield f'{name}:{line}: {problem}'
        for number, line in outside_of_blocks(lines) if name not in MADE else ():
            columns = len(re.sub(r'<!--.*?-->', '', line))
            if columns > MAX_COLUMNS and not line.lstrip().startswith(('|', '![', '$$')):
                yield f'{name}:{number + 1}: {columns} columns, more than {MAX_COLUMNS}'


def blocks(lines):
    """(line, language, text, line before, language of the block right before or None)"""
    number, last_end, last_language = 0, -1, None
    while number < len(lines):
        if lines[number].startswith('```'):
            begin = number
            number += 1
            while number < len(lines) and lines[number] != '```':
                number += 1
            before = begin - 1
            while before >= 0 and not lines[before]:
                before -= 1
            yield (begin, lines[begin][3:], '\n'.join(lines[begin + 1:number]), lines[before] if before >= 0 else '',
                   last_language if before == last_end else None)
            last_end, last_language = number, lines[begin][3:]
        number += 1


def shown_files(lines):
    """(line of the marker, file, line of the fence right after it or None, line of the closing fence)"""
    for number, line in list(outside_of_blocks(lines)):
        shown = SHOWN.fullmatch(line)
        if shown:
            begin = number + 1
            if re.match(r'```\w', lines[begin] if begin < len(lines) else '') and '```' in lines[begin + 1:]:
                yield number, shown[1], begin, lines.index('```', begin + 1)
            else:
                yield number, shown[1], None, None


def update(root):
    """Copies into the pages the files that they show, and the figures that they take from other pages."""
    source = figures.Source(root, slug_of)
    for page in pages_of(root):
        lines = page.read_text(encoding='utf-8').split('\n')
        before = list(lines)
        for _, file, begin, end in reversed(list(shown_files(lines))):
            if begin is not None and (root / file).is_file():
                lines[begin + 1:end] = file_lines(root / file)
        lines, _ = figures.corrected(lines, source)
        if lines != before:
            page.write_text('\n'.join(lines), encoding='utf-8')


def file_lines(path):
    return path.read_text(encoding='utf-8').removesuffix('\n').split('\n')


def shown_problems(root, name, lines):
    """Of blocks that are files."""
    for number, file, begin, end in shown_files(lines):
        if begin is None:
            yield number + 1, f'no block follows that could be {file}'
        elif not (root / file).is_file():
            yield number + 1, f'{file} is not in the project'
        else:
            block, wanted = lines[begin + 1:end], file_lines(root / file)
            differ = [at for at, pair in enumerate(itertools.zip_longest(block, wanted)) if pair[0] != pair[1]]
            if differ:
                yield begin + 2 + differ[0], f'not line {differ[0] + 1} of {file}; check_pages.py --update copies the file'
            code = [line for line in block if line.strip() and not line.startswith('#include')]
            if name == 'README.md' and lines[begin] == '```cpp' and len(code) > MAX_README_LINES:
                yield begin + 1, f'{len(code)} lines of code, more than the {MAX_README_LINES} of an example of README.md'


def example_problems(root, pages):
    """Of files that no page shows, or that are not built."""
    built = root / 'docs/examples/CMakeLists.txt'
    built = built.read_text(encoding='utf-8') if built.exists() else ''
    for path in sorted((root / 'docs/examples').rglob('*')):
        file = path.relative_to(root).as_posix()
        if path.suffix == '.cpp':
            whole = path.parent == root / 'docs/examples'
            shown = f'<!-- file: {file} -->' if whole else f'({file.removeprefix("docs/")})'
            if not any(shown in text for text in pages):
                yield f'{file}:1: no page {"shows" if whole else "links to"} it'
            if not re.search(rf'\b{path.stem}\b', re.sub(r'#.*', '', built)):
                yield f'{file}:1: docs/examples/CMakeLists.txt does not build it'
        elif path.suffix == '.py' and not any(path.name in text for text in pages):
            yield f'{file}:1: no page names it'


def outside_of_blocks(lines):
    inside = False
    for number, line in enumerate(lines):
        if line.startswith('```'):
            inside = not inside
        elif not inside:
            yield number, line


def block_problems(root, name, lines, help_of, included):
    for number, line in outside_of_blocks(lines):
        if line.lstrip().startswith('```'):
            yield number + 1, 'a fence that is not at the left margin'
        if line.startswith('    ') and (number == 0 or not lines[number - 1]):
            yield number + 1, 'an indented block: fence it, with its language, or write an equation'
    python_tests = root / 'tests/python/CMakeLists.txt'
    python_tests = python_tests.read_text() if python_tests.exists() else ''
    fragments = 0
    for number, language, text, before, previous in blocks(lines):
        fragments += language == 'cpp fragment'
        if re.fullmatch(r'<!-- not run: .+ -->', before):
            continue
        if language == 'cpp fragment':
            file = name.removesuffix('.md').replace('/', '_') + f'_{fragments}.inc'
            if included.count(f'#include "{file}"') != 1:
                yield number + 1, f'fragments_test.cpp does not include {file} once'
        elif language == 'text':
            if previous not in ('cpp', 'python'):
                yield number + 1, 'output that nothing is compared with; say why: <!-- not run: REASON -->'
        elif language == 'json':
            try:
                json.loads(text)
            except ValueError as error:
                yield number + 1, f'not JSON: {error}'
        elif language == 'sh':
            for problem in shell_problems(root, text, help_of):
                yield number + 1, problem
        elif language == 'cpp':
            if not SHOWN.fullmatch(before):
                yield number + 1, 'a program that is no file; name it on the line before: <!-- file: docs/examples/NAME.cpp -->'
        elif language == 'python':
            if not SHOWN.fullmatch(before) and name not in python_tests:
                yield number + 1, 'neither a file of docs/examples nor does tests/python run the blocks of this page'
        elif language != 'cmake':
            yield number + 1, f'a block in {language or "no language"}, which no test knows; say why: <!-- not run: REASON -->'


class Help:
    """Options of our programs, as they say themselves."""

    def __init__(self, tools):
        self.tools = tools
        self.known = {}

    def options(self, command):
        """command: program and subcommand. None for one that says nothing."""
        key = tuple(command)
        if key not in self.known:
            done = subprocess.run([*command, '--help'], capture_output=True, text=True, timeout=60, check=False)
            self.known[key] = set(re.findall(r'(?<![\w-])--?[A-Za-z][\w-]*', done.stdout)) if done.returncode == 0 else None
        return self.known[key]


def shell_problems(root, text, help_of):
    words = []
    try:
        for line in logical_lines(text):
            words += [*shlex_words(line), ';']
    except ValueError as error:
        yield f'not a shell command: {error}'
        return
    command = []
    for word in [*words, ';']:
        if set(word) <= set(';|&()') or word in KEYWORDS:
            if command:
                yield from command_problems(root, command, help_of)
            command = []
        else:
            command.append(word)


def shlex_words(line):
    lexer = shlex.shlex(line, posix=True, punctuation_chars=';|&()')
    lexer.whitespace_split = True
    return list(lexer)


def logical_lines(text):
    line = ''
    for part in text.split('\n'):
        if part.endswith('\\'):
            line += part[:-1] + ' '
        else:
            yield line + part
            line = ''


def command_problems(root, command, help_of):
    while command and re.match(r'[A-Z_]+=', command[0]):
        command = command[1:]
    if not command or command[0] in ('for', '..'):
        return
    program = command[0]
    rest = command[1:]
    if program in INTERPRETERS and not rest:
        return
    if program == 'python3' and rest[0] == '-m':
        return
    if program in INTERPRETERS:
        script = rest[0]
        if not (root / script).is_file():
            yield f'{script} is not in the project'
        elif program == 'python3':
            yield from script_problems(root / script, rest[1:])
    elif program.endswith('.py'):
        if not (root / program).is_file():
            yield f'{program} is not in the project'
        else:
            yield from script_problems(root / program, rest)
    elif program == 'mpirun':
        yield from command_problems(root, rest[2:], help_of)  # after -n N
    elif program == 'cmake':
        yield from cmake_problems(root, rest)
    elif built := re.match(r'build/.*/(tests|docs/examples)/', program):
        name = pathlib.Path(program).name
        if not any(name in path.read_text() for path in (root / built[1]).rglob('CMakeLists.txt')):
            yield f'{program} is no target of {built[1]}'
    elif OURS.fullmatch(pathlib.Path(program).name):
        tool = help_of.tools.get(pathlib.Path(program).name)
        if tool:
            yield from option_problems([tool], rest, program, help_of)
        elif not tool_exists(root, pathlib.Path(program).name):
            yield f'{program} is no program of the project'
    elif pathlib.Path(program).name not in FOREIGN:
        yield f'{program} is not a known command'


def tool_exists(root, name):
    target = name.replace('-', '_')
    tool = name.removeprefix('asterism-')
    files = [file for folder in ('bench', 'docs', 'trackers') for file in root.glob(f'{folder}/**/CMakeLists.txt')]
    return any(re.search(rf'add_executable\(\s*{target}\b|evaluation_tool\({tool}\b', file.read_text()) for file in files)


def option_problems(command, words, name, help_of):
    subcommand = [words[0]] if words and re.fullmatch(r'[a-z][a-z-]*', words[0]) else []
    known = subcommand and help_of.options(command + subcommand)
    top = help_of.options(command)
    if top is None:
        yield f'{name} --help fails'
        return
    for word in words:
        option = re.match(r'--?[A-Za-z][\w-]*', word)
        if option and option[0] not in (known or top) and option[0] not in top:
            yield f'{name} knows no option {option[0]}'


def script_problems(script, words):
    """Options of a Python script: by its source, as it may need what this python3 lacks."""
    known = set(re.findall(r'(?<![\w-])--?[A-Za-z][\w-]*', script.read_text(encoding='utf-8')))
    for word in words:
        option = re.match(r'--?[A-Za-z][\w-]*', word)
        if option and option[0] not in known:
            yield f'{script.name} knows no option {option[0]}'


def cmake_problems(root, words):
    for word, value in zip(words, words[1:] + ['']):
        if word == '--preset':
            presets = json.loads((root / 'CMakePresets.json').read_text())
            if value not in [preset['name'] for preset in presets['configurePresets']]:
                yield f'no preset {value}'
        option = re.match(r'-D(ASTERISM_\w+)', word)
        if option and not any(re.search(rf'(option|set)\({option[1]}\b', file.read_text())
                              for file in root.rglob('CMakeLists.txt') if 'build' not in file.parts):
            yield f'no option {option[1]}'


def slug_of(heading):
    plain = re.sub(r'\[([^\]]*)\]\([^)]*\)', r'\1', heading).lower()
    return re.sub(r'[^\w\- ]', '', plain).strip().replace(' ', '-')


def anchors_of(page):
    """Of the headings, as code hosts and the site make them."""
    found = set()
    for _, line in outside_of_blocks(page.read_text(encoding='utf-8').split('\n')):
        heading = re.match(r'#+ (.*)', line)
        if heading:
            slug = slug_of(heading[1])
            number = 0
            while (slug if not number else f'{slug}-{number}') in found:
                number += 1
            found.add(slug if not number else f'{slug}-{number}')
    return found


def link_problems(root, page, lines):
    for number, line in outside_of_blocks(lines):
        for target in re.findall(r'\]\(([^)\s]+)\)', re.sub(r'`[^`]*`', '', line)):
            if re.match(r'[a-z]+:', target):
                url = urllib.parse.urlparse(target)
                if url.scheme not in ('http', 'https') or '.' not in url.netloc:
                    yield number + 1, f'{target} is no URL'
                continue
            file, _, anchor = target.partition('#')
            path = (page.parent / file).resolve() if file else page
            if not path.exists() or not path.is_relative_to(root):
                yield number + 1, f'{target}: there is no such file'
            elif anchor and anchor not in anchors_of(path):
                yield number + 1, f'{target}: there is no such heading'


def main():
    arguments = sys.argv[1:]
    if arguments[:1] == ['--update']:
        arguments.pop(0)
        update(pathlib.Path(arguments[0]).resolve())
    problems = list(problems_of(pathlib.Path(arguments[0]).resolve(), arguments[1:]))
    print('\n'.join(problems))
    return 1 if problems else 0


if __name__ == '__main__':
    sys.exit(main())
