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
The study: switchings, or laws with recommended settings, over period, gain and imperfections.

A run is a pure function of the case and the variant, so that the numbers depend neither on the
number of processes nor on their order.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
import dataclasses
import itertools
import json
import math
from typing import Any, NamedTuple

from ctc_chattering.analysis.compilation import compile_setups
from ctc_chattering.analysis.markup import fragment, Markup
from ctc_chattering.analysis.tables import bold, csv_text, Table
from ctc_chattering.arguments import whole
from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.loop_setup import Setup
from ctc_chattering.configuration.package_share import config_directory
from ctc_chattering.control.controller_config import LAWS, RIVALS
from ctc_chattering.control.switching import SWITCHINGS
from ctc_chattering.errors import near, ParameterError
from ctc_chattering.runs.pool import in_parallel
from ctc_chattering.runs.recommended import recommended_setup
from ctc_chattering.runs.score import Score, score

#: Groups of cases.
BASIC = 'Basic cases'
PERIOD, GAIN = 'Sample period', 'Gain'
NOISE, SHORT_NOISE = 'Velocity noise', 'Velocity noise, h = 0.5 ms'
#: Gain of the chattering term, unless a case has another [N·m].
KA = 12.0


@dataclasses.dataclass(frozen=True)
class Case:
    """
    One experiment, run under every switching.

    Attributes
    ----------
    name, group : str
        What differs from the other cases of the group; the table that contains it.
    overrides : mapping
        Values by node and parameter above those of the file, as `parameter_file.load` takes
        them.
    file : str
        Parameter file in `config/`, without its ending.
    x : float, optional
        Abscissa in a figure over the group.

    """

    name: str
    group: str
    overrides: Mapping[str, Mapping[str, Any]]
    file: str = 'friction'
    x: float | None = None

    def setup(self) -> Setup:
        """
        Return the checked parameters; the switching is still that of the file.

        A controller knows what the drives give only where the case says so, not from the file.
        """
        controller = {'effort_limit': math.inf, **self.overrides.get('controller', {})}
        return parameter_file.load(config_directory() / f'{self.file}.yaml',
                                   {**self.overrides, 'controller': controller})


def _case(group: str, name: str, x: float | None = None, *, h: float = 1e-3, ka: float = KA,
          plant: Mapping[str, Any] | None = None, controller: Mapping[str, Any] | None = None,
          file: str = 'friction') -> Case:
    return Case(name, group, {
        '/**': {'control_period': h}, 'plant': {'duration': 10.0, **(plant or {})},
        'controller': {'law': 'chattering', 'ka': [ka, ka], **(controller or {})}}, file, x)


def _scaled(factor: float) -> dict[str, float]:
    return {'inertia_scale': factor, 'gravity_scale': factor}


def _both(x: float) -> list[float]:
    return [x, x]


#: Start on the reference.
_ON_TRACK = {'initial_position': [math.pi, 0.5 * math.pi], 'initial_velocity': _both(math.pi)}
#: Imperfections with one value on both joints: group, parameter of the plant, name, values.
_ONE_VALUE = (
    ('Position noise', 'position_noise', 'σ = {:.0e} rad', (1e-5, 1e-4, 1e-3)),
    ('Encoder resolution', 'encoder_resolution', '{:.0e} rad', (1e-5, 1e-4, 1e-3)),
    ('Viscous friction', 'viscous_friction', '{:g} N·m·s/rad', (0.5, 1.0, 2.0)),
    ('Stribeck friction', 'stribeck_friction', '{:g} N·m', (1.0, 2.0, 4.0)),
    ('Load-dependent friction', 'load_friction', '{:g} of the torque', (0.01, 0.02, 0.05)),
    ('Direction-dependent friction', 'friction_asymmetry', '± {:g} Kf', (0.1, 0.2, 0.4)),
    ('Drive lag', 'actuator_lag', '{:g} s', (1e-3, 2e-3, 5e-3)),
    ('Torque resolution', 'torque_resolution', '{:g} N·m', (0.01, 0.1, 1.0)))


def _basic_cases() -> Iterator[Case]:
    delay = {'input_delay': 1}
    yield _case(BASIC, 'clean')
    yield _case(BASIC, '200 Hz', h=5e-3)
    yield _case(BASIC, 'ka = 20', ka=20.0)
    yield _case(BASIC, 'velocity noise 5e-3 rad/s', plant={'velocity_noise': _both(5e-3)})
    yield _case(BASIC, 'model × 0.9', controller=_scaled(0.9))
    yield _case(BASIC, 'delay of 1 sample, predicted', plant=delay, controller=delay)
    yield _case(BASIC, 'delay of 1 sample, not predicted', plant=delay)
    yield _case(BASIC, 'disturbance', file='disturbance')


