"""The page of a map: which law fails how often, where it is worse than the base, figures."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from html import escape
from pathlib import Path

import numpy as np

from ctc_chattering.analysis.drawing import FigureFile
from ctc_chattering.analysis.report import write_sections
from ctc_chattering.robustness.report.axis import GridAxis, number
from ctc_chattering.robustness.report.boundary import pooled, side
from ctc_chattering.robustness.report.contrast import Contrast, contrast, passing
from ctc_chattering.robustness.report.data import Counts, KINDS, MapData

_NUMBER = ' class="n"'


def write_map_page(data: MapData, figures: Sequence[FigureFile], path: Path,
                   facts: Mapping[str, str], files: Mapping[str, str]) -> None:
    """
    Write the page of a map.

    Parameters
    ----------
    data : MapData
        As `map_data` returns it.
    figures : sequence of FigureFile
        As `save_map_figures` returns them; linked relative to the page, the first at the top.
    path : Path
        The page, for example ``out/index.html``.
    facts : mapping of str to str
        What axes and uncertain parameters are, by name, and further lines of the summary, for
        example what counts as a failure.
    files : mapping of str to str
        Names of files beside the page, and what they are.

    Raises
    ------
    CtcError
        If the file cannot be written.

    """
    links = [f'<a href="{escape(name)}">{escape(name)}</a> ({escape(what)})'
             for name, what in files.items()]
    numbers = '\n'.join([_failures(data), *_against_base(data), *_boundaries(data),
                         '<h3>What was run</h3>', _summary(data, facts)])
    write_sections(path, _headline(data), numbers, figures, links, lead=_lead(data))


def _headline(data: MapData) -> str:
    """Return how often the best law fails, and the base, or the worst one."""
    failed, runs = data.kinds.sum(axis=0), _runs(data)
    if not failed.any():
        return 'No run fails'
    order = np.argsort(failed / runs, kind='stable').tolist()
    shown = list(dict.fromkeys([order[0], order[-1] if data.base is None else data.base,
                                order[-1]]))[:2]
    texts = [f'{escape(data.variants[v])} {{}}in {_percent(failed[v], runs[v])}' for v in shown]
    return ', '.join(texts).format('fails ', '') + ' of the runs'


def _lead(data: MapData) -> str:
    axes = ' × '.join(axis.name for axis in data.axes)
    points = f'over {escape(axes)}: {_many(int(np.prod(data.shape)), "point")}, ' if axes else ''
    return (f'{_many(len(data.variants), "law")} {points or "with "}'
            f'{_many(data.repeats, "draw")}{" each" if axes else ""}, '
            f'{_many(len(data.variant), "run")} in all.')


def _failures(data: MapData) -> str:
    """Return the table of failures: a row a variant, a column a kind."""
    used = [k for k in range(len(KINDS)) if data.kinds[k].any()]
    heads = ['law', 'runs', 'fail', *(KINDS[k] for k in used), 'median error [rad], 95 % quantile',
             *(['points that pass / undecided / fail'] if data.axes else [])]
    sides = side(data.failed, data.runs)
    rows = []
    for v, name in enumerate(data.variants):
        runs = int(_runs(data)[v])
        error = np.sort(data.error[data.variant == v])
        middle, high = (error[int(np.ceil(q * runs)) - 1] for q in (0.5, 0.95))
        rows.append([name, f'{runs}', *(_share(*data.of_draws(v, kind)) for kind in (None, *used)),
                     f'{_error(middle)}\n{_error(high)}'])
        if data.axes:
            rows[-1].append(' / '.join(str(int(((sides[v] == x) & (data.runs[v] > 0)).sum()))
                                       for x in (-1, 0, 1)))
    return _table(heads, rows) + (
        '<p class="fine">Below each share: its interval of 95 % '
        + ('for other draws on this grid; all points have the same draws, so it is as wide as '
           'these differ, and there is none for one draw. A point passes if its own interval '
           '(Wilson) is below one half, and fails if it is above.' if data.axes else '(Wilson).')
        + ' A run counts under the first kind that applies; one that diverged has an infinite '
        'error.</p>')


def _against_base(data: MapData) -> Iterator[str]:
    """Yield where each law is worse than the base, the worst first."""
    base = data.base
    if base is None or len(data.variants) == 1:
        return
    name = data.variants[base]
    yield f'<h3>Where a law is worse than {escape(name)}</h3>'
    found = {v: contrast(data, v, base) for v in range(len(data.variants)) if v != base}
    worse = [v for v in found if found[v].larger or found[v].worse]
    for v in sorted(worse, key=lambda v: (-found[v].worse, -found[v].loss)):
        yield (f'<p class="attention"><b>{escape(data.variants[v])}</b> '
               f'{escape(_sentences(found[v], name))}</p>')
    for v in found:
        if v not in worse:
            yield (f'<p><b>{escape(data.variants[v])}</b> nowhere; {escape(name)} fails where it '
                   f'does not in {found[v].better} of {_many(found[v].runs, "run")}.</p>')
    yield ('<p class="fine">Of runs at the same point, with the same draw and the same noise. '
           '<code>ctc map SPEC --explain RUN</code> shows one.</p>')


def _sentences(found: Contrast, base: str) -> str:
    text = (f'fails where {base} does not in {found.worse} of {_many(found.runs, "run")}; '
            f'the reverse in {found.better}.')
    if found.points:
        text += f' Half of its runs or more fail, and less of {base}, at {found.points}.'
    text += f' In {_many(found.larger, "run")} its error is the larger one'
    if found.loss > 1.0:
        text += f', up to {number(found.loss)} times as large in run {found.run}'
        text += f', {found.where}' if found.where else ''
    return text + '.'


def _boundaries(data: MapData) -> Iterator[str]:
    """Yield a table for each axis: which of its values pass, at values of the others."""
    for k, axis in enumerate(data.axes):
        rows, count = passing(data, k)
        others = ', '.join(x.name for x in data.axes if x is not axis)
        table = _table([others, *data.variants],
                       [[name or axis.label, *cells] for name, cells in rows])
        cut = f'<p class="fine">{len(rows)} of {count} rows.</p>' if len(rows) < count else ''
        yield (f'<details{" open" if len(data.axes) == 1 else ""}><summary>Values of '
               f'{escape(axis.label)} at which less than half of the runs fail</summary>'
               f'{table}{cut}</details>')


def _summary(data: MapData, facts: Mapping[str, str]) -> str:
    """Return axes, draws, seeds and engines, then the `facts` of nothing of these."""
    first, last = data.seeds
    lines = {axis.label: ': '.join(filter(None, (_values(axis), facts.get(axis.name))))
             for axis in (*data.axes, *data.fixed)}
    lines |= {name: facts.get(name, 'drawn') for name in data.uncertain}
    lines['runs'] = (f'{_many(data.repeats, "run")} of each law'
                     + (' at each point' if data.axes else '')
                     + f'; seeds of the noise {first} to {last}')
    lines['engines'] = ', '.join(f'{name}: {_many(n, "run")}' for name, n in data.engines.items())
    lines |= {name: text for name, text in facts.items() if name not in data.columns}
    return _table([], [[*line] for line in lines.items()])


def _values(axis: GridAxis) -> str:
    first, *others = (number(x) for x in axis.values)
    return f'{len(axis.values)} values, {first} to {others[-1]}' if others else first


def _table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table in HTML; the first column has names. The second line of a cell is small."""
    head = ''.join(f'<th scope="col"{_NUMBER if k else ""}>{escape(x)}</th>'
                   for k, x in enumerate(heads))
    body = '\n'.join(f'<tr class="first"><th scope="row">{_bound(row[0])}</th>' + ''.join(
        f'<td{_NUMBER if heads else ""}>{_lines(x)}</td>' for x in row[1:]) + '</tr>'
        for row in rows)
    return ('<div class="scroll"><table>' + (f'<thead><tr>{head}</tr></thead>' if heads else '')
            + f'<tbody>{body}</tbody></table></div>')


