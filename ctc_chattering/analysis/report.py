"""The HTML page of an experiment: metrics and figures, without any external resource."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from html import escape
import math
import os
from pathlib import Path
from string import Template
from typing import Any
from urllib.parse import quote

from ctc_chattering.analysis.figures import FigureFile
from ctc_chattering.analysis.metrics import BAND
from ctc_chattering.analysis.result import finite, Result, write_text
from ctc_chattering.analysis.run_names import colours, gains, LAW_COLOURS, names

#: Columns of the table, per run and per joint: key, heading, unit.
RUN_COLUMNS = (('max_error_norm1_rad', 'Largest Σ |eᵢ|', 'rad'),
               ('reaching_time_s', 'v reached', 's'))
JOINT_COLUMNS = (('rms_error_rad', 'RMS error', 'rad'), ('rms_torque_nm', 'RMS torque', 'N·m'),
                 ('torque_variation_nm_per_s', 'Torque variation', 'N·m/s'),
                 ('max_torque_step_nm', 'Largest torque step', 'N·m'),
                 ('max_torque_rate_nm_per_s', 'Largest torque rate', 'N·m/s'))


def write_page(results: Sequence[Result], figures: Sequence[FigureFile], path: Path,
               bags: Sequence[str | None] = (), metrics: str | None = 'metrics.json') -> None:
    """
    Write a page with the results: metrics, then all figures.

    Parameters
    ----------
    results : sequence of Result
        Rows of the table.
    figures : sequence of FigureFile
        As `save_figures` returns them; linked relative to the page, the first at the top.
    path : Path
        The page, for example ``out/index.html``.
    bags : sequence of str or None
        Path of each result's bag relative to the page; None or left out for no link.
    metrics : str or None
        Path of ``metrics.json`` relative to the page; None for no link.

    Raises
    ------
    CtcError
        If the file cannot be written.

    """
    runs = [{**finite(result.metrics()), 'name': name}
            for result, name in zip(results, names(results))]
    cards = [*_comparisons(results, runs), *_reachings(results, runs)]
    shown = [_figure(i, figure, path.parent) for i, figure in enumerate(figures, 1)]
    links = [f'<a href="{_url(metrics)}">metrics.json</a>'] if metrics else []
    links += [f'<a href="{_url(bag)}">bag of {escape(run["name"])}</a>'
              for run, bag in zip(runs, bags) if bag]
    contents = ''.join(f'<li><a href="#figure{i}">{escape(figure.title)}</a></li>'
                       for i, figure in enumerate(figures, 1))
    write_text(path, _PAGE.substitute(
        LAW_COLOURS,
        headline=_headline(results, runs),
        cards=f'<div class="cards">{"".join(cards)}</div>' if cards else '',
        first=shown[0] if shown else '',
        table=_table(results, runs),
        links=f'<p>Data: {" · ".join(links)}</p>' if links else '',
        contents=f'<details><summary>All {len(figures)} figures</summary><ol>{contents}</ol>'
                 '</details>' if figures else '',
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


def _pairs(results: Sequence[Result], runs: Sequence[dict[str, Any]]
           ) -> Iterator[tuple[Result, dict[str, Any], dict[str, Any]]]:
    """Yield each run under another law only, its metrics, and those under compensation."""
    base: dict[str, dict[str, Any]] = {}
    whole = [(result, run) for result, run in zip(results, runs)
             if not result.changes and run['max_error_norm1_rad'] is not None]
    for result, run in whole:
        if result.law == 'compensation':
            base.setdefault(result.experiment, run)
    for result, run in whole:
        if result.law != 'compensation' and result.experiment in base:
            yield result, run, base[result.experiment]


def _headline(results: Sequence[Result], runs: Sequence[dict[str, Any]]) -> str:
    for result, run, base in _pairs(results, runs):
        factor = _factor(base['max_error_norm1_rad'], run['max_error_norm1_rad'])
        experiment = escape(result.experiment)
        return f'With {result.law} the largest tracking error is {factor} ({experiment})'
    return 'Computed torque plus compensation plus chattering'


def _comparisons(results: Sequence[Result], runs: Sequence[dict[str, Any]]) -> Iterator[str]:
    """Yield a card for each run that can be compared with one under compensation."""
    for result, run, base in _pairs(results, runs):
        key, unit = 'max_error_norm1_rad', result.position_units[0]
        joints = '; '.join(
            f'{escape(name)} {_factor(a, b)}' for name, a, b in
            zip(result.joint_names, base['rms_error_rad'], run['rms_error_rad']))
        variation = '; '.join(
            f'{escape(name)} {_factor(a, b)}' for name, a, b in zip(
                result.joint_names, base['torque_variation_nm_per_s'],
                run['torque_variation_nm_per_s']))
        yield (
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


_PAGE = Template("""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<title>Computed torque plus compensation plus chattering</title>
<style>
:root { --paper: #f6f7f9; --card: #ffffff; --ink: #1b1f24; --soft: #57606a; --line: #d8dee4;
  --link: #0b5cad; --compensation: #b34a00; --chattering: #0067a3; }
@media (prefers-color-scheme: dark) { :root { --paper: #14171b; --card: #1e2329; --ink: #e6e9ec;
  --soft: #a3adb8; --line: #39424c; --link: #7db8f0; --compensation: #ff9a57;
  --chattering: #63b8f2; } }
* { box-sizing: border-box; }
body { margin: 0 auto; max-width: 1120px; padding: 1.5rem 1.25rem 4rem; background: var(--paper);
  color: var(--ink); font: 16px/1.5 system-ui, sans-serif; }
h1 { font-size: 1.75rem; line-height: 1.2; margin: 0 0 .3rem; }
h2 { font-size: 1.3rem; margin: 2.2rem 0 .6rem; }
a { color: var(--link); }
.lead { color: var(--soft); margin: 0 0 1rem; }
.cards { display: grid; gap: .8rem; grid-template-columns: repeat(auto-fit, minmax(300px, 1fr)); }
.card, figure { background: var(--card); border: 1px solid var(--line); border-radius: 10px; }
.card { padding: .8rem 1rem; }
.card h2 { font-size: .95rem; font-weight: 600; color: var(--soft); margin: 0; }
.card p { margin: .3rem 0 0; }
.card .big { font-size: 1.9rem; font-weight: 700; line-height: 1.2; margin: 0; }
.fine { color: var(--soft); font-size: .875rem; }
b.compensation { color: var(--compensation); }
b.chattering { color: var(--chattering); }
figure { margin: 1rem 0 0; overflow: hidden; }
figure .scroll { display: block; background: #ffffff; }
figure img { display: block; width: 100%; min-width: 50rem; height: auto; }
@media (prefers-color-scheme: dark) {
  figure .scroll { background: #1c1c1c; }
  figure img { filter: invert(.89) hue-rotate(180deg); } }
figcaption { padding: .6rem 1rem; font-size: .925rem; border-top: 1px solid var(--line); }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; width: 100%; background: var(--card);
  border: 1px solid var(--line); font-size: .925rem; }
th, td { text-align: left; padding: .3rem .7rem; vertical-align: top; }
thead th { border-bottom: 1px solid var(--line); }
tr.first > * { border-top: 1px solid var(--line); }
th[scope=row] { font-weight: 600; }
.n { text-align: right; font-variant-numeric: tabular-nums; }
small, .none { color: var(--soft); font-weight: 400; }
.dot { display: inline-block; width: .7em; height: .7em; border-radius: 50%; margin-right: .5em;
  background: var(--soft); }
.attention { border-left: 4px solid $compensation; padding-left: .7rem; font-size: .925rem; }
details { margin: .5rem 0; }
</style>
</head>
<body>
<h1>$headline</h1>
<p class="lead">A robot arm with friction that the controller does not know, under computed torque
plus compensation, under the same law plus a chattering term Ka sgn(v), or under others.</p>
$cards
$first
<h2>Numbers</h2>
$table
$links
<h2>Figures</h2>
$contents
$figures
</body>
</html>
""")