def _sweeps() -> Iterator[Case]:
    for x in (0.5, 1.0, 2.0, 5.0, 10.0):
        yield _case(PERIOD, f'h = {x:g} ms', x, h=1e-3 * x)
    for x in (10.0, 12.0, 15.0, 20.0, 30.0, 40.0):
        yield _case(GAIN, f'ka = {x:g} N·m', x, ka=x)
    for group, h in ((NOISE, 1e-3), (SHORT_NOISE, 5e-4)):
        for x in (1e-4, 1e-3, 5e-3, 2e-2):
            yield _case(group, f'σ = {x:.0e} rad/s', x, h=h, plant={'velocity_noise': _both(x)})
    for group, name, form, values in _ONE_VALUE:
        for x in values:
            yield _case(group, form.format(x), x, plant={name: _both(x)})
    for kind, counts in (('predicted', (1, 2, 5)), ('not predicted', (1, 2))):
        for n in counts:
            yield _case('Input delay', f'{n} sample{"s" if n > 1 else ""}, {kind}', n,
                        plant={'input_delay': n},
                        controller={'input_delay': n if kind == 'predicted' else 0})
    for x in (0.8, 0.9, 1.1, 1.2):
        yield _case('Model of the controller', f'× {x:g}', x, controller=_scaled(x))


def _drives() -> Iterator[Case]:
    tight, tighter = [300.0, 50.0], [200.0, 30.0]
    for limit, start in ((tight, {}), (tight, _ON_TRACK), (tighter, _ON_TRACK)):
        name = f'{limit[0]:g} / {limit[1]:g} N·m, from {"the reference" if start else "rest"}'
        for more, known in (('', {}), (', known', {'effort_limit': limit})):
            yield _case('Torque saturation', name + more, controller=known,
                        plant={'torque_saturation': limit, **start})
    for rate in ([20_000.0, 4_000.0], [5_000.0, 1_000.0]):
        yield _case('Torque rate limit', f'{rate[0]:g} / {rate[1]:g} N·m/s, from the reference',
                    plant={'torque_rate_limit': rate, **_ON_TRACK})
    for stiffness in (1e5, 1e4):
        for side in ('motor', 'link'):
            yield _case('Elastic joints', f'{stiffness:.0e} N·m/rad, encoder of the {side}',
                        plant={'joint_stiffness': _both(stiffness), 'joint_damping': _both(10.0),
                               'motor_inertia': [1.0, 0.1], 'encoder_side': side})
    for group, name in (('Lost samples', 'sample_loss'), ('Late samples', 'late_samples')):
        for x in (0.01, 0.1):
            yield _case(group, f'{100 * x:g} %', x, plant={name: x})


def _sensors() -> Iterator[Case]:
    for x in (1e-5, 1e-4):
        for sensor, name in (('difference', 'differences'), ('filtered', 'differences, filtered')):
            yield _case('Velocity of encoders', f'{name}, {x:.0e} rad', x, plant={
                'velocity_sensor': sensor, 'encoder_resolution': _both(x)})
    yield _case('Realistic conditions', 'all at once',
                controller={'input_delay': 1, **_scaled(0.9)},
                plant={'actuator_lag': _both(2e-3), 'torque_rate_limit': [5_000.0, 1_000.0],
                       'input_delay': 1, 'velocity_sensor': 'difference',
                       'encoder_resolution': _both(1e-5), **_ON_TRACK})


#: Every case.
CASES = (*_basic_cases(), *_sweeps(), *_drives(), *_sensors())


#: What the tables show: attribute, heading, unit, format.
QUANTITIES = (('rms', 'RMS e', 'rad', '.2e'),
              ('variation', 'torque variation', 'N·m/s', '.0f'))
#: Laws of the study: with the gains of the file, or those that are recommended.
EVERY_LAW = tuple(law for law in LAWS if law not in RIVALS)
#: Title of the table that sums up the others.
RANKING = 'Ranking'


class CaseOutcome(NamedTuple):
    """A case under a switching or law, h [s] and gains [N·m] of it, and its numbers."""

    case: Case
    variant: str
    control_period: float
    ka: tuple[float, ...]
    score: Score


