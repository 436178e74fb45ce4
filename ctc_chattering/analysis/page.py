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

"""The page of a command: sections of tables, figures and plots, an index, and what was run."""

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
#: Entries from which on a page has an index.
_INDEXED = 6


@dataclasses.dataclass(frozen=True)
class FigureFile:
    """
    A figure on disk.

    Attributes
    ----------
    path : Path
        The file that a page shows.
    title, caption : str
        What it shows, and under which condition.
    others : tuple of Path
        The same in other formats.
    size : (float, float), optional
        Width and height [pixel].
    group : str
        Name of the run whose figures are shown together; empty for none.

    """

    path: Path
    title: str
    caption: str
    others: tuple[Path, ...] = ()
    size: tuple[float, float] | None = None
    group: str = ''


class Card(NamedTuple):
    """
    A result that stands out.

    Attributes
    ----------
    title, big : str
        What it is about, and the result.
    texts, fine : sequence of str
        Paragraphs, and small ones.
    severity : int, optional
        0 to 2 for a verdict: its colour.

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
    """A paragraph, by default one that asks for attention; `name` is bold before it."""

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
        Whether torques stand at times of reception, from which no rate or spectrum follows.

    """

    name: str
    path: Path
    colour: str
    received: bool = False


class SignalPlots(NamedTuple):
    """
    Plots of runs, of which the user chooses signals, joints and times.

    Attributes
    ----------
    title, caption : str
        As those of a figure.
    joints, units : sequence of str
        Names, and units of the positions.
    runs : sequence of PlottedRun
        Of the same joints.
    signals : sequence of str
        Chosen at first, by the names of ``web/plots.js``.
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
    """Items that are shown by a click on the title."""

    title: str
    items: Sequence[Item]
    opened: bool = False


#: What a section consists of.
Item = Table | FigureFile | Cards | Note | Listing | SignalPlots | Folded


class Section(NamedTuple):
    """A part of a page, with a heading."""

    title: str
    items: Sequence[Item]


def write_page(path: Path, headline: str, lead: str, sections: Sequence[Section],
               links: Sequence[tuple[str, str]] = (), command: str = '') -> None:
    """
    Write a page; everything is text, and escaped, unless it is `Markup`.

    Parameters
    ----------
    path : Path
        The page; figures and samples are linked relative to it.
    headline, lead : str
        Its title, and what it is about.
    sections : sequence of Section
        Those without items are left out. Figures and plots are numbered.
    links : sequence of (str, str)
        To data: path relative to the page, and text.
    command : str
        What was run; left out for none.

    Raises
    ------
    CtcError
        If the file cannot be written.

    """
    numbers, anchors = count(1), count(1)
    shown: list[dict[str, Any]] = []
    for title, items in sections:
        if items:
            parts = [_part(x, path.parent, numbers, anchors) for x in items]
            shown.append({'title': title, 'anchor': f'section{len(shown) + 1}', 'parts': parts,
                          'index': [entry for part in parts for entry in _entries(part)]})
    plots = any(isinstance(x, SignalPlots) for _, items in sections for x in items)
    write_text(path, markup.page(
        _PACKAGE, 'web/page.html', headline=headline, lead=lead, sections=shown, links=links,
        command=command, version=ctc_chattering.__version__, style=_own('page.css'),
        script=_own('page.js'), component=markup.component() if plots else '',
        index=sum(1 + len(x['index']) for x in shown) >= _INDEXED))


def _own(name: str) -> Markup:
    return markup.asset(_PACKAGE, f'web/{name}')


def _part(item: Item, root: Path, numbers: Iterator[int], anchors: Iterator[int]
          ) -> dict[str, Any]:
    """Return an item as the template has it: with its number, links from `root`, anchor."""
    part: dict[str, Any] = {'kind': type(item).__name__, 'value': item}
    if isinstance(item, FigureFile | SignalPlots):
        part['number'] = next(numbers)
        part['anchor'] = f'figure{part["number"]}'
    else:
        part['anchor'] = f'part{next(anchors)}'
    if isinstance(item, FigureFile):
        part.update(links=[_relative(x, root) for x in (item.path, *item.others)], size=item.size)
    if isinstance(item, SignalPlots):
        part['data'] = {
            'joints': item.joints, 'units': item.units, 'mark': item.mark,
            'settled': item.settled, 'signals': item.signals, 'runs': [
                {'name': x.name, 'key': x.path.stem, 'colour': x.colour, 'received': x.received,
                 'path': markup.url(_relative(x.path, root))} for x in item.runs]}
    if isinstance(item, Table):
        part['spans'] = list(_spans(item.rows))
    if isinstance(item, Folded):
        part['parts'] = [_part(x, root, numbers, anchors) for x in item.items]
    return part


def _spans(rows: Sequence[Sequence[str]]) -> Iterator[int]:
    """Yield for each row how many it names, with those below that have no name; 0 for these."""
    starts = [k for k, row in enumerate(rows) if row[0] or not k]
    for start, end in pairwise([*starts, len(rows)]):
        yield from (end - start, *[0] * (end - start - 1))


def _entries(part: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield anchor and text of an item's entry of the index, if it has one."""
    title = getattr(part['value'], 'title', '')
    if title:
        text = title.striptags() if isinstance(title, Markup) else title
        yield part['anchor'], f'Figure {part["number"]}. {text}' if 'number' in part else text


def _relative(path: Path, root: Path) -> str:
    return Path(os.path.relpath(path, root)).as_posix()
