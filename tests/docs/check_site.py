#!/usr/bin/env python3
"""check_site.py SITE [FILE...]: what is wrong with the built documentation site, a line each; no output if nothing is.

FILE: a file of the site that was not made, on purpose.

- Every local address in a page or stylesheet (href, src, srcset, @import, url()) is a file of the site, and its fragment is in it.
- The pages have a dark mode, and their script runs as it is.
- No brief of the reference ends at an abbreviation ("Sec.").
- The changelog is a page, and the first page leads to it.
- The search of the pages finds symbols of the reference: each leads to a page and a place that are there.
"""
import html.parser
import json
import pathlib
import re
import sys
import urllib.parse

ADDRESSES = {'href', 'src', 'poster', 'data'}
SYMBOLS = ['Ida', 'SpringSystem', 'solve', 'Kcf', 'Tracker']  # a class, a function and a concept; from each library
CUT_BRIEF = re.compile(r'[^>]{0,60}\b(?:Secs?|Eqs?|Figs?|e\.g|i\.e|cf)\.\s*(?:<a [^>]*>More|<br|</p|</td|</div)')
IN_STYLE = re.compile(r'@import\s+["\']([^"\']+)["\']|url\(\s*(?:"([^"]*)"|\'([^\']*)\'|([^"\')\s]*))\s*\)')


class Page(html.parser.HTMLParser):
    """What a page refers to, and the places in it that others refer to."""

    def __init__(self, text):
        super().__init__()
        self.addresses, self.places, self.inside = [], set(), None
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        self.inside = tag
        for name, value in attributes:
            if name in ('id', 'name') and value:
                self.places.add(value)
            elif name in ADDRESSES and value and not (tag == 'link' and ('rel', 'canonical') in attributes):
                self.addresses.append(value)
            elif name == 'srcset' and value:
                self.addresses += [part.split()[0] for part in value.split(',')]
            elif name == 'style' and value:
                self.addresses += style_addresses(value)

    handle_startendtag = handle_starttag

    def handle_endtag(self, tag):
        self.inside = None

    def handle_data(self, data):
        if self.inside == 'style':
            self.addresses += style_addresses(data)


def style_addresses(text):
    text = re.sub(r'/\*.*?\*/', '', text, flags=re.DOTALL)
    return [next(filter(None, groups), '') for groups in IN_STYLE.findall(text)]


def has_place(target, place, pages):
    """Whether the page has an element of that name or, for a state of the playground, the system that it names."""
    preset = re.fullmatch(r'preset=([\w-]+)', place)
    if preset and (target.parent / 'presets.js').is_file():
        return f"['{preset[1]}'," in (target.parent / 'presets.js').read_text(encoding='utf-8')
    return place in pages[target].places


def link_problems(site, pages, left_out):
    styles = {path: style_addresses(path.read_text(encoding='utf-8')) for path in sorted(site.rglob('*.css'))}
    for path, addresses in [*((path, page.addresses) for path, page in pages.items()), *styles.items()]:
        for address in dict.fromkeys(addresses):
            parts = urllib.parse.urlsplit(address)
            if parts.scheme or parts.netloc:
                continue
            target = path.parent / urllib.parse.unquote(parts.path) if parts.path else path
            place = urllib.parse.unquote(parts.fragment)
            if parts.path.startswith('/') or not target.resolve().is_relative_to(site):
                yield f'{path.relative_to(site)}: {address} is outside of the site'
            elif not target.is_file() and target.resolve() not in left_out:
                yield f'{path.relative_to(site)}: {address} is not in the site'
            elif place and place != 'top' and target.is_file() and target.suffix == '.html' and not has_place(target.resolve(), place, pages):
                yield f'{path.relative_to(site)}: {address}: the page has no place of that name'


def theme_problems(site):
    style, script = '_static/styles/furo.css', '_static/scripts/furo.js'
    if not re.search(r'prefers-color-scheme:\s*dark', (site / style).read_text(encoding='utf-8')):
        yield f'{style}: no dark mode for readers whose system has one'
    if re.search(r'^import\b', (site / script).read_text(encoding='utf-8'), re.MULTILINE):
        yield f'{script}: imports a module, which a script that is no module cannot'


def reference_problems(site):
    for path in sorted((site / 'reference').glob('*.html')):
        for cut in dict.fromkeys(CUT_BRIEF.findall(path.read_text(encoding='utf-8'))):
            yield f'{path.relative_to(site)}: a brief ends at an abbreviation: {" ".join(cut.split())}'


def changelog_problems(site, pages):
    if site / 'CHANGELOG.html' not in pages:
        yield 'CHANGELOG.html is not in the site'
    if 'CHANGELOG.html' not in pages[site / 'index.html'].addresses:
        yield 'index.html: no link to CHANGELOG.html'


def search_problems(site, pages):
    index = (site / 'searchindex.js').read_text(encoding='utf-8')
    index = json.loads(index[index.index('(') + 1:index.rindex(')')])
    found = set()
    for page, _, _, place, name in index['objects'].get('', []):
        path = f'{index["docnames"][page]}.html'
        found.add(name)
        if site / path not in pages:
            yield f'searchindex.js: {name} leads to {path}, which is not in the site'
        elif place not in pages[site / path].places:
            yield f'searchindex.js: {name}: {path} has no place {place}'
    for name in SYMBOLS:
        if name not in found:
            yield f'searchindex.js: the search does not find {name}'


def problems_of(site, left_out=()):
    site = site.resolve()
    pages = {path: Page(path.read_text(encoding='utf-8')) for path in sorted(site.rglob('*.html'))}
    return [*link_problems(site, pages, {site / name for name in left_out}), *theme_problems(site), *reference_problems(site), *changelog_problems(site, pages),
            *search_problems(site, pages)]


def main():
    problems = problems_of(pathlib.Path(sys.argv[1]), sys.argv[2:])
    for problem in problems:
        print(problem)
    sys.exit(bool(problems))


if __name__ == '__main__':
    main()
