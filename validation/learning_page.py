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
Picture and table of docs/learning.md: `make validate STUDY=learning_page`, some minutes.

Two arms of the package, with drives, a delay and an encoder of 2e-5 rad that the controller knows,
and a model with 10 % too little inertia and gravity. Each law learns from 8 passes. The control is
the same motion without learning, since the friction estimate of observer_feedback also improves.
"""

from __future__ import annotations

from pathlib import Path
import re
from typing import Any, NamedTuple

from comparison_page import DOCS
from ctc_chattering.analysis.result import simulate
from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.package_share import find_config
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.runs.conditions import merge_overrides
from ctc_chattering.runs.recommended import gains_by_rule
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
import numpy as np

PASSES = 8
#: Arms, and how they are called here.
ARMS = {'friction': 'two-link arm', 'panda': 'Panda'}
#: Duration of a pass of each [s].
DURATIONS = {'friction': 1.0, 'panda': 2.0}
#: Laws, and their colours on a light and on a dark page.
LAWS = {'pd_gravity': ('#b34a00', '#ff8a3d'), 'compensation': ('#0072b2', '#56b4e9'),
        'observer_feedback': ('#00805d', '#2cc79a')}
INK, PAPER, GRID = ('#24292f', '#e6e9ec'), ('#ffffff', '#14171b'), ('#d0d7de', '#39424c')
_BLOCK = re.compile(r'(<!-- passes -->\n).*?(<!-- end of passes -->)', re.DOTALL)


class Passes(NamedTuple):
    """RMS error of the worst joint [rad] and torque variation [N·m/s] of each pass."""

    errors: list[float]
    variations: list[float]
    #: Errors in the same intervals of a run without learning.
    errors_without: list[float]


def learn(arm: str, law: str) -> Passes:
    """Simulate a law that learns, and return the numbers of its passes."""
    path = find_config(arm)
    n = len(parameter_file.load(path).plant.joint_names)
    drives: dict[str, Any] = {'actuator_lag': [2e-3] * n, 'input_delay': 1}
    overrides: Any = {
        'plant': {**drives, 'encoder_resolution': [2e-5] * n, 'velocity_sensor': 'difference',
                  'duration': 4.0 + (PASSES + 1) * (DURATIONS[arm] + 0.75)},
        'controller': {'law': law, **drives},
        'reference': {'start_duration': 2.0, 'learning': True,
                      'frequency': [1.0 / DURATIONS[arm]] * n}}
    gains = gains_by_rule(parameter_file.load(path, overrides))
    wrong = {'inertia_scale': 0.9, 'gravity_scale': 0.9}
    overrides = merge_overrides(overrides, {'controller': {**gains, **wrong}})
    result = simulate(parameter_file.load(path, overrides), truth=True)
    without = simulate(parameter_file.load(
        path, merge_overrides(overrides, {'reference': {'learning': False}})), truth=True)
    assert result.learner is not None
    errors, variations, errors_without = [], [], []
    for finished in result.learner.passes[:PASSES + 1]:
        inside = (result.run.t >= 1e-9 * finished.begin) & (result.run.t < 1e-9 * finished.end)
        errors.append(worst_error(result.run.e[inside]))
        errors_without.append(worst_error(without.run.e[inside]))
        steps = np.abs(np.diff(result.run.tau[inside], axis=0)).sum()
        variations.append(float(steps / DURATIONS[arm]))
    return Passes(errors, variations, errors_without)


def worst_error(e: Array) -> float:
    """Return the RMS error of the worst joint [rad] for errors of shape (N, n)."""
    return float(np.sqrt((e ** 2).mean(axis=0)).max())


def draw(passes: dict[tuple[str, str], Passes]) -> Figure:
    """Return errors by pass, a panel for each arm, in the colours of a light page."""
    figure = Figure(figsize=(9.0, 3.4), facecolor=PAPER[0])
    FigureCanvasAgg(figure)
    axes = figure.subplots(1, len(ARMS), sharey=True)
    for ax, (arm, name) in zip(axes, ARMS.items()):
        for law, (colour, _) in LAWS.items():
            ax.plot(passes[arm, law].errors, 'o-', color=colour, markersize=4, label=law)
            ax.plot(passes[arm, law].errors_without, '--', color=colour, linewidth=1.0)
        ax.set(yscale='log', xlabel='passes learned from', facecolor=PAPER[0])
        ax.set_title(name, loc='left', fontsize=11, color=INK[0])
        ax.grid(True, color=GRID[0], linewidth=0.6)
        ax.spines[['top', 'right']].set_visible(False)
        ax.spines[['left', 'bottom']].set_color(GRID[0])
        ax.tick_params(which='both', color=GRID[0], labelcolor=INK[0])
        ax.xaxis.label.set_color(INK[0])
    axes[0].set_ylabel('RMS error of the worst joint [rad]', color=INK[0])
    axes[0].legend(frameon=False, labelcolor=INK[0], loc='upper right', bbox_to_anchor=(1, 0.77))
    figure.tight_layout()
    return figure


def write_picture(figure: Figure, path: Path) -> None:
    """Write an SVG that is light on a light page, and dark on a dark one."""
    figure.savefig(path, metadata={'Date': None})
    text = path.read_text(encoding='utf-8')
    themes = dict([INK, PAPER, GRID, *LAWS.values()])
    dark = ''
    for k, (light, other) in enumerate(themes.items()):
        text = text.replace(light, f'var(--c{k}, {light})')
        dark += f'--c{k}: {other}; '
    style = f'<style>@media (prefers-color-scheme: dark) {{ svg {{ {dark}}} }}</style>\n <defs>'
    path.write_text(text.replace('<defs>', style, 1), encoding='utf-8')


def table(passes: dict[tuple[str, str], Passes]) -> str:
    """Return the numbers as a Markdown table."""
    lines = ['| arm | law | error before [rad] | after 2 passes | after 4 | after 8 | then, '
             'without learning | torque variation, relative to before |', f'|{"---|" * 8}']
    for (arm, law), (errors, variations, errors_without) in passes.items():
        numbers = [f'{x:.1e}' for x in (*(errors[k] for k in (0, 2, 4, 8)), errors_without[8])]
        lines.append(f'| {ARMS[arm]} | {law} | {" | ".join(numbers)} | '
                     f'{variations[8] / variations[0]:.2f} |')
    return '\n'.join(lines) + '\n'


def main() -> None:
    """Simulate all, and write picture and table."""
    passes = {(arm, law): learn(arm, law) for arm in ARMS for law in LAWS}
    write_picture(draw(passes), DOCS / 'learning.svg')
    page = DOCS / 'learning.md'
    text = page.read_text(encoding='utf-8')
    page.write_text(_BLOCK.sub(lambda block: f'{block[1]}{table(passes)}{block[2]}', text),
                    encoding='utf-8')


if __name__ == '__main__':
    main()
