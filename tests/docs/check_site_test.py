#!/usr/bin/env python3
"""check_site.py finds what it is for, and nothing in a site that is whole."""
import json
import pathlib
import sys
import tempfile
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).parent))
import check_site

INDEX = {'docnames': ['reference/all'], 'objects': {'': [[0, 0, 0, name, name] for name in
                                                         ('Ida', 'SpringSystem', 'solve', 'Kcf', 'Tracker')]}}
SITE = {
    'index.html': '<style>a { background: url(_static/a.png) }</style><h1 id="x">A</h1><a href="#x">x</a>'
                  '<a href="CHANGELOG.html">changes</a><a href="https://example.org/y">y</a><a href="reference/all.html#Ida">Ida</a>',
    'CHANGELOG.html': '<link rel="stylesheet" href="_static/styles/furo.css?digest=1"><img src="_static/a.png">',
    '_static/a.png': '',
    '_static/styles/furo.css': '@media screen and (prefers-color-scheme: dark) { body { background: url("../a.png"); } }',
    '_static/scripts/furo.js': 'main();',
    'reference/all.html': '<p>As Sec. 3 says.</p>' + ''.join(f'<a id="{row[4]}"></a>' for row in INDEX['objects']['']),
    'searchindex.js': f'Search.setIndex({json.dumps(INDEX)})',
}


class CheckSite(unittest.TestCase):
    def problems(self, left_out=(), **changed):
        with tempfile.TemporaryDirectory() as folder:
            for name, text in {**SITE, **changed}.items():
                path = pathlib.Path(folder, name)
                path.parent.mkdir(parents=True, exist_ok=True)
                if text is not None:
                    path.write_text(text, encoding='utf-8')
            return '\n'.join(check_site.problems_of(pathlib.Path(folder), left_out))

    def test_whole(self):
        self.assertEqual(self.problems(), '')

    def test_addresses(self):
        for address, problem in {'none.html': 'is not in the site', '../x.html': 'is outside of the site',
                                 '/javascript/x.css': 'is outside of the site', '#none': 'no place of that name',
                                 'reference/all.html#none': 'no place of that name'}.items():
            for text in (f'<a href="{address}">', f'<img src="{address}">', f'<img srcset="{address} 2x">'):
                self.assertIn(address, self.problems(**{'page.html': text}))
                self.assertIn(problem, self.problems(**{'page.html': text}))
        for style in ('@import "none.css";', '@import url(none.css);', "a { background: url('none.css') }"):
            self.assertIn('_static/own.css: none.css is not in the site', self.problems(**{'_static/own.css': style}))
            self.assertIn('page.html: none.css is not in the site', self.problems(**{'page.html': f'<style>{style}</style>'}))
        self.assertEqual(self.problems(**{'_static/own.css': '/* @import "none.css"; */ a { background: url(data:image/png;base64,x) }'}), '')

    def test_systems_of_the_playground(self):
        playground = {'playground/playground.html': '', 'playground/presets.js': "['cloth', 'A cloth']"}
        self.assertEqual(self.problems(**playground, **{'page.html': '<a href="playground/playground.html#preset=cloth">'}), '')
        self.assertIn('no place of that name', self.problems(**playground, **{'page.html': '<a href="playground/playground.html#preset=none">'}))

    def test_left_out(self):
        page = {'page.html': '<script src="gone.js"></script><script src="other.js"></script>'}
        self.assertEqual(self.problems(left_out=['gone.js'], **page), 'page.html: other.js is not in the site')

    def test_theme(self):
        self.assertIn('no dark mode', self.problems(**{'_static/styles/furo.css': 'body {}'}))
        self.assertIn('imports a module', self.problems(**{'_static/scripts/furo.js': 'import A from "./a.js";'}))

    def test_briefs(self):
        for end in ('</p>', '  \n <a href="#Ida">More', '<br />', '</td>'):
            self.assertIn('a brief ends', self.problems(**{'reference/cut.html': f'<a id="Ida"></a><p>The model (Sec. {end}'}))

    def test_changelog(self):
        self.assertIn('CHANGELOG.html is not in the site', self.problems(**{'CHANGELOG.html': None}))
        self.assertIn('no link to CHANGELOG.html', self.problems(**{'index.html': ''}))

    def test_search(self):
        self.assertIn('does not find Ida', self.problems(**{'searchindex.js': 'Search.setIndex({"docnames": [], "objects": {}})'}))
        self.assertIn('has no place', self.problems(**{'reference/all.html': ''}))
        self.assertIn('not in the site', self.problems(**{'searchindex.js': SITE['searchindex.js'].replace('/all', '/none')}))


unittest.main()
