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

"""The cases of the study: sample period, gain, and the imperfections of a real loop."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
import dataclasses
import math
from typing import Any

from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.loop_setup import Setup
from ctc_chattering.configuration.package_share import config_directory

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
