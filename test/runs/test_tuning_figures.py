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

"""Figures of a search for gains: what is drawn is what was found."""

from __future__ import annotations

import dataclasses

from ctc_chattering.runs.tune_page import draws_figure, front_figure, gains_figure
from figure_layout import overlaps
from matplotlib.axes import Axes
import numpy as np
import pytest
from tunings import short_tuning


def drawn(ax: Axes, label: str) -> list[tuple[float, float]]:
    """Return the places of the line with a label that begins so."""
    (line,) = [x for x in ax.lines if str(x.get_label()).startswith(label)]
    return [(float(x), float(y)) for x, y in zip(
        np.asarray(line.get_xdata()), np.asarray(line.get_ydata()))]


def test_the_front_is_drawn_on_both_kinds_of_draws() -> None:
    tuning = short_tuning()
    (ax,) = front_figure(tuning).axes
    for label, scores in (('front', [x.drawn for x in tuning.points]),
                          ('the same on fresh draws', [x.fresh for x in tuning.points])):
        assert drawn(ax, label) == [(x.variation, x.error) for x in scores]
    assert tuning.best is not None
    best = tuning.best.fresh
    assert drawn(ax, 'recommended point') == [(best.variation, best.error)]
    for x in tuning.others:
        assert drawn(ax, x.name) == [(x.fresh.variation, x.fresh.error)]
    low, high = ax.get_ylim()
    assert all(low < x.fresh.error < high for x in (*tuning.points, *tuning.others))


def test_trials_beyond_a_limit_are_marked() -> None:
    tuning = short_tuning(torque_limit=1.0)
    (ax,) = front_figure(tuning).axes
    assert len(drawn(ax, 'beyond the limit of the torque (12)')) == 12
    assert not [x for x in ax.lines if str(x.get_label()).startswith('front')]
    assert '(violates: torque)' in str([x.get_label() for x in ax.lines])


def test_each_number_is_drawn_along_the_front_within_its_range() -> None:
    tuning = short_tuning()
    axes = gains_figure(tuning).axes
    assert [ax.get_title('left').partition(',')[0] for ax in axes] == list(tuning.spec.ranges)
    for ax, (name, limits) in zip(axes, tuning.spec.ranges.items()):
        places = np.asarray(ax.lines[0].get_ydata())
        assert places == pytest.approx([tuning.trials[k].numbers[name] for k in tuning.front])
        low, high = ax.get_ylim()
        assert low < limits.low < limits.high < high


def test_errors_are_drawn_over_what_is_uncertain() -> None:
    tuning = short_tuning()
    (ax,) = draws_figure(tuning).axes
    assert tuning.best is not None
    assert drawn(ax, 'recommended point') == [
        (x, run.error) for (x,), run in zip(tuning.fresh.draws, tuning.best.fresh.runs)]
    assert len(drawn(ax, 'gains of the file')) == 8


def test_nothing_is_over_a_legend_or_a_label() -> None:
    """Check names of gains and of what is uncertain that are long, and no front."""
    tuning = short_tuning()
    (quantity,) = tuning.spec.uncertain
    long = dataclasses.replace(tuning, others=tuple(
        x._replace(name=f'{x.name}, with settings of its own') for x in tuning.others),
        spec=dataclasses.replace(tuning.spec, uncertain=(
            dataclasses.replace(quantity, name='a_rather_long_name_' * 5),)))
    for draw in (front_figure, gains_figure, draws_figure):
        assert not overlaps(draw(long))
    assert not overlaps(front_figure(short_tuning(torque_limit=1.0)))
