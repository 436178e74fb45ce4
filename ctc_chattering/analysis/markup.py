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
HTML of all pages, from templates of jinja2.

Values of a template are escaped, unless they are `Markup`. Plots of pages use uPlot for axes, and
scripts of this package for the rest.
"""

from __future__ import annotations

from functools import lru_cache
from importlib.resources import files
import json
import os
from typing import Any
from urllib.parse import quote

from ctc_chattering.number_format import format_decimal
from jinja2 import Environment, FunctionLoader, StrictUndefined, Template
from markupsafe import escape, Markup

__all__ = ['Markup', 'asset', 'component', 'fragment', 'page', 'url']


def _source(name: str) -> str:
    """Return a template by its name, ``package/file``."""
    package, _, file = name.partition('/')
    return files(package).joinpath(file).read_text('utf-8')


_ENVIRONMENT = Environment(
    autoescape=True,
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
    loader=FunctionLoader(_source),
)


@lru_cache(maxsize=256)
def _compiled(source: str) -> Template:
    """Return a template, compiled once."""
    return _ENVIRONMENT.from_string(source)


def fragment(source: str, /, **values: Any) -> Markup:
    """
    Return a piece of HTML.

    Parameters
    ----------
    source : str
        Template of jinja2: a constant of the package, never text from outside.
    **values : Any
        Values of its variables. Everything is escaped that is not `Markup`.

    Raises
    ------
    jinja2.UndefinedError
        If a variable has no value.

    """
    return Markup(_compiled(source).render(**values))


def page(package: str, template: str, **values: Any) -> Markup:
    """
    Return a page.

    Its template is a file of `package`. Values are treated as by `fragment`.
    """
    return Markup(_ENVIRONMENT.get_template(f'{package}/{template}').render(**values))


def asset(package: str, name: str) -> Markup:
    """Return a style or script of `package`, unchanged."""
    return Markup(_source(f'{package}/{name}'))


@lru_cache
def component() -> Markup:
    """
    Return style and script of the plots for a page's head.

    The script defines the object `ctcPlots`, which plots.js describes.
    """
    read = {
        name: asset('ctc_chattering.analysis', f'web/{name}')
        for name in (
            'uPlot.min.css',
            'plots.css',
            'uPlot.LICENSE',
            'uPlot.iife.min.js',
            'samples.js',
            'panel.js',
            'svg.js',
            'plots.js',
        )
    }
    return fragment(
        '<style>{{ read["uPlot.min.css"] }}{{ read["plots.css"] }}</style>\n<script>\n'
        '/*{{ read["uPlot.LICENSE"] }}*/\n{{ read["uPlot.iife.min.js"] }}\n'
        'const ctcPlots = (() => {\n"use strict";\n{{ read["samples.js"] }}\n'
        '{{ read["panel.js"] }}\n{{ read["svg.js"] }}\n{{ read["plots.js"] }}'
        'return { mount: (...given) => new Plots(...given), inflated };\n})();\n</script>',
        read=read,
    )


def url(path: str) -> str:
    """
    Return the address of a file by its relative path.

    It never has a scheme.
    """
    return quote(os.fsencode(path))


def _breakable(text: str) -> Markup:
    """Return text that may break after an underscore."""
    return escape(text).replace('_', Markup('_<wbr>'))


def in_html(value: float | None) -> Markup:
    """
    Return a number to three digits.

    The attribute of its element has the exact value.
    """
    if value is None:
        return Markup('<span class="none" title="none">–</span>')
    text = format_decimal(value).replace('-', '−')
    return Markup('<data value="{!r}">{}</data>').format(value, text)


_ENVIRONMENT.filters.update(number=in_html, url=url, json=json.dumps, breakable=_breakable)
