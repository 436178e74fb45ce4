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
The page of every command: sections of tables, figures, cards and plots.

Commands describe a page by the records here, and `write_page` makes it of ``web/page.html``. All
texts are escaped, unless they are `Markup`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
import dataclasses
from itertools import count, pairwise
import os
from pathlib import Path
from typing import Any, NamedTuple

import ctc_chattering
from ctc_chattering.analysis import markup
from ctc_chattering.analysis.markup import Markup
from ctc_chattering.analysis.tables import Table
from ctc_chattering.output_files import write_text

_PACKAGE = 'ctc_chattering.analysis'


@dataclasses.dataclass(frozen=True)
class FigureFile:
    """
    A figure on disk.

    Attributes
    ----------
    path : Path
        The file that a page shows.
    title, caption : str
        Title, and a description with the conditions of what is shown.
    copies : tuple of Path
        The figure in other formats.
    size : (float, float), optional
        Width and height [pixel].
    group : str
        Name of the run whose figures are shown together, or '' for none.

    """

    path: Path
    title: str
    caption: str
    copies: tuple[Path, ...] = ()
    size: tuple[float, float] | None = None
    group: str = ''


class Card(NamedTuple):
    """
    A result that stands out.

    Attributes
    ----------
    title, big : str
        Subject, and result.
    texts, fine : sequence of str
        Paragraphs, and small ones.
    severity : int, optional
        Colour of a verdict, 0 to 2.

    """

    title: str
    big: str
    texts: Sequence[str] = ()
    fine: Sequence[str] = ()
    severity: int | None = None


class Cards(NamedTuple):
    """Cards beside each other."""

    cards: Sequence[Card]


class Note(NamedTuple):
    """
    A paragraph, by default one that asks for attention.

    `name` is bold before it.
    """

    text: str
    name: str = ''
    attention: bool = True


class Listing(NamedTuple):
    """A heading and sentences."""

    title: str
    texts: Sequence[str]


class PlottedRun(NamedTuple):
    """
    A run of plots.

    Attributes
    ----------
    name : str
        Its name.
    path : Path
        The file with its samples.
    colour : str
        Its colour, ``#rrggbb``.
    received : bool
        Torques have times of reception. No rate or spectrum follows from these.

    """

    name: str
    path: Path
    colour: str
    received: bool = False


class SignalPlots(NamedTuple):
    """
    Plots whose signals, joints and times the user chooses.

    Attributes
    ----------
    title, caption : str
        As those of a figure.
    joints, units : sequence of str
        Names, and units of the positions.
    runs : sequence of PlottedRun
        Runs of the same joints.
    signals : sequence of str
        Signals that are shown at first, by the names of ``web/plots.js``.
    settled : float
        The time before does not scale the axes while later ones are shown [s].
    mark : float, optional
        A time that is marked [s].

    """

    title: str
    caption: str
    joints: Sequence[str]
    units: Sequence[str]
    runs: Sequence[PlottedRun]
    signals: Sequence[str]
    settled: float
    mark: float | None = None


class Folded(NamedTuple):
    """Items that a click on the title shows."""

    title: str
    items: Sequence[Item]
    opened: bool = False


#: Content of a section.
Item = Table | FigureFile | Cards | Note | Listing | SignalPlots | Folded


class Section(NamedTuple):
    """A heading with items below it."""

    title: str
    items: Sequence[Item]


def write_page(
    path: Path,
    headline: str,
    lead: str,
    sections: Sequence[Section],
    links: Sequence[tuple[str, str]] = (),
    command: str = '',
) -> None:
    """
    Write a page.

    Parameters
    ----------
    path : Path
        The page. Links to figures and samples are relative to it.
    headline, lead : str
        Title and introduction.
    sections : sequence of Section
        Those without items are left out. Figures and plots are numbered.
    links : sequence of (str, str)
        Links to data: path relative to the page, and text.
    command : str
        The command line that the page shows, or ''.

    Raises
    ------
    CtcError
        If the file cannot be written.

    """
    filler = _TemplateFiller(path.parent)
    shown = [filler.section(k, x) for k, x in enumerate((x for x in sections if x.items), 1)]
    entries = sum(1 + len(x['index']) for x in shown)
    styles = {
        name: markup.asset(_PACKAGE, f'web/page.{ending}')
        for name, ending in (('style', 'css'), ('script', 'js'))
    }
    write_text(
        path,
        markup.page(
            _PACKAGE,
            'web/page.html',
            headline=headline,
            lead=lead,
            sections=shown,
            links=links,
            command=command,
            version=ctc_chattering.__version__,
            index=entries >= 6,
            **styles,
            component=markup.component() if filler.has_plots else '',
        ),
    )


class _TemplateFiller:
    """
    Values of the page's template, with numbers and anchors of all items.

    Parameters
    ----------
    root : Path
        Folder of the page.

    """

    def __init__(self, root: Path) -> None:
        self._root = root
        self._numbers, self._anchors = count(1), count(1)
        self.has_plots = False

    def section(self, number: int, section: Section) -> dict[str, Any]:
        """Return a section, with the entries of its items in the index: anchor and text."""
        items = [self._item(x) for x in section.items]
        return {
            'title': section.title,
            'anchor': f'section{number}',
            'items': items,
            'index': [(x['anchor'], x['entry']) for x in items if x['entry']],
        }

    def _item(self, item: Item) -> dict[str, Any]:
        """Return an item with what the template cannot compute."""
        title = getattr(item, 'title', '')
        entry = title.striptags() if isinstance(title, Markup) else title
        values: dict[str, Any] = {'kind': type(item).__name__, 'value': item}
        if isinstance(item, FigureFile | SignalPlots):
            number = next(self._numbers)
            values |= {
                'number': number,
                'anchor': f'figure{number}',
                'entry': f'Figure {number}. {entry}',
            }
        else:
            values |= {'anchor': f'part{next(self._anchors)}', 'entry': entry}
        if isinstance(item, FigureFile):
            values['links'] = [self._relative(x) for x in (item.path, *item.copies)]
        elif isinstance(item, SignalPlots):
            self.has_plots = True
            runs = [
                {
                    'name': x.name,
                    'key': x.path.stem,
                    'colour': x.colour,
                    'received': x.received,
                    'path': markup.url(self._relative(x.path)),
                }
                for x in item.runs
            ]
            values['data'] = {
                'joints': item.joints,
                'units': item.units,
                'mark': item.mark,
                'settled': item.settled,
                'signals': item.signals,
                'runs': runs,
            }
        elif isinstance(item, Table):
            values['spans'] = list(_row_spans(item.rows))
        elif isinstance(item, Folded):
            values['items'] = [self._item(x) for x in item.items]
        return values

    def _relative(self, path: Path) -> str:
        """Return a path relative to the page."""
        return Path(os.path.relpath(path, self._root)).as_posix()


def _row_spans(rows: Sequence[Sequence[str]]) -> Iterator[int]:
    """
    Yield the number of rows that each row's name spans.

    It spans the rows below that have no name. These have 0.
    """
    starts = [k for k, row in enumerate(rows) if row[0] or not k]
    for start, end in pairwise([*starts, len(rows)]):
        yield from (end - start, *[0] * (end - start - 1))
