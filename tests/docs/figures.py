"""Figures that are measured stand on one page, and others take them from its tables.

- `0.375<!-- figure of docs/results/evaluation.md: dpt_plus, EAO -->` is the number in the row and the column, or the column and the row,
  of these names in the first table of the page that has both; PAGE.md#heading takes the tables of that section.
- `9<!-- figure of docs/results/solver.md: "become some # s" -->` is the number at # in these words, which the page has once; it may
  break the line within them.
- `<!-- figures of docs/results/evaluation.md: its name here = its name there, .. -->` right before a table: each of its numbers whose row
  and column the other page's tables have. Names that are not listed are the same.

Names are without emphasis and marks of code. A number may be rounded; a cell with a bracket is the whole cell.
"""
import re

INLINE = re.compile(r'(?P<shown>[-+]?\d[\d.]*)(?P<stars>\**)<!-- figure of (?P<page>[^\s:]+): (?:"(?P<words>[^"#>]*#[^"#>]*)"|(?P<row>[^">]+?), (?P<column>[^,>]+?)) -->')
WHOLE = re.compile(r'<!-- figures of (?P<page>[^\s:]+)(?:: (?P<names>.*))? -->')
NUMBER = re.compile(r'[-+]?\d[\d.]*')


def plain(cell):
    return re.sub(r'<!--.*?-->|[*`]', '', cell).strip()


def cells(line):
    return [cell.strip() for cell in line.strip().strip('|').split('|')]


def outside(text):
    """The lines, empty within blocks of code."""
    inside = False
    for line in text.split('\n'):
        inside ^= line.startswith('```')
        yield '' if inside else line


def is_row(line):
    return line.startswith('|')


def section(lines, heading, slug):
    """The lines below a heading, up to the next of its level."""
    found = None
    for number, line in enumerate(lines):
        title = re.match(r'(#+) (.*)', line)
        if title and found is None and slug(title[2]) == heading:
            found, level = number + 1, len(title[1])
        elif title and found is not None and len(title[1]) <= level:
            return lines[found:number]
    return [] if found is None else lines[found:]


def tables(lines):
    """{(row, column): cell} of each table."""
    at = 0
    while at + 1 < len(lines):
        if is_row(lines[at]) and re.fullmatch(r'\|[-:| ]+\|', lines[at + 1]):
            header, at = [plain(cell) for cell in cells(lines[at])], at + 2
            table = {}
            while at < len(lines) and is_row(lines[at]):
                row = cells(lines[at])
                table.update({(plain(row[0]), name): plain(cell) for name, cell in zip(header[1:], row[1:])})
                at += 1
            yield table
        at += 1


class Source:
    """The pages that others take figures from."""

    def __init__(self, root, slug):
        self.root, self.slug, self.read, self.texts = root, slug, {}, {}

    def tables_of(self, page):
        if page not in self.read:
            file, _, heading = page.partition('#')
            path = self.root / file
            text = path.read_text(encoding='utf-8') if path.is_file() else ''
            lines = list(outside(text))
            self.read[page] = list(tables(section(lines, heading, self.slug) if heading else lines))
        return self.read[page]

    def cell(self, page, row, column):
        for table in self.tables_of(page):
            for key in ((row, column), (column, row)):
                if key in table:
                    return table[key]
        return None


    def in_words(self, page, words):
        """The number at # in words that the page has once."""
        if page not in self.texts:
            path = self.root / page
            text = path.read_text(encoding='utf-8') if path.is_file() else ''
            self.texts[page] = ' '.join(re.sub(r'<!--.*?-->', '', text).split())
        before, after = (re.escape(part) for part in words.split('#'))
        found = re.findall(f'{before}({NUMBER.pattern}){after}', self.texts[page])
        return found[0] if len(found) == 1 else None


def wanted(shown, cell):
    """What a figure has to be, with as many decimals as it has."""
    if '(' in shown:
        return cell
    number = NUMBER.match(cell)
    if not number:
        return cell
    decimals = len(shown.partition('.')[2])
    return f'{float(number[0]):+.{decimals}f}' if shown.startswith('+') else f'{float(number[0]):.{decimals}f}'


def corrected(lines, source):
    """The lines with the right figures, and (line, problem) of those that are nowhere."""
    lines, problems = list(lines), []
    for number, line in enumerate(lines):
        def inline(found):
            if found['words']:
                cell, place = source.in_words(found['page'], found['words']), f'"{found["words"]}"'
            else:
                cell, place = source.cell(found['page'], found['row'], found['column']), f"{found['row']}, {found['column']}"
            if cell is None:
                problems.append((number + 1, f"{found['page']} has no figure in {place}"))
                return found[0]
            return found[0].replace(found['shown'], wanted(found['shown'], cell), 1)

        lines[number] = INLINE.sub(inline, line)
        if '<!-- figure of' in INLINE.sub('', line):
            problems.append((number + 1, 'a figure has the form NUMBER<!-- figure of PAGE: ROW, COLUMN --> or NUMBER<!-- figure of PAGE: "WORDS # WORDS" -->'))
        if not (whole := WHOLE.fullmatch(line)):
            continue
        names = dict(pair.split(' = ') for pair in (whole['names'] or '').split(', ') if pair)
        header = [plain(cell) for cell in cells(lines[number + 1])]
        count, at = 0, number + 3
        while at < len(lines) and is_row(lines[at]):
            row = cells(lines[at])
            for i, cell in enumerate(row[1:], 1):
                there = source.cell(whole['page'], *(names.get(name, name) for name in (plain(row[0]), header[i])))
                if there is None or not NUMBER.match(plain(cell)):
                    continue
                count += 1
                row[i] = cell.replace(plain(cell), wanted(plain(cell), there), 1)
            if row != cells(lines[at]):
                lines[at] = ' '.join(['|', *(f'{cell} |' if cell else '|' for cell in row)])
            at += 1
        if count == 0:
            problems.append((number + 1, f"the tables of {whole['page']} have no figure of the next table"))
    return lines, problems


def figure_problems(lines, source):
    right, problems = corrected(lines, source)
    yield from problems
    for number, (line, other) in enumerate(zip(lines, right)):
        if line != other:
            yield number + 1, f'a figure differs from its page: expected {other.strip()[:160]}; check_pages.py --update copies it'