def setup_of(case: Case, variant: str) -> Setup:
    """Return a case under a switching, or under a law with its recommended settings."""
    setup = case.setup()
    if variant in LAWS:
        return recommended_setup(setup, variant)
    return dataclasses.replace(setup, controller=setup.controller.changed({'switching': variant}))


def evaluate(task: tuple[Case, str]) -> CaseOutcome:
    """Run a case under a variant; the numbers are of the second half of the run."""
    setup = setup_of(*task)
    controller, end = setup.controller, setup.plant.duration
    return CaseOutcome(*task, controller.control_period, controller.ka, score(
        setup, (0.5 * end, end), across_gaps=True))


def run_cases(cases: Sequence[Case], variants: Sequence[str], jobs: int = 1
              ) -> Iterator[CaseOutcome]:
    """
    Yield the outcome of every case under every variant.

    Parameters
    ----------
    cases, variants
        What to run; the outcomes are in this order, case by case.
    jobs : int
        Processes; 1 for this one alone.

    Raises
    ------
    CtcError
        If the parameters of a case are not allowed; before anything is run.

    """
    for case in cases:
        case.setup()
    yield from in_parallel(evaluate,
                           list(itertools.product(cases, variants)), jobs)


def rows(outcomes: Sequence[CaseOutcome]) -> list[list[CaseOutcome]]:
    """Return the outcomes case by case."""
    return [list(group) for _, group in itertools.groupby(
        outcomes, lambda outcome: (outcome.case.group, outcome.case.name))]


def engines(outcomes: Sequence[CaseOutcome]) -> str:
    """Return what simulated how many of the runs."""
    counts = Counter(o.score.engine for o in outcomes)
    return 'Runs: ' + ', '.join(f'{name} {n}' for name, n in counts.items())


def to_csv(outcomes: Sequence[CaseOutcome], variant: str = 'switching') -> str:
    """
    Return one line per run, with a header; numbers in full, empty where there is none.

    Parameters
    ----------
    outcomes : sequence of Outcome
        One a line.
    variant : str
        What their variants are.

    """
    return csv_text([{
        'group': o.case.group, 'case': o.case.name, 'x': o.case.x, variant: o.variant,
        'control_period_s': o.control_period, **_pair('ka_{}_nm', o.ka),
        **_pair('rms_error_{}_rad', o.score.rms),
        **_pair('torque_variation_{}_nm_per_s', o.score.variation), 'failure': o.score.failure,
        'file': o.case.file, 'overrides': json.dumps(
            o.case.overrides, ensure_ascii=False, sort_keys=True), 'engine': o.score.engine}
        for o in outcomes])


def _pair(name: str, values: Sequence[float]) -> dict[str, object]:
    return dict(zip(map(name.format, (1, 2)), values or (None, None)))


def about(outcomes: Sequence[CaseOutcome]) -> Markup:
    """Return what the tables show."""
    return fragment(
        'Output of <code>ctc study</code>. True errors and torques sent, joints 1 / 2, over the '
        'second half of each run; h = 1 ms and ka = {{ ka }} N·m unless the row says otherwise; '
        'every other parameter has its default. Bold: the best of a row. {{ engines }}.',
        ka=f'{KA:g}', engines=engines(outcomes))


def tables(outcomes: Sequence[CaseOutcome]) -> Iterator[Table]:
    """Yield the ranking of the switchings, and a table for each group of cases."""
    yield _ranking(rows(outcomes))
    heads = ['case', 'quantity', *dict.fromkeys(o.variant for o in outcomes)]
    for group, members in itertools.groupby(rows(outcomes), lambda row: row[0].case.group):
        yield Table(group, heads, [line for row in members for line in _lines(row)], 2)


def _lines(row: Sequence[CaseOutcome]) -> Iterator[list[str]]:
    """Yield a line of cells for each quantity of one case."""
    for k, (key, quantity, unit, form) in enumerate(QUANTITIES):
        texts = [[format(x, form) for x in getattr(o.score, key)] for o in row]
        columns = list(zip(*filter(None, texts)))
        best = [min(column, key=float) if len(set(column)) > 1 else '' for column in columns]
        cells = [Markup(' / ').join(bold(x) if x == y else x for x, y in zip(text, best))
                 or 'diverged' for text in texts]
        yield ['' if k else row[0].case.name, f'{quantity} [{unit}]', *cells]


