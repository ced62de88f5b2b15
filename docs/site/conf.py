"""The documentation site: the pages of docs/ by Sphinx, and a link to the reference, which is Doxygen's own.

Breathe would put the reference into Sphinx; Debian's does not know C++ concepts, which are our plug-in points.
"""
import pathlib
import re
import xml.etree.ElementTree

from docutils import nodes
from docutils.utils import new_document
from sphinx.domains import Domain, ObjType

project = 'Asterism'
extensions = ['myst_parser', 'sphinx.ext.mathjax']
root_doc = 'index'  # the project's README.md
source_suffix = {'.md': 'markdown'}
ROOT_PAGES = {'README': 'index', 'CHANGELOG': 'CHANGELOG', 'CONTRIBUTING': 'CONTRIBUTING'}  # of the project's root, see build.cmake
nitpicky = True

myst_enable_extensions = ['dollarmath']
myst_heading_anchors = 4
myst_dmath_double_inline = True
# Links to files that are no pages are for the code host; tests/docs checks that files and headings exist.
suppress_warnings = ['ref.myst']

html_theme = 'furo'
pygments_style, pygments_dark_style = 'default', 'github-dark'  # each color of a contrast of 4.5 or more to its ground
html_copy_source = False
html_show_copyright = False
html_show_sphinx = False
html_static_path = ['static', '/usr/share/javascript/katex']  # Debian's libjs-katex: equations without a network
html_css_files = ['site.css', 'katex.min.css']
html_js_files = ['katex.min.js', 'contrib/auto-render.js', 'copy.js', 'fold.js']
html_favicon = 'static/favicon.svg'
mathjax_path = 'equations.js'  # in the place of MathJax
mathjax_options = {'defer': 'defer'}
html_theme_options = {'navigation_with_keys': True}
templates_path = ['templates']
html_sidebars = {'**': ['sidebar/brand.html', 'sidebar/search.html', 'sidebar/scroll-start.html', 'sidebar/navigation.html',
                        'reference.html', 'sidebar/scroll-end.html']}


def contents(text):
    """The site's table of contents: the links of the tables of docs/README.md, a part for each heading above one."""
    trees = ['```{toctree}\n:hidden:\n\nAll pages <README>\n```']
    for section in re.split(r'^## ', text, flags=re.MULTILINE)[1:]:
        pages = re.findall(r'^\| \[([^\]]+)\]\(([\w/-]+)\.md\)', section, re.MULTILINE)
        if pages:
            lines = [f'{title} <{page}>' for title, page in pages]
            caption = section.split('\n')[0]
            trees.append('\n'.join(['```{toctree}', ':hidden:', f':caption: {caption}', '', *lines, '```']))
    return '\n\n' + '\n\n'.join(trees) + '\n'


def header_pages(tags):
    """The page of the reference for each public header, by the header's path below its include folder."""
    files = xml.etree.ElementTree.parse(tags).getroot().iter('compound') if tags else ()
    return {(file.findtext('path') + file.findtext('name')).rpartition('/include/')[2]: file.findtext('filename').removesuffix('.html')
            for file in files if file.get('kind') == 'file'}


def link_root_pages(page, text):
    """The text of a page of docs/, with its links to pages of the project's root as they are in the site."""
    up = '../' * page.count('/')
    return re.sub(rf'\]\(\.\./{up}({"|".join(ROOT_PAGES)})\.md', lambda link: f']({up}{ROOT_PAGES[link[1]]}.md', text)


def read_source(app, page, source):
    """build.cmake puts the pages of the project's root beside those of docs/. Links to headers lead to the reference."""
    if page in ROOT_PAGES.values():
        source[0] = source[0].replace('](docs/', '](')
    else:
        source[0] = link_root_pages(page, source[0])
    if (header := re.compile(r'\[`([^`\]]+)`\]\((?:\.\./)+\w+/include/([^)]+\.hpp)\)')).search(source[0]):
        pages, up = header_pages(app.config.reference_tags), '../' * page.count('/')
        source[0] = header.sub(lambda link: f'<a href="{up}reference/{pages[link[2]]}.html"><code>{link[1]}</code></a>'
                               if link[2] in pages else link[0], source[0])
    if page == root_doc:
        source[0] += contents(link_root_pages('README', pathlib.Path(app.srcdir, 'README.md').read_text(encoding='utf-8')))


MAX_UNBROKEN, MIN_TEXT = 28, 60  # characters: a figure with its interval, a sentence


def mark_cells(app, document):
    """Classes for site.css, which tells figures from sentences by them, and tables of two columns and those of options from others."""
    for cell in document.findall(nodes.entry):
        size = len(cell.astext())
        if size <= MAX_UNBROKEN:
            cell['classes'].append('short')
        elif size >= MIN_TEXT:
            cell['classes'].append('text')
    for group in document.findall(nodes.tgroup):
        if group['cols'] == 2:
            group.parent['classes'].append('pairs')
        elif group['cols'] == 4 and app.env.docname == 'options':
            group.parent['classes'].append('options')


