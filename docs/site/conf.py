"""The documentation site: the pages of docs/ by Sphinx, and a link to the reference, which is Doxygen's own.

Breathe would put the reference into Sphinx; Debian's does not know C++ concepts, which are our plug-in points.
"""
import re

project = 'Asterism'
extensions = ['myst_parser', 'sphinx.ext.mathjax']
root_doc = 'README'
source_suffix = {'.md': 'markdown'}
exclude_patterns = ['site']
nitpicky = True

myst_enable_extensions = ['dollarmath']
myst_heading_anchors = 4
myst_dmath_double_inline = True
# Links to files that are no pages are for the code host; tests/docs checks that files and headings exist.
suppress_warnings = ['ref.myst']

html_theme = 'furo'
html_title = 'Asterism'
html_copy_source = False
html_show_copyright = False
html_show_sphinx = False
html_static_path = ['static', '/usr/share/javascript/katex']  # Debian's libjs-katex: equations without a network
html_css_files = ['site.css', 'katex.min.css']
html_js_files = ['katex.min.js', 'contrib/auto-render.js']
mathjax_path = 'equations.js'  # in the place of MathJax
mathjax_options = {'defer': 'defer'}
html_theme_options = {'navigation_with_keys': True}
templates_path = ['templates']
html_sidebars = {'**': ['sidebar/brand.html', 'sidebar/search.html', 'sidebar/scroll-start.html', 'sidebar/navigation.html',
                        'reference.html', 'sidebar/scroll-end.html']}


def contents(text):
    """The site's table of contents: the links of README.md's tables, a part for each heading above one."""
    trees = []
    for section in re.split(r'^## ', text, flags=re.MULTILINE)[1:]:
        pages = re.findall(r'^\| \[([^\]]+)\]\(([\w/-]+)\.md\)', section, re.MULTILINE)
        if pages:
            lines = [f'{title} <{page}>' for title, page in pages]
            caption = section.split('\n')[0]
            trees.append('\n'.join(['```{toctree}', ':hidden:', f':caption: {caption}', '', *lines, '```']))
    return '\n\n' + '\n\n'.join(trees) + '\n'


def setup(app):
    def add_contents(_, page, source):
        if page == root_doc:
            source[0] += contents(source[0])
    app.connect('source-read', add_contents)
