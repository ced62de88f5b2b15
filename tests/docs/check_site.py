#!/usr/bin/env python3
"""check_site.py SITE: what is wrong with the built documentation site, a line each; no output if nothing is.

- Every local address in a page or stylesheet (href, src, srcset, @import, url()) is a file of the site, and its fragment is in it.
"""
import html.parser
import pathlib
import re
import sys
import urllib.parse

ADDRESSES = {'href', 'src', 'poster', 'data'}
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


def link_problems(site):
    pages = {path: Page(path.read_text(encoding='utf-8')) for path in sorted(site.rglob('*.html'))}
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
            elif not target.is_file():
                yield f'{path.relative_to(site)}: {address} is not in the site'
            elif place and target.suffix == '.html' and place not in pages[target.resolve()].places:
                yield f'{path.relative_to(site)}: {address}: the page has no place of that name'


def main():
    site = pathlib.Path(sys.argv[1]).resolve()
    problems = list(link_problems(site))
    print('\n'.join(problems))
    sys.exit(bool(problems))


main()
