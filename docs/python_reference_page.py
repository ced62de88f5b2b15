#!/usr/bin/env python3
"""python_reference_page.py [--check]: writes docs/python-reference.md, every class and function of the Python module.

Texts are the docstrings of the installed module, signatures of compiled functions those of its stubs; what a dataclass holds is said by
the comments at its members. --check writes nothing, and ends with 1 if the page is out of date.
"""
import argparse
import ast
import inspect
import pathlib
import re
import sys
import textwrap

import asterism

ROOT = pathlib.Path(__file__).resolve().parent.parent
PAGE = ROOT / 'docs/python-reference.md'
PACKAGE = pathlib.Path(asterism.__file__).parent

HEAD = '''# Python: reference

<!-- Written by docs/python_reference_page.py: change the docstrings, not this page. -->

This page has every class and function of `import asterism`, as `help` shows them in Python. [Python](python.md) introduces them with programs. `array`
stands for a NumPy array of float64, and `array_like` for anything that NumPy makes one of: lists, integers, other types. Points are rows:
(N, dim). Most classes have `copy()`, which gives an object of its own with the same values, as `copy.copy` and `copy.deepcopy` do.

This page is of a build with all optional libraries. The following command writes it, and the test `python.reference_page` fails if it is
out of date:

```sh
PYTHONPATH=build/release/solver/python python3 docs/python_reference_page.py
```
'''

# The order of the page: heading, where the guide has an example, and names.
GROUPS = [
    ('Spring systems', 'python.md#solve-a-constellation', 'Topology SpringSystem random_system energy gradient hessian sparse_hessian stationarity'),
    ('Solving', 'python.md#solve-a-constellation', 'solve Solver methods Summary Status'),
    ('Questions about a solution', 'python.md#solve-a-constellation', 'certify Certificate covariance node_covariances sensitivity '
     'Sensitivity SensitivityStatus solution_tangent'),
    ('Systems of terms', 'python.md#terms-of-all-kinds', 'System Term Solution add_link_law'),
    ('Many small systems', 'python.md#many-small-systems', 'SpringBatch BatchSummary'),
    ('Points with given distances, graphs', 'points-and-graphs.md#points-with-given-distances', 'mds MDS layout layout_stress remove_overlaps Embedding'),
    ('Positions from ranges', 'locate.md', 'locate PositionFix PositionMinimum survey Survey locate_path PathEstimate PathStream'),
    ('Pictorial structures', 'pictorial-structures.md', 'pictorial_structure m_best_placements scaled_structure loopy_structure Joint '
     'PictorialResult ScaledResult LoopyResult'),
    ('Systems in files', 'python.md#systems-in-files', 'read_systems parse_systems write_systems StoredSystem'),
    ('Trackers', 'python.md#track-an-object', 'Tracker TrackResult PartState OpenCvTracker MultiTracker tracker_names tracker_options '
     'smooth_track part_names part_options suggested_range evaluate'),
]
# Modules of the package; torch is read, not imported, as it needs PyTorch.
MODULES = [('evaluation', 'python.md#evaluate-a-tracker'), ('trax', 'trax.md#a-tracker-in-python'),
           ('bench', 'python.md#a-solver-of-your-own'), ('torch', 'gradients.md'), ('pose', 'pose.md')]

TYPES = [(r'_Floats', 'array'), (r'_Ints|_Indices', 'array of int'), (r'_Image', 'image'), (r'_Region', 'region'), (r'_Values', 'array'),
         (r'_OnIteration|_\w*Function|Callable\[(?:\[[^\]]*\]|\.\.\.), [^\[\]]*(?:\[[^\]]*\])?\]', 'callable'), (r'_Number', 'array_like'),
         (r'npt\.ArrayLike', 'array_like'), (r'npt\.NDArray\[np\.(\w+)\]', r'array of \1'), (r'array of float64', 'array'),
         (r'np\.ndarray', 'array'), (r'_asterism\.|dataclasses\.|scipy\.sparse\.', ''), (r'os\.PathLike\[str\]', 'path'),
         (r'_Tracker', 'tracker'), (r'_Box', 'tuple[int, int, int, int]')]