def _bound(text: str) -> str:
    """Return text for HTML that breaks at commas only."""
    return escape(text).replace(' ', '&nbsp;').replace(',&nbsp;', ', ')


def _lines(text: str) -> str:
    first, _, second = text.partition('\n')
    return escape(first) + (f'<br><small>{_bound(second)}</small>' if second else '')


def _runs(data: MapData) -> Counts:
    return np.bincount(data.variant, minlength=len(data.variants))


def _share(failures: Counts, runs: Counts) -> str:
    """Return a share with its interval, if there is one, from the counts of each draw."""
    low, high = (100.0 * x for x in pooled(failures, runs))
    interval = '' if np.isnan(low) else f'\n{low:.1f} to {high:.1f}'
    return _percent(int(failures.sum()), int(runs.sum())) + interval


def _percent(part: int, whole: int) -> str:
    return f'{100.0 * part / whole:.1f} %'


def _error(value: float) -> str:
    """Return an error that does not break at its sign."""
    if not np.isfinite(value):
        return 'diverged'
    mantissa, exponent = f'{value:.2e}'.split('e')
    return f'{mantissa}e{int(exponent)}'.removesuffix('e0').replace('-', '−')


def _many(n: int, noun: str) -> str:
    return f'{n:,}'.replace(',', '\N{NARROW NO-BREAK SPACE}') + f' {noun}{"s"[:n != 1]}'
