"""HTML of all pages: what is put into a template is escaped, unless it is `Markup` already."""

from __future__ import annotations

from functools import lru_cache
from importlib.resources import files
from typing import Any

from jinja2 import Environment, StrictUndefined, Template
from markupsafe import Markup

__all__ = ['Markup', 'fragment', 'page']

_ENVIRONMENT = Environment(
    autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)


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


def page(package: str, template: str, **values: Any) -> str:
    """Return the page of a template that is a file of `package`, with values as `fragment`."""
    return str(fragment(files(package).joinpath(template).read_text('utf-8'), **values))