def typed(text):
    for pattern, plain in TYPES:
        text = re.sub(pattern, plain, text)
    return text


def stub():
    body = ast.parse((PACKAGE / '_asterism.pyi').read_text(encoding='utf-8')).body
    return {node.name: node for node in body if isinstance(node, (ast.FunctionDef, ast.ClassDef))}


STUB = stub()
SOURCES = {path.stem: ast.parse(path.read_text(encoding='utf-8')) for path in PACKAGE.glob('*.py')}


def source_of(name):
    """The definition of a function or class of a Python source, and the source's lines."""
    for module, tree in SOURCES.items():
        for node in tree.body:
            if isinstance(node, (ast.FunctionDef, ast.ClassDef)) and node.name == name:
                return node, (PACKAGE / f'{module}.py').read_text(encoding='utf-8').split('\n')
    raise KeyError(name)


def signature(name, node, doc=''):
    """name(argument: type = default, ..) -> type, with the defaults that the stub leaves to the compiled function's own signature."""
    def argument(node, default):
        text = node.arg + (f': {typed(ast.unparse(node.annotation))}' if node.annotation else '')
        if default is None:
            return text
        value = ast.unparse(default)
        if value == '...' and (found := re.search(rf'\b{node.arg}: [\w.\[\], ]+ = ([^,)]+)', doc.split('\n')[0])):
            value = found[1]
        return f'{text} = {value}'

    a = node.args
    plain = a.posonlyargs + a.args
    shown = [argument(each, default) for each, default in zip(plain, [None] * (len(plain) - len(a.defaults)) + a.defaults)]
    shown = shown[1:] if plain and plain[0].arg in ('self', 'cls') else shown
    if a.vararg:
        shown.append('*' + a.vararg.arg)
    elif a.kwonlyargs:
        shown.append('*')
    shown += [argument(each, default) for each, default in zip(a.kwonlyargs, a.kw_defaults)]
    if a.kwarg:
        shown.append('**' + a.kwarg.arg)
    returned = f' -> {typed(ast.unparse(node.returns))}' if node.returns and node.name != '__init__' else ''
    line = f'{name}({", ".join(shown)}){returned}'
    return line if len(line) <= 110 else f'{name}(\n    ' + ',\n    '.join(shown) + f',\n){returned}'


def block(code):
    return ['<!-- not run: a signature -->', '```py', code, '```']


def plain_doc(doc):
    """A docstring without the signature that pybind11 puts before it."""
    doc = inspect.cleandoc(doc or '')
    first, _, rest = doc.partition('\n')
    return rest.strip('\n') if re.match(r'^\w+\(.*\)( -> .*)?$', first) else doc


def escaped(text):
    pieces = re.split(r'(`[^`]*`)', text)
    return ''.join(piece if piece.startswith('`') else re.sub(r'([*_<>\[\]|])', r'\\\1', piece) for piece in pieces)


PROPERTIES = {'property', 'functools.cached_property'}
PARAMETER = re.compile(r'^((?:\*\*)?\w+(?:, \w+)*): (.*)')


def prose(doc):
    """Paragraphs, lists of arguments, and indented programs of a docstring."""
    lines = []
    for paragraph in re.split(r'\n\s*\n(?! {8})', doc):  # a function of a program goes on after a blank line
        rows = paragraph.split('\n')
        if all(row.startswith('    ') for row in rows if row):
            lines += ['<!-- not run: an excerpt -->', '```py', textwrap.dedent(paragraph), '```', '']
        elif PARAMETER.match(rows[0]) and not rows[0].startswith('ValueError'):
            item = []
            for row in rows + ['end: ']:
                if (start := PARAMETER.match(row)) and item:
                    lines.append(f'- `{item[0]}`: ' + escaped(' '.join(item[1:])))
                    item = []
                item += [start[1], start[2]] if start else [row.strip()]
            lines.append('')
        else:
            for row in rows:
                lines.append(('  ' if row.startswith('  ') else '') + escaped(row.strip()))
            lines.append('')
    return lines[:-1] if lines and not lines[-1] else lines


