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

"""What the figures show, read back from their axes; legends above the panels; texts that fit."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from ctc_chattering.analysis import drawing, run_figures
from ctc_chattering.analysis.result import Result
from ctc_chattering.analysis.run_names import LAW_COLOURS, run_name
from ctc_chattering.analysis.signals import SignalOrigin
from ctc_chattering.control.controller import ControllerConfig
from ctc_chattering.errors import CtcError
from ctc_chattering.simulation.closed_loop import Event, Run, run_closed_loop
from ctc_chattering.simulation.plant_config import PlantConfig
from ctc_chattering.trajectory.reference import ReferenceConfig
from figure_layout import overlaps
from made_up_runs import made_up
from matplotlib.axes import Axes
from matplotlib.figure import Figure
import numpy as np
import pytest

pytestmark = pytest.mark.filterwarnings('error')
DRAWN = (run_figures.tracking, run_figures.torques, run_figures.internals)
GANTRY = """<robot name="gantry"><link name="a"/><link name="b"/><link name="c"/>
<joint name="axis0" type="prismatic"><parent link="a"/><child link="b"/>
<limit lower="-1" upper="1" effort="9" velocity="9"/></joint>
<joint name="axis1" type="continuous"><parent link="b"/><child link="c"/></joint></robot>"""


def simulated(law: str, duration: float, experiment: str = 'friction', **values: Any) -> Result:
    """Return a result; one with a change to law (6) at 0.6 s where the experiment is "switch"."""
    config = ControllerConfig(law=law, **values)
    change = [(0.6, dataclasses.replace(config, law='chattering'))] * (experiment == 'switch')
    events = [Event(t, 'controller', {'law': after.law}) for t, after in change]
    run = run_closed_loop(PlantConfig(duration=duration), config, ReferenceConfig(), events)
    return Result(experiment, [(0.0, config), *change], run)


@pytest.fixture(scope='module')
def chattering() -> Result:
    return simulated('chattering', 6.0)


@pytest.fixture(scope='module')
def switch() -> Result:
    return simulated('compensation', 2.0, 'switch')


def panel(figure: Figure, unit: str, index: int = 0, enlarged: bool = False) -> Axes:
    """Return one of the axes whose y label ends in `unit`."""
    return [ax for ax in figure.axes if ax.get_ylabel().endswith(f'[{unit}]')
            and ax.get_title('left').startswith('enlarged') == enlarged][index]


def drawn(ax: Axes, line: int = 0) -> Any:
    return np.asarray(ax.lines[line].get_ydata())


def texts(ax: Axes) -> str:
    return ' | '.join(text.get_text() for text in ax.texts)


def test_tracking_draws_positions_reference_and_error(chattering: Result) -> None:
    run, figure = chattering.run, run_figures.tracking(chattering)
    for i in range(2):
        ax = panel(figure, 'rad', i)
        assert np.array_equal(drawn(ax), run.q[:, i])
        assert np.array_equal(drawn(ax, 1), run.q_d[:, i])
        assert np.array_equal(ax.lines[0].get_xdata(), run.t)
        assert ax.get_title('left') == f'joint{i + 1}'
    ax = panel(figure, 'rad', 2)
    assert np.array_equal(drawn(ax), np.abs(run.q_d - run.q).sum(axis=1))
    assert (ax.get_ylabel(), ax.get_yscale()) == ('Σ |eᵢ| [rad]', 'log')
    assert ax.get_ylim()[1] > drawn(ax).max()


def test_torques_show_the_steady_part_and_say_what_is_cut(chattering: Result) -> None:
    run, figure = chattering.run, run_figures.torques(chattering)
    for i in range(2):
        ax = panel(figure, 'N·m', i)
        assert np.array_equal(drawn(ax), run.tau[:, i]) and len(ax.lines) == 1
        low, high = ax.get_ylim()
        steady = run.tau[run.t >= 1.0, i]
        assert low < steady.min() and steady.max() < high < 2.0 * steady.max()
        assert ax.get_title('right') == f'axis cut: {run.tau[0, i]:.4g} at 0 s'
        assert not texts(ax), 'nothing may lie on the data'
    ax = panel(figure, 'N·m', enlarged=True)
    assert np.array_equal(drawn(ax), run.tau[run.t >= 5.8 - 1e-9, 0])
    assert ax.lines[0].get_drawstyle() == 'steps-post'
    ax = panel(run_figures.torques(made_up(2)), 'N·m')
    assert ax.get_ylim()[0] < drawn(ax).min() and drawn(ax).max() < ax.get_ylim()[1]
    assert not ax.get_title('right'), 'there is no peak'


def test_internals_draw_v_lyapunov_and_chattering(chattering: Result) -> None:
    terms, figure = chattering.terms, run_figures.internals(chattering)
    ax = panel(figure, 'J')
    assert np.array_equal(drawn(ax), terms.lyapunov) and ax.get_yscale() == 'log'
    for i in range(2):
        assert np.array_equal(drawn(panel(figure, 'rad/s', i)), terms.v[:, i])
        ax = panel(figure, 'N·m', i)
        assert np.array_equal(drawn(ax), terms.robust[:, i])
        assert ax.get_ylim() == (-12.5, 12.5)
    ax = panel(run_figures.internals(simulated('compensation', 0.1)), 'N·m')
    assert not drawn(ax).any() and 'not part of this law' in texts(ax)


@pytest.mark.parametrize('draw', DRAWN)
def test_a_change_of_law_is_marked_and_every_axis_has_a_unit(switch: Result, draw: Any) -> None:
    figure = draw(switch)
    for ax in figure.axes:
        assert ax.get_xlabel() == 't [s]' and ax.get_ylabel().endswith(']')
        assert [0.6, 0.6] in [np.asarray(line.get_xdata()).tolist() for line in ax.lines]
    assert '→ chattering' in texts(figure.axes[0])
    ax = next(x for x in figure.axes if x.get_title('left').startswith('enlarged'))
    assert ax.get_xlim()[0] < 0.6 < ax.get_xlim()[1]


@pytest.mark.parametrize(('experiment', 'law', 'numbers'), [
    ('friction', 'compensation', (2, 4)), ('friction', 'chattering', (3, 5)),
    ('disturbance', 'compensation', (6, 8)), ('disturbance', 'chattering', (7, 9)),
    ('mine', 'chattering', ())])
def test_titles_name_the_figures_of_the_paper(
        experiment: str, law: str, numbers: tuple[int, ...]) -> None:
    result = simulated(law, 0.1, experiment)
    titles = [draw(result).get_suptitle() for draw in (run_figures.tracking, run_figures.torques)]
    assert all(f'figure {k} of the paper' in x for k, x in zip(numbers, titles))
    assert ('paper' in ' '.join(titles)) == bool(numbers)


def test_any_number_of_joints_and_long_names() -> None:
    """Check that nothing is over a legend or a label, and that a legend within axes is found."""
    names = [f'left_gripper_finger_{i}_joint_with_a_long_name' for i in range(7)]
    runs = [made_up(7, 50, joint_names=names, law=law) for law in (
        'compensation', 'chattering', 'observer_feedback')]
    tracking = run_figures.tracking(runs[1])
    for i in range(7):
        assert np.array_equal(drawn(panel(tracking, 'rad', i)), runs[1].run.q[:, i])
    assert len(run_figures.torques(runs[1]).axes) == 14
    assert len(run_figures.internals(runs[1]).axes) == 22
    several = [dataclasses.replace(x, experiment=y) for y in ('a', 'b') for x in runs]
    for figure in (tracking, run_figures.error_comparison(several)):
        assert not overlaps(figure)
    tracking.axes[0].legend(loc='upper right')
    assert any('legend' in text for text in overlaps(tracking))


def test_an_empty_run_is_refused_before_anything_is_written(
        chattering: Result, tmp_path: Path) -> None:
    empty = made_up(2, 0)
    for draw in DRAWN:
        with pytest.raises(CtcError, match=r'^friction: chattering: the run has no samples.*$'):
            draw(empty)
    with pytest.raises(CtcError, match='no samples'):
        run_figures.save_figures([chattering, empty], tmp_path / 'new')
    assert not (tmp_path / 'new').exists()


def test_comparison_puts_the_laws_of_an_experiment_together(
        chattering: Result, switch: Result) -> None:
    runs = simulated('compensation', 1.0), chattering
    friction, changed = run_figures.error_comparison([*runs, switch]).axes
    assert [friction.get_title('left'), changed.get_title('left')] == ['friction', 'switch']
    for line, result in enumerate(runs):
        error = np.abs(result.run.q_d - result.run.q).sum(axis=1)
        assert np.array_equal(drawn(friction, line), error)
        assert friction.lines[line].get_color() == LAW_COLOURS[result.law]
        assert friction.lines[line].get_label() == result.law
    assert '→ chattering' in texts(changed)
    assert friction.get_yscale() == 'log' and friction.get_ylim() == changed.get_ylim()
    results = [made_up(1), made_up(1, switching='implicit'), made_up(1, switching='implicit')]
    ax = run_figures.error_comparison(results).axes[0]
    assert [line.get_label() for line in ax.lines] == [
        'chattering', 'chattering (implicit) #1', 'chattering (implicit) #2']
    assert len({line.get_color() for line in ax.lines}) == 3


def test_files_are_svg_with_title_and_caption_and_another_format(tmp_path: Path) -> None:
    """Check it with an error of zero, a single sample, and names with dollars."""
    made = made_up(1, 1, joint_names=['$\\bad$'])
    run = Run(**{**vars(made.run), 'q_d': made.run.q})
    result = Result('$\\frac$', made.configs, run, made.terms)
    files = run_figures.save_figures([result], tmp_path / 'a' / 'b', 'pdf')
    assert [file.path.name.rpartition('_')[2] for file in files] == [
        'tracking.svg', 'torques.svg', 'internals.svg']
    for file in files:
        assert file.path.parent == tmp_path / 'a' / 'b'
        assert ElementTree.parse(file.path).getroot().tag.endswith('svg')
        assert file.path.with_suffix('.pdf').read_bytes().startswith(b'%PDF')
        assert file.title and file.caption.endswith('.')


def test_a_prismatic_joint_has_its_units() -> None:
    """Check metres and newtons, and that they are never added to radians."""
    result = dataclasses.replace(made_up(2, 6000), description=GANTRY)
    figure = run_figures.tracking(result)
    assert np.array_equal(drawn(panel(figure, 'm')), result.run.q[:, 0])
    assert np.array_equal(drawn(panel(figure, 'rad')), result.run.q[:, 1])
    assert [(ax.get_ylabel(), drawn(ax)[0]) for ax in figure.axes if '|e' in ax.get_ylabel()][
        ::2] == [('Σ |eᵢ| [m]', pytest.approx(0.1)), ('Σ |eᵢ| [rad]', pytest.approx(0.1))]
    assert panel(run_figures.torques(result), 'N').get_ylabel() == 'force [N]'
    assert {ax.get_ylabel() for ax in run_figures.internals(result).axes} == {
        'V [J]', 'v [m/s]', 'v [rad/s]', 'z [N]', 'z [N·m]'}
    numbers = result.metrics()
    assert numbers['max_error_norm1_rad'] is None and 'prismatic' in numbers['notes'][0]
    assert (numbers['position_units'], numbers['torque_units']) == (['m', 'rad'], ['N', 'N·m'])


def test_gaps_break_the_lines_and_are_hatched() -> None:
    """Check that no line crosses a gap of 50 samples, and that a single one breaks nothing."""
    whole = made_up(1)
    kept = np.ones(300, bool)
    kept[100:150] = kept[200] = False
    run = Run(*(x[kept] for x in list(vars(whole.run).values())[:-2]))
    terms = dataclasses.replace(whole.terms, **{
        name: x[kept] for name, x in vars(whole.terms).items() if name != 'origin'})
    result = Result('friction', whole.configs, run, terms)
    assert result.missing.sum() == 51
    for draw in DRAWN:
        for ax in draw(result).axes:
            if not ax.get_title('left').startswith('enlarged'):
                t, y = np.asarray(ax.lines[0].get_xdata()), drawn(ax)
                assert t[~np.isfinite(y)].tolist() == [run.t[99]]
                assert len(t) == len(run.t) + 1
                hatched = [x for x in ax.collections if x.get_hatch()]
                assert [path.get_extents().intervalx.tolist() for x in hatched
                        for path in x.get_paths()] == [pytest.approx([run.t[99], run.t[100]])]
    _, _, caption = next(run_figures._figures(result, run_name(result)))
    assert 'hatched' in caption


def plotted(names: list[str]) -> Figure:
    figure, grid = drawing.sheet('Title', 2, (2.0, 1.0), 1.5)
    for k in range(4):
        ax = drawing.panel(figure, grid[k // 2, k % 2], f'panel {k}', 'y [rad]')
        for name in names:
            ax.plot([0.0, 1.0], [0.0, 1.0], label=name)
    return figure


@pytest.mark.parametrize('names', [
    [], ['one'], [f'a law with the settings {k}' for k in range(20)], ['long ' * 60, '$x_{']])
def test_panels_keep_their_size_and_nothing_is_over_the_legend(names: list[str]) -> None:
    figure = plotted(names)

    def sizes() -> list[list[float]]:
        return [(ax.get_position().bounds[2:] * figure.get_size_inches()).tolist()
                for ax in figure.axes]
    before, height = sizes(), figure.get_size_inches()[1]
    drawing.legend_of(*figure.axes)
    assert np.allclose(sizes(), before)
    assert (figure.get_size_inches()[1] > height) == bool(names)
    assert len(figure.legends) == bool(names)
    assert not overlaps(figure)
    assert [len(x.get_texts()) for x in figure.legends] == [len(names)] * bool(names)


def test_a_long_run_is_drawn_by_its_extremes() -> None:
    """Check that each is an actual sample, that no extreme is lost, and that gaps stay gaps."""
    rng = np.random.default_rng(1)
    y = rng.normal(size=200_003)
    y[70_000:70_200], y[123_456], y[3] = np.nan, 50.0, -60.0
    t = np.arange(len(y)) / 1000.0
    t[150_000:] += 1.0
    figure, grid = drawing.sheet('Title', 1, (1.0,), 1.5)
    ax = drawing.panel(figure, grid[0, 0], 'panel', 'y [rad]', t)
    drawing.line(ax, t, y, 1e-3)
    shown_t, shown_y = np.asarray(ax.lines[0].get_xdata()), drawn(ax)
    assert len(shown_t) < 3 * drawing.COLUMNS + 10
    assert (shown_t[0], shown_t[-1]) == (t[0], t[-1])
    width = -(-len(y) // drawing.COLUMNS)
    for begin in range(0, len(y), width):
        part = slice(begin, begin + width)
        if np.isfinite(y[part]).any():
            inside = (shown_t >= t[part][0]) & (shown_t <= t[part][-1])
            assert np.nanmin(shown_y[inside]) == np.nanmin(y[part])
            assert np.nanmax(shown_y[inside]) == np.nanmax(y[part])
    there = np.isfinite(shown_y)
    assert np.array_equal(shown_y[there], y[np.searchsorted(t, shown_t[there])])
    assert ((shown_t >= t[70_000]) & (shown_t < t[70_200]) & ~there).any()
    assert ((shown_t >= t[149_999]) & (shown_t <= t[150_000]) & ~there).any()


def test_terms_of_every_tenth_sample_are_dots_in_the_slice(chattering: Result) -> None:
    """Check that no line claims what the term was between, and that captions say it."""
    terms = dataclasses.replace(chattering.terms, origin=SignalOrigin.RECORDED, **{
        name: x[::10] for name, x in vars(chattering.terms).items() if name != 'origin'})
    result = dataclasses.replace(chattering, law_terms=terms)
    figure = run_figures.internals(result)
    whole, part = panel(figure, 'N·m'), panel(figure, 'N·m', enlarged=True)
    assert np.array_equal(drawn(whole), terms.robust[:, 0])
    assert np.array_equal(np.asarray(whole.lines[0].get_xdata()), terms.t)
    assert (part.lines[0].get_linestyle(), part.lines[0].get_marker()) == ('None', '.')
    captions = [caption for _, _, caption in run_figures._figures(result, run_name(result))]
    assert 'as the controller published them, every 10 ms' in captions[2]
