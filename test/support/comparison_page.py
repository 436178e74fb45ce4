"""Puts the tables and figures that `make compare` writes into docs/comparison.md."""

from __future__ import annotations

from pathlib import Path
import re

DOCS = Path(__file__).resolve().parents[2] / 'docs'
PAGE = DOCS / 'comparison.md'
#: A block of the page, and the directory in docs/ that it shows.
_BLOCK = re.compile(r'(<!-- tables: (\S+) -->\n).*?(<!-- end of tables -->)', re.DOTALL)


def filled(page: str) -> str:
    """Return the page with all blocks as the directories have them now."""
    return _BLOCK.sub(lambda block: f'{block[1]}{_content(block[2])}{block[3]}', page)


def _content(directory: str) -> str:
    tables = (DOCS / directory / 'compare.md').read_text(encoding='utf-8')
    figures = sorted((DOCS / directory / 'figures').iterdir())
    return f'\n{tables}\n' + ''.join(
        f'![{x.stem.replace("_", " ")}]({x.relative_to(DOCS).as_posix()})\n\n' for x in figures)


if __name__ == '__main__':
    PAGE.write_text(filled(PAGE.read_text(encoding='utf-8')), encoding='utf-8')