def cell(text):
    return escaped(' '.join(text.split()))


def members(name, cls):
    """Attributes as a table, then methods with their own texts."""
    if name in STUB:
        nodes, lines = STUB[name].body, None
    else:
        node, lines = source_of(name)
        nodes = node.body
    attributes, methods = [], []
    for node in nodes:
        if isinstance(node, ast.AnnAssign) and not node.target.id.startswith('_'):
            type_, attribute = typed(ast.unparse(node.annotation)), node.target.id
            text = comment_at(node, lines) if lines else inspect.getdoc(inspect.getattr_static(cls, attribute)) or ''
            default = f' (default: {ast.unparse(node.value)})' if node.value is not None and 'field' not in ast.unparse(node.value) else ''
            attributes.append((attribute, type_, text + default))
        elif isinstance(node, ast.Assign) and lines and (text := comment_at(node, lines)):
            attributes.append((node.targets[0].id, '', text))
        elif isinstance(node, ast.FunctionDef) and not node.name.startswith('_'):
            if any(ast.unparse(each).endswith('.setter') for each in node.decorator_list):
                continue
            doc = plain_doc(getattr(inspect.getattr_static(cls, node.name), '__doc__', None) or getattr(cls, node.name).__doc__)
            if is_property(node):
                attributes.append((node.name, typed(ast.unparse(node.returns)), doc))
            else:
                methods.append((node, plain_doc(getattr(cls, node.name).__doc__), getattr(cls, node.name).__doc__ or ''))
    if lines:  # attributes that __init__ documents
        for made in (each for each in nodes if isinstance(each, ast.FunctionDef) and each.name == '__init__'):
            for node in ast.walk(made):
                target = node.targets[0] if isinstance(node, ast.Assign) else node.target if isinstance(node, ast.AnnAssign) else None
                if isinstance(target, ast.Attribute) and not target.attr.startswith('_') and (text := comment_at(node, lines)):
                    attributes.append((target.attr, typed(ast.unparse(node.annotation)) if isinstance(node, ast.AnnAssign) else '', text))
    if attributes:
        yield from ['| attribute | type | meaning |', '|---|---|---|']
        yield from (f'| `{each}` | {f"`{type_}`".replace("|", chr(92) + "|") if type_ else ""} | {cell(text)} |' for each, type_, text in attributes)
        yield ''
    for node, doc, whole in methods:
        if node.name == 'copy':  # said once, above
            continue
        yield from [*block(signature(f'{name}.{node.name}', node, whole)), '', *prose(doc), '']


def comment_at(node, lines):
    """The #: comments above a member, or at the end of its line."""
    found = re.search(r'#: (.*)', lines[node.lineno - 1])
    above, at = [], node.lineno - 2
    while at >= 0 and (comment := re.match(r'\s*#: (.*)', lines[at])):
        above.insert(0, comment[1])
        at -= 1
    return found[1] if found else ' '.join(above)


def entry(name, thing):
    yield from [f'### `{name}`', '']
    if inspect.isclass(thing):
        in_stub = name in STUB
        node = STUB[name] if in_stub else source_of(name)[0]
        made = next((each for each in node.body if isinstance(each, ast.FunctionDef) and each.name == '__init__'), None)
        doc = plain_doc(thing.__doc__)
        if made is not None:
            yield from [*block(signature(f'asterism.{name}', made, (thing.__init__.__doc__ or ''))), '']
        yield from [*prose(doc), '']
        if made is not None and in_stub and (own := plain_doc(thing.__init__.__doc__)):
            yield from [*prose(own), '']
        yield from members(name, thing)
    else:
        node = STUB[name] if name in STUB else source_of(name)[0]
        yield from [*block(signature(f'asterism.{name}', node, thing.__doc__ or '')), '', *prose(plain_doc(thing.__doc__)), '']


def public_functions(of_class):
    return [each for each in of_class.body if isinstance(each, ast.FunctionDef) and not each.name.startswith('_')]