def _ranking(table: Sequence[Sequence[CaseOutcome]]) -> Table:
    """Return how often each switching is best and worst."""
    counts = Counter(('runs that diverged', o.variant) for row in table for o in row
                     if o.score.failure)
    for row, (key, quantity, _, _), joint in itertools.product(table, QUANTITIES, (0, 1)):
        ranked = sorted(row, key=lambda o: (getattr(o.score, key) or (math.inf, math.inf))[joint])
        counts[f'smallest {quantity}', ranked[0].variant] += 1
        counts[f'largest {quantity}', ranked[-1].variant] += 1
    heads = [*(f'{extreme} {quantity}' for extreme in ('smallest', 'largest')
               for _, quantity, _, _ in QUANTITIES), 'runs that diverged']
    return Table(
        RANKING, ['switching', *heads],
        [[o.variant, *(str(counts[head, o.variant]) for head in heads)] for o in table[0]],
        note=f'{2 * len(table)} comparisons: {len(table)} cases with two joints each.')


BASE = 'compensation'


def ratio(outcome: CaseOutcome, base: CaseOutcome) -> float:
    """Return the RMS error over that of `base`, of the joint where it is larger; inf: diverged."""
    if outcome.score.failure or base.score.failure:
        return math.inf
    return max(mine / theirs for mine, theirs in zip(outcome.score.rms, base.score.rms))


def law_about(outcomes: Sequence[CaseOutcome]) -> Markup:
    """Return what the table shows."""
    return fragment(
        'Output of <code>ctc study --laws</code>: RMS error of each law with its recommended '
        'settings, over that of <code>{{ base }}</code> with the gains of the paper; of the two '
        'joints the larger ratio. True errors, the second half of each run. Delay, lag and rate '
        'limit of the drives are given where a law takes them, unless the case says otherwise; '
        'Coulomb friction is given to <code>slotine_li</code> and '
        '<code>friction_feedforward</code>. Bold: worse than <code>{{ base }}</code> by more than '
        '1 %; inf: diverged. {{ engines }}.', base=BASE, engines=engines(outcomes))


def law_tables(outcomes: Sequence[CaseOutcome]) -> Iterator[Table]:
    """Yield the table of ratios; a law that is worse than `compensation` in a case is bold."""
    table = [{o.variant: o for o in row} for row in rows(outcomes)]
    laws = [law for law in table[0] if law != BASE]
    lines = []
    for row in table:
        case, base = row[BASE].case, row[BASE]
        cells = [ratio(row[law], base) for law in laws]
        lines.append([f'{case.group}: {case.name}', *(
            bold(f'{x:.2g}') if x > 1.01 else f'{x:.2g}' for x in cells)])
    yield Table('', ['case', *laws], lines)


def study(laws: bool = False, groups: Sequence[str] = (), jobs: int = 1,
          show: Callable[[str], None] = print,
          progress: Callable[[int, int], None] | None = None) -> list[CaseOutcome]:
    """
    Run the paper's arm under every switching over sample periods, gains and imperfections.

    Parameters
    ----------
    laws : bool
        Every law, with recommended settings, in place of every switching.
    groups : sequence of str
        Cases to run, such as ``Drive lag`` or ``Encoder resolution``; empty for all, minutes.
    jobs : int
        Processes; with more than 1 a script needs ``if __name__ == '__main__'``.
    show : callable
        Takes lines about what is compiled.
    progress : callable, optional
        Called with the number of outcomes that are there, and of all.

    Returns
    -------
    list of CaseOutcome
        One a case and switching or law, each with ``case``, ``variant`` and ``score``; for
        `write_study`.

    Raises
    ------
    CtcError
        If an argument is not allowed, before anything is run.

    """
    known = list(dict.fromkeys(case.group for case in CASES))
    for name in groups:
        if name not in known:
            raise ParameterError('groups', name, ' | '.join(known) + near(name, known))
    jobs, variants = whole('jobs', jobs, 1), EVERY_LAW if laws else SWITCHINGS
    chosen = [case for case in CASES if case.group in (groups or known)]
    compile_setups((setup_of(case, x) for case in chosen for x in variants), show)
    found: list[CaseOutcome] = []
    for outcome in run_cases(chosen, variants, jobs):
        found.append(outcome)
        if progress is not None:
            progress(len(found), len(chosen) * len(variants))
    return found