def mark_charts(app, document):
    """A picture is a chart if it is an SVG, of the results or of the gallery. site.css keeps charts large enough on a phone, and inverts
    those that are drawn on white in dark mode."""
    for image in document.findall(nodes.image):
        path = pathlib.Path(app.srcdir, image['uri'])
        is_svg = path.suffix == '.svg'
        if is_svg or path.is_relative_to(pathlib.Path(app.srcdir, 'results')) or path.name.startswith('gallery-'):
            image['classes'].append('chart')
            if not is_svg or 'prefers-color-scheme' not in path.read_text(encoding='utf-8'):
                image['classes'].append('white')


def mark_literals(_, document):
    """A class for site.css: a browser would break a line after each hyphen of an option."""
    for literal in document.findall(nodes.literal):
        if literal.astext().startswith('-') and max(map(len, literal.astext().split())) <= MAX_UNBROKEN:
            literal['classes'].append('option')


SHELL = re.compile(r'<div class="highlight-sh .*?</pre>', re.DOTALL)
OPTION = re.compile(r'(?<=[>\s])--?[A-Za-z][\w-]*(?:<span class="o">=</span>[\w./-]*)?')


def mark_options(app, page, template, context, document):
    """The same class in commands."""
    if 'body' in context:
        context['body'] = SHELL.sub(lambda block: OPTION.sub(r'<span class="option">\g<0></span>', block[0]), context['body'])


class Reference(Domain):
    """Doxygen's symbols, for the search of the pages and for objects.inv."""
    name = 'reference'
    label = 'C++'
    KINDS = {'class': 'class', 'struct': 'struct', 'concept': 'concept', 'enumeration': 'enumeration', 'enumvalue': 'enumerator',
             'function': 'function', 'typedef': 'type', 'variable': 'variable', 'define': 'macro'}
    object_types = {kind: ObjType(words, kind) for kind, words in KINDS.items()}

    def tags(self):
        """(kind, name, page without .html, place in it, importance, what holds it) of each symbol"""
        if not self.env.config.reference_tags:
            return
        for compound in xml.etree.ElementTree.parse(self.env.config.reference_tags).getroot().iter('compound'):
            kind, inner = compound.get('kind'), compound.findtext('name')
            holder = inner.removeprefix('asterism::') if kind in self.KINDS else ''
            if holder:
                yield kind, holder, compound.findtext('filename'), 'top', 0, ''
            for member in compound.iter('member') if kind in self.KINDS or kind == 'namespace' else ():
                page = member.findtext('anchorfile', '')
                if member.get('kind') in self.KINDS and page and '@' not in member.findtext('name'):
                    name = '::'.join(filter(None, [holder, member.findtext('name')]))
                    yield member.get('kind'), name, page, member.findtext('anchor'), 2 if holder else 0, holder or inner

    def get_objects(self):
        seen = set()
        for kind, name, page, place, importance, _ in self.tags():
            page = 'reference/' + page.removesuffix('.html')
            if (name, page) not in seen:  # an overload is on the same page
                seen.add((name, page))
                yield name, name, kind, page, place, importance

    def resolve_any_xref(self, *_):
        return []

    def merge_domaindata(self, docnames, otherdata):
        pass


def index_reference(app):
    """The search knows a symbol only if it knows its page; words of the reference stay out, or they would hide the guides."""
    indexer = getattr(app.builder, 'indexer', None)
    if indexer is None:
        return []
    pages = {page for _, _, _, page, _, _ in app.env.get_domain('reference').get_objects()}
    for page in pages:
        indexer.feed(page, page + '.html', '', new_document(page))
        indexer._titles[page] = 'the reference'  # for display alone: titles that are fed are searched, too
    # What Sphinx has not read is dropped just before the index is written.
    indexer.prune = lambda kept: type(indexer).prune(indexer, {*kept, *pages})
    return []


def mend_theme(app, exception):
    """Debian's Furo is not bundled: its style and script refer to files of other packages and lack what its compiler drops."""
    static = pathlib.Path(app.outdir) / '_static'
    style, script = static / 'styles/furo.css', static / 'scripts/furo.js'
    if exception or not style.is_file():
        return
    text = style.read_text(encoding='utf-8')
    foreign = re.match(r'@import url\((/javascript/[^)]*)\);', text)
    if foreign:
        text = pathlib.Path('/usr/share' + foreign[1]).read_text(encoding='utf-8') + text[foreign.end():]
    if 'prefers-color-scheme' not in text:
        dark = re.search(r'^@media not print \{\n(  body\[data-theme="dark"\] .*?\} \})$', text, re.DOTALL | re.MULTILINE)
        text += '\n@media screen and (prefers-color-scheme: dark) {\n'
        text += dark[1].replace('body[data-theme="dark"]', 'body:not([data-theme="light"])') + '\n'
    style.write_text(text, encoding='utf-8')
    text = script.read_text(encoding='utf-8')
    imported = re.match(r'import Gumshoe from "\./([\w-]+\.js)";', text)
    if imported:
        text = (script.parent / imported[1]).read_text(encoding='utf-8') + text[imported.end():]
        script.write_text(text, encoding='utf-8')


def setup(app):
    app.add_config_value('reference_tags', '', 'html')
    app.add_domain(Reference)
    app.connect('source-read', read_source)
    app.connect('doctree-read', mark_charts)
    app.connect('doctree-read', mark_cells)
    app.connect('doctree-read', mark_literals)
    app.connect('html-page-context', mark_options)
    app.connect('html-collect-pages', index_reference)
    app.connect('build-finished', mend_theme)
