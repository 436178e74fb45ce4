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
HTML of all pages: what is put into a template is escaped, unless it is `Markup` already.

Plots of pages are of uPlot for axes, and our script for the rest.
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
#: What is put together, in this order; it becomes the object `ctcPlots` of the page.
_SCRIPTS = ('samples.js', 'panel.js', 'svg.js', 'plots.js')


def _source(name: str) -> str:
    """Return a template by its name, ``package/file``."""
    package, _, file = name.partition('/')
    return files(package).joinpath(file).read_text('utf-8')


_ENVIRONMENT = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True,
                           lstrip_blocks=True, loader=FunctionLoader(_source))


@lru_cache(maxsize=256)
def _compiled(source: str) -> Template:
    return _ENVIRONMENT.from_string(source)


def fragment(source: str, /, **values: Any) -> Markup:
    """
    Return a piece of HTML.

    Parameters
    ----------
    source : str
        Template of jinja2; a constant of the package, never text from outside.
    **values : Any
        What it names. Everything is escaped that is not `Markup`.

    Raises
    ------
    jinja2.UndefinedError
        If it names something that is not given.

    """
    return Markup(_compiled(source).render(**values))


def page(package: str, template: str, **values: Any) -> Markup:
    """Return the page of a template that is a file of `package`, with values as `fragment`."""
    return Markup(_ENVIRONMENT.get_template(f'{package}/{template}').render(**values))


def asset(package: str, name: str) -> Markup:
    """Return a style or script, a file of `package`, as it is."""
    return Markup(_source(f'{package}/{name}'))


@lru_cache
def component() -> Markup:
    """Return style and script of the plots for the head of a page; see plots.js for their use."""
    def read(name: str) -> str:
        return asset('ctc_chattering.analysis', f'web/{name}')

    style = read('uPlot.min.css') + read('plots.css')
    own = '\n'.join(map(read, _SCRIPTS))
    return Markup(f'<style>{style}</style>\n<script>\n/*{read("uPlot.LICENSE")}*/\n'
                  f'{read("uPlot.iife.min.js")}\nconst ctcPlots = (() => {{\n"use strict";\n{own}'
                  'return { mount: (...given) => new Plots(...given), inflated };\n})();\n'
                  '</script>')


def url(path: str) -> str:
    """Return the address of a file by its path relative to the page; never one with a scheme."""
    return quote(os.fsencode(path))


def _breakable(text: str) -> Markup:
    """Return text that may go on in another line after an underscore."""
    return escape(text).replace('_', Markup('_<wbr>'))


def in_html(value: float | None) -> Markup:
    """Return a number to three digits, with the exact value in the attribute."""
    if value is None:
        return Markup('<span class="none" title="none">–</span>')
    text = format_decimal(value).replace('-', '−')
    return Markup('<data value="{!r}">{}</data>').format(value, text)


_ENVIRONMENT.filters.update(number=in_html, url=url, json=json.dumps, breakable=_breakable)
