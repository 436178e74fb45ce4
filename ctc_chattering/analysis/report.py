"""The HTML page of an experiment: metrics and figures, without any external resource."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from html import escape
from importlib.resources import files
import math
import os
from pathlib import Path
from string import Template
from typing import Any
from urllib.parse import quote

from ctc_chattering.analysis.drawing import FigureFile
from ctc_chattering.analysis.metrics import BAND
from ctc_chattering.analysis.output import write_text
from ctc_chattering.analysis.result import finite, Result
from ctc_chattering.analysis.run_names import colours, gains, LAW_COLOURS, names

#: Columns of the table, per run and per joint: key, heading, unit.
RUN_COLUMNS = (('max_error_norm1_rad', 'Largest Σ |eᵢ|', 'rad'),
               ('reaching_time_s', 'v reached', 's'))
JOINT_COLUMNS = (('rms_error_rad', 'RMS error', 'rad'), ('rms_torque_nm', 'RMS torque', 'N·m'),
                 ('torque_variation_nm_per_s', 'Torque variation', 'N·m/s'),
                 ('max_torque_step_nm', 'Largest torque step', 'N·m'),
                 ('max_torque_rate_nm_per_s', 'Largest torque rate', 'N·m/s'))
_PAGE = Template(files('ctc_chattering.analysis').joinpath('page.html').read_text('utf-8'))
_TITLE = 'Computed torque plus compensation plus chattering'
_LEAD = ('A robot arm with friction that the controller does not know, under computed torque\n'
         'plus compensation, under the same law plus a chattering term Ka sgn(v), or under '
         'others.')
#: A run under chattering, its metrics, and those of the experiment under compensation.
Pair = tuple[Result, dict[str, Any], dict[str, Any]]


def write_page(results: Sequence[Result], figures: Sequence[FigureFile], path: Path,
               bags: Sequence[str] = ()) -> None:
    """
    Write a page with the results: metrics, then all figures.

    Parameters
    ----------
    results : sequence of Result
        Rows of the table; ``metrics.json`` with their numbers is beside the page.
    figures : sequence of FigureFile
        As `save_figures` returns them; linked relative to the page, the first at the top.
    path : Path
        The page, for example ``out/index.html``.
    bags : sequence of str
        Path of each result's bag relative to the page; left out for no links.

    Raises
    ------
    CtcError
        If the file cannot be written.

    """
    runs = [{**finite(result.metrics()), 'name': name}
            for result, name in zip(results, names(results))]
    pairs = _pairs(results, runs)
    cards = [*map(_comparison, pairs), *_reachings(results, runs)]
    links = ['<a href="metrics.json">metrics.json</a>'] + [
        f'<a href="{_url(bag)}">bag of {escape(run["name"])}</a>' for run, bag in zip(runs, bags)]
    write_sections(path, _headline(pairs), _table(results, runs), figures, links,
                   f'<div class="cards">{"".join(cards)}</div>' if cards else '')


def write_sections(path: Path, headline: str, table: str, figures: Sequence[FigureFile],
                   links: Sequence[str], cards: str = '', lead: str = _LEAD) -> None:
    """
    Write a page of these parts, all in HTML.

    Parameters
    ----------
    path : Path
        The page.
    headline, table, cards, lead : str
        Its title, its tables, what stands above these, and what the page is about.
    figures : sequence of FigureFile
        Linked relative to the page, the first at the top.
    links : sequence of str
        To data.

    Raises
    ------
    CtcError
        If the file cannot be written.

    """
    shown = [_figure(i, figure, path.parent) for i, figure in enumerate(figures, 1)]
    contents = ''.join(f'<li><a href="#figure{i}">{escape(figure.title)}</a></li>'
                       for i, figure in enumerate(figures, 1))
    write_text(path, _PAGE.substitute(
        LAW_COLOURS,
        title=_TITLE,
        lead=lead,
        headline=headline,
        cards=cards,
        first=''.join(shown[:1]),
        table=table,
        links=f'<p>Data: {" · ".join(links)}</p>',
        contents=f'<details><summary>All {len(figures)} figures</summary><ol>{contents}</ol>'
                 '</details>',
        figures='\n'.join(shown[1:])))


def _url(path: str) -> str:
    return escape(quote(path))


def _number(value: float | None) -> str:
    """Return a number to three digits, with the exact value in the attribute."""
    if value is None:
        return '<span class="none" title="none">–</span>'
    if 1e-5 <= abs(value) < 1e7:
        text = f'{value:.{max(0, 2 - math.floor(math.log10(abs(value))))}f}'
    else:
        text = f'{value:.2e}' if value else '0'
    return f'<data value="{value!r}">{text.replace("-", "−")}</data>'


def _factor(before: float, after: float) -> str:
    """Return by what factor `after` is smaller or larger."""
    if before == after:
        return 'the same'
    if not after or not before:
        return 'zero' if not after else 'no longer zero'
    ratio = max(before / after, after / before)
    text = f'{ratio:.2g}' if ratio < 9.95 else f'{ratio:,.0f}'
    return f'{text}× {"smaller" if after < before else "larger"}'


def _pairs(results: Sequence[Result], runs: Sequence[dict[str, Any]]) -> list[Pair]:
    """Return each run under another law only, with its metrics and those under compensation."""
    whole = [(result, run) for result, run in zip(results, runs)
             if not result.changes and run['max_error_norm1_rad'] is not None]
    base = {result.experiment: run for result, run in reversed(whole)
            if result.law == 'compensation'}
    return [(result, run, base[result.experiment]) for result, run in whole
            if result.law != 'compensation' and result.experiment in base]


def _headline(pairs: Sequence[Pair]) -> str:
    if not pairs:
        return _TITLE
    result, run, base = pairs[0]
    factor = _factor(base['max_error_norm1_rad'], run['max_error_norm1_rad'])
    return (f'With {result.law} the largest tracking error is {factor} '
            f'({escape(result.experiment)})')


def _comparison(pair: Pair) -> str:
    """Return the card of a pair of runs under two laws."""
    result, run, base = pair
    key, unit = 'max_error_norm1_rad', result.position_units[0]
    joints, variation = ('; '.join(
        f'{escape(name)} {_factor(a, b)}'
        for name, a, b in zip(result.joint_names, base[quantity], run[quantity]))
        for quantity in ('rms_error_rad', 'torque_variation_nm_per_s'))
    return (
        f'<section class="card"><h2>{escape(run["name"])}</h2>'
        f'<p class="big">{_factor(base[key], run[key])}</p>'
        '<p>Largest error: '
        f'<b class="compensation">{_number(base[key])} {unit}</b> under compensation → '
        f'<b class="{result.law}">{_number(run[key])} {unit}</b> with {result.law}.</p>'
        f'<p class="fine">RMS error: {joints}.<br>Torque variation: {variation}.</p>'
        '</section>\n')


def _reachings(results: Sequence[Result], runs: Sequence[dict[str, Any]]) -> Iterator[str]:
    """Yield a card for each run in which v reached 0 after a change of law."""
    for result, run in zip(results, runs):
        reached = run['reaching_time_s']
        if result.changes and reached is not None and reached > result.changes[-1][0]:
            time, law = result.changes[-1]
            yield (
                f'<section class="card"><h2>{escape(run["name"])}</h2>'
                f'<p class="big">{reached - time:#.2g} s</p>'
                f'<p>after the change to <b class="{law}">{law}</b> at '
                f't&nbsp;=&nbsp;{time:g}&nbsp;s the filtered error v of every joint is within '
                f'{BAND:g}&nbsp;rad/s, and stays there.</p>'
                '</section>\n')


def _table(results: Sequence[Result], runs: Sequence[dict[str, Any]]) -> str:
    """Return the table of metrics with a row per joint."""
    units = ''.join(f'<th scope="col" class="n">{name}<br><small>[{unit}]</small></th>'
                    for columns in (RUN_COLUMNS, (('', 'Joint', ''),), JOINT_COLUMNS)
                    for _, name, unit in columns).replace('<br><small>[]</small>', '')
    rows = []
    for result, run, colour in zip(results, runs, colours(results)):
        joints = result.joint_names
        span = f' rowspan="{len(joints)}"'
        source = f'bag {result.source}; ' if result.source else ''
        head = (f'<th scope="row"{span}><i class="dot" style="background: {colour}"></i>'
                f'{escape(run["name"])}<br><small>{escape(source + gains(result))}</small></th>')
        head += ''.join(f'<td class="n"{span}>{_number(run[key])}{_unit(result, 0, unit)}</td>'
                        for key, _, unit in RUN_COLUMNS)
        for i, joint in enumerate(joints):
            cells = ''.join(
                f'<td class="n">{_number(run[key][i] if run[key] else None)}{_unit(result, i, u)}'
                '</td>' for key, _, u in JOINT_COLUMNS)
            first = ' class="first"' if not i else ''
            rows.append(f'<tr{first}>{"" if i else head}<td class="n">{escape(joint)}</td>'
                        f'{cells}</tr>')
    when = ''
    if any(run['rms_error_rad'] for run in runs):
        low, high = runs[0]['window_s']
        when = f' Errors and torques: over t = {low:g} s to {high:g} s.'
    return (f'<div class="scroll"><table><thead><tr><th scope="col">Run</th>{units}</tr></thead>\n'
            f'<tbody>{chr(10).join(rows)}</tbody></table></div>\n<p class="fine">{when} '
            'v reached: '
            f'the time from which every |vᵢ| stays within {BAND:g} rad/s to the end. '
            'Torque variation: Σ |Δτ| per second; step and rate: from one sample to the next.</p>'
            + ''.join(f'<p class="attention"><b>{escape(run["name"])}:</b> {escape(text)}.</p>'
                      for run in runs for text in run['notes']))


def _unit(result: Result, joint: int, unit: str) -> str:
    """Return the unit for a prismatic joint, which differs from the heading's."""
    if result.position_units[joint] == 'rad' or unit == 's':
        return ''
    return f' <small>{unit.replace("rad", "m").replace("N·m", "N")}</small>'


def _figure(number: int, figure: FigureFile, directory: Path) -> str:
    source = _url(Path(os.path.relpath(figure.path, directory)).as_posix())
    return (f'<figure id="figure{number}"><a class="scroll" href="{source}"><img src="{source}" '
            f'alt="{escape(figure.title)}"></a><figcaption><b>{escape(figure.title)}.</b> '
            f'{escape(figure.caption)}</figcaption></figure>')
