# Copyright 2026 The ctc_chattering maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""
The site that `make docs` and rosdoc2 make of the Markdown pages and the docstrings.

The source directory is the root of the package, so that relative links are the same here and in
a browser of the repository. Nothing is loaded from the network.
"""

from __future__ import annotations

from pathlib import Path
import re
import sys
from typing import Any

import ctc_chattering
from docutils import nodes
from docutils.parsers.rst.states import Inliner
from sphinx.addnodes import pending_xref
from sphinx.application import Sphinx

project = 'ctc_chattering'
author = 'The ctc_chattering maintainers'
project_copyright = f'2026 {author}'
release = ctc_chattering.__version__

extensions = ['myst_parser', 'sphinx.ext.autodoc', 'sphinx.ext.autosummary',
              'sphinx.ext.napoleon', 'sphinx.ext.viewcode']
#: README.md is on the front page.
include_patterns = ['*.md', '*.rst', 'docs/**.md', 'docs/**.rst', 'validation/*.md',
                    'examples/README.md']
exclude_patterns = ['.*', '**_templates', 'README.md', 'build', 'config', 'ctc_chattering',
                    'install', 'log', 'results', 'site', 'soak', 'test',
                    'tools']
templates_path = ['docs/_templates']

#: Headings have the anchors that GitHub gives them.
myst_heading_anchors = 4
#: A single backtick in a docstring stands for a name.
default_role = 'literal'
highlight_language = 'none'

napoleon_google_docstring = False
napoleon_use_ivar = True
napoleon_use_param = False
napoleon_use_rtype = False
autodoc_member_order = 'bysource'
autodoc_default_options = {'members': True, 'show-inheritance': True}
autosummary_ignore_module_all = False

html_theme = 'furo'
html_theme_options = {  # 99 columns, as equations have them
    f'{scheme}_css_variables': {'code-font-size': '75%'} for scheme in ('light', 'dark')}
html_title = f'ctc_chattering {release}'
html_static_path = ['_static']
html_css_files = ['site.css']
html_copy_source = False
html_show_search_summary = False  # a file may not read its neighbours
html_show_sphinx = False


def remove_field_numbers(*event: Any) -> None:
    """Remove the text that Python adds to a NamedTuple's field without a docstring."""
    lines = event[-1]
    if lines and lines[0].startswith('Alias for field number'):
        lines.clear()


def keep_bar(_: Inliner, match: re.Match[str], __: int) -> tuple[str, list[Any], str, list[Any]]:
    """Keep the bars of a magnitude such as |v|, which would name a substitution."""
    end = match.end('start')
    return match.string[:end], [], match.string[end:], []


def add_title(_: Sphinx, name: str, source: list[str]) -> None:
    """Add a title to the tables that `ctc compare` writes."""
    if name.endswith('/compare'):
        source[0] = f'# Laws compared, joint by joint\n\n{source[0]}'


def remove_unresolvable_links(_: Sphinx, doctree: nodes.document) -> None:
    """
    Remove links that have no target on the site.

    Links to folders are for a browser of the repository. The letter of a shape, such as `(n,)`
    in a docstring, is no link to an attribute n.
    """
    here = Path(doctree['source']).parent
    for link in list(doctree.findall(pending_xref)):
        link.attributes.pop('refspecific', None)
        if link['reftype'] == 'myst' and (here / link['reftarget']).is_dir():
            link.replace_self(link.children)


def keep_numbers_whole(_: Sphinx, doctree: nodes.document) -> None:
    """Keep a table from breaking a number such as 2.2e-03 after its hyphen."""
    for cell in doctree.findall(nodes.entry):
        for text in list(cell.findall(nodes.Text)):
            if re.fullmatch(r'[\d.]+e-\d+.{,20}', text):
                text.parent.replace(text, nodes.inline('', '', text, classes=['pre']))


def setup(app: Sphinx) -> None:
    """Connect the functions above to the reading and writing of a page."""
    sys.path.insert(0, str(Path(__file__).parent))
    import reference_pages
    reference_pages.write(Path(__file__).parent / '_api')
    Inliner.dispatch['|'] = keep_bar
    app.connect('autodoc-process-docstring', remove_field_numbers)
    app.connect('source-read', add_title)
    app.connect('doctree-read', remove_unresolvable_links)
    app.connect('doctree-read', keep_numbers_whole)