def is_property(function):
    return any(ast.unparse(each) in PROPERTIES for each in function.decorator_list)


def of_module(name):
    """The public functions and classes of a module that is read, not imported."""
    tree = SOURCES[name]
    listed = next((ast.literal_eval(node.value) for node in tree.body
                   if isinstance(node, ast.Assign) and getattr(node.targets[0], 'id', '') == '__all__'), None)
    own = (PACKAGE / f'{name}.py').read_text(encoding='utf-8').split('\n')
    yield from [*prose(ast.get_docstring(tree) or ''), '']
    defined = [node for node in tree.body if isinstance(node, (ast.FunctionDef, ast.ClassDef))]
    entries = [(node, own) for node in defined if not node.name.startswith('_') and (not listed or node.name in listed)]
    entries += [source_of(each) for each in listed or [] if each not in {node.name for node in defined}]  # of other files
    for node, lines in entries:
        yield from [f'### `{name}.{node.name}`', '']
        if isinstance(node, ast.FunctionDef):
            yield from [*block(signature(f'asterism.{name}.{node.name}', node)), '', *prose(ast.get_docstring(node) or ''), '']
            continue
        yield from [*prose(ast.get_docstring(node) or ''), '']
        rows = [(each.target.id, typed(ast.unparse(each.annotation)), comment_at(each, lines)) for each in node.body
                if isinstance(each, ast.AnnAssign) and not each.target.id.startswith('_')]
        rows += [(each.name, typed(ast.unparse(each.returns)), ast.get_docstring(each) or '') for each in public_functions(node) if is_property(each)]
        for made in (each for each in node.body if isinstance(each, ast.FunctionDef) and each.name == '__init__'):
            rows += [(each.targets[0].attr, '', comment_at(each, lines)) for each in made.body
                     if isinstance(each, ast.Assign) and isinstance(each.targets[0], ast.Attribute) and not each.targets[0].attr.startswith('_')]
        if rows:
            yield from ['| attribute | type | meaning |', '|---|---|---|']
            yield from (f'| `{each}` | {f"`{type_}`".replace("|", chr(92) + "|") if type_ else ""} | {cell(text)} |' for each, type_, text in rows)
            yield ''
        for method in (each for each in public_functions(node) if not is_property(each)):
            yield from [*block(signature(f'{node.name}.{method.name}', method)), '', *prose(ast.get_docstring(method) or ''), '']


def page():
    lines = HEAD.split('\n')
    modules = {name for name, _ in MODULES}
    shown = {name for _, _, names in GROUPS for name in names.split()} | modules
    if missing := set(asterism.__all__) - shown:
        sys.exit(f'python_reference_page.py: no group has {", ".join(sorted(missing))}')
    for title, guide, names in GROUPS:
        lines += [f'## {title}', '', f'[Example]({guide})', '']
        for name in names.split():
            if not hasattr(asterism, name):
                sys.exit(f'python_reference_page.py: this build has no {name}')
            lines += entry(name, getattr(asterism, name))
    for name, guide in MODULES:
        lines += [f'## `asterism.{name}`', '', f'[Example]({guide})', '', *of_module(name)]
    text = re.sub(r'\n{3,}', '\n\n', '\n'.join(lines))
    return text.rstrip('\n') + '\n'


def main():
    arguments = argparse.ArgumentParser(description=__doc__.split('\n', maxsplit=1)[0])
    arguments.add_argument('--check', action='store_true', help='write nothing; end with 1 if the page is out of date')
    check, text = arguments.parse_args().check, page()
    before = PAGE.read_text(encoding='utf-8') if PAGE.exists() else ''
    if not check:
        PAGE.write_text(text, encoding='utf-8')
    elif before != text:
        pairs = zip(before.split('\n'), text.split('\n') + [''])
        line, should = next(((i, b) for i, (a, b) in enumerate(pairs) if a != b), (0, ''))
        sys.exit(f'docs/python-reference.md:{line + 1} is out of date, docs/python_reference_page.py writes it; it should be: {should}')


if __name__ == '__main__':
    main()
