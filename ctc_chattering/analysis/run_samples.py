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

"""Samples of runs as a page reads them, and which runs it plots together."""

from __future__ import annotations

from collections.abc import Sequence
import json
from pathlib import Path

from ctc_chattering.analysis.interactive_plots import coded, PARTS, signals_of
from ctc_chattering.analysis.output import file_stem, write_text
from ctc_chattering.analysis.page import PlottedRun, SignalPlots
from ctc_chattering.analysis.result import Result
from ctc_chattering.analysis.run_names import colours, names
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np

#: Numbers of a run that a page reads in full; of more, extremes of stretches are left.
MOST = 5_000_000
#: Signals that are shown at first.
_CHOSEN = ('e', 'torque', 'V')


def write_samples(results: Sequence[Result], directory: Path) -> list[SignalPlots]:
    """
    Write the samples of each run as a script, and return plots: one for each experiment.

    Parameters
    ----------
    results : sequence of Result
        Runs.
    directory : Path
        Created if necessary.

    Raises
    ------
    CtcError
        If a file cannot be written.

    """
    groups: dict[tuple[str, ...], list[tuple[Result, str, str]]] = {}
    for result, name, colour in zip(results, names(results), colours(results)):
        groups.setdefault((result.experiment, *result.joint_names, *result.position_units),
                          []).append((result, name, colour))
    used: set[str] = set()
    return [_written(group, directory, used) for group in groups.values()]


def _written(group: Sequence[tuple[Result, str, str]], directory: Path, used: set[str]
             ) -> SignalPlots:
    """Write the samples of runs that are plotted together."""
    first, runs, long = group[0][0], [], []
    for result, name, colour in group:
        # The page has q_d from q and e; beside each other, runs have no parts of the torque.
        left_out = ('q_d', *(PARTS if len(group) > 1 else ()))
        t, signals = decimated(result.run.t, {
            x: rows for x, rows in signals_of(result).items() if x not in left_out}, MOST)
        path = directory / f'{file_stem(name, used)}.js'
        write_text(path, f'ctcSamples[{json.dumps(path.stem)}] = "{coded(t, signals)}";\n')
        runs.append(PlottedRun(name.removeprefix(f'{result.experiment}: '), path, colour))
        long += [name] if len(t) < len(result.run.t) else []
    # Not the start, with its large errors.
    settled = min(first.window[0], 0.4 * float(first.run.t[-1]))
    marks = {time for result, _, _ in group for time, _ in result.marks}
    text = ('Error e = q_d − q, torque sent, V and further signals of every sample. While times '
            f'after {2.0 * settled:.3g} s are shown, axes are scaled without the first '
            f'{settled:.3g} s.')
    if long:
        text += (f' Too long to show every sample of: {", ".join(long)}. The least and greatest '
                 'value of each stretch are there, so rates and spectra are wrong; ctc export '
                 'writes all samples.')
    if len(marks) == 1:
        text += ' The line marks the change of law or switching.'
    return SignalPlots(
        f'Signals of {first.experiment}', text, first.joint_names, first.position_units, runs,
        _CHOSEN, settled, marks.pop() if len(marks) == 1 else None)


def decimated(t: Array, signals: dict[str, Array], most: int) -> tuple[Array, dict[str, Array]]:
    """
    Return `most` numbers at most: of stretches the least and greatest value, in their order.

    Parameters
    ----------
    t : ndarray, shape (N,)
        Times.
    signals : dict of ndarray, shape (N, n)
        Their samples.
    most : int
        Of all columns together.

    """
    rows = max(2, most // (1 + sum(x.shape[1] for x in signals.values())))
    if len(t) <= rows:
        return t, signals
    every = -(-2 * len(t) // rows)
    starts = np.arange(0, len(t), every)
    found = {}
    for name, values in {**signals, 'q_d': signals['q'] + signals['e']}.items():
        ends = np.stack([np.minimum.reduceat(values, starts), np.maximum.reduceat(values, starts)])
        falls = values[starts] > 0.5 * (ends[0] + ends[1])
        found[name] = np.where(falls, ends[::-1], ends).swapaxes(0, 1).reshape(-1, values.shape[1])
    middle = np.minimum(starts + every // 2, len(t) - 1)
    return np.stack([t[starts], t[middle]], axis=1).ravel(), found
