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

"""What `ctc identify` leaves uncertain: friction within its intervals, delay, lag, and masses."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
import dataclasses
import json
from math import inf
from pathlib import Path
from typing import Any

from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.loop_setup import Setup
from ctc_chattering.errors import CtcError
from ctc_chattering.parameters import Parameter
from ctc_chattering.robustness.quantity import read_uncertain, Uncertain
from ctc_chattering.robustness.tuning.spec import parse_tune, TuneSpec
from ctc_chattering.simulation.plant_config import PlantConfig

#: Names in the directory that `ctc identify` writes.
VALUES, NUMBERS = 'identified.yaml', 'identify.json'
#: Part of M, C and G that may be wrong in any case.
_MODEL = 0.05
#: Nearly 1, the end of the interval of a lag.
_LAST = 1.0 - 1e-9


@dataclasses.dataclass(frozen=True)
class PossibleDrives(Uncertain):
    """
    Delays with the lags that explain the recording as well, all as likely as each other.

    From the number k + u the delay is the k-th one, and each lag is by the part u of its interval
    above the lower end.

    Attributes
    ----------
    drives : tuple of (int, tuple of (float, float))
        Delays, each with the interval of the lag of each joint [s].

    """

    drives: tuple[tuple[int, tuple[tuple[float, float], ...]], ...]

    @property
    def unit(self) -> str:
        """Return no unit: the number is a place in all of these."""
        return ''

    @property
    def text(self) -> str:
        """Return delays and lags in words."""
        return 'drives: ' + ' or '.join(
            f'delay {delay} with lags '
            f'{", ".join(f"{1e3 * low:.2g} to {1e3 * high:.2g}" for low, high in lags)} ms'
            for delay, lags in self.drives)

    @property
    def typical(self) -> tuple[float, ...]:
        """Return numbers of each delay with its shortest and its longest lags."""
        return tuple(k + u for k in range(len(self.drives)) for u in (0.0, _LAST))

    def value(self, spec: Parameter, x: float, _now: Any, _n: int) -> Any:
        """Return the delay, or the lag of each joint."""
        k = min(int(x), len(self.drives) - 1)
        delay, lags = self.drives[k]
        if spec.name == 'input_delay':
            return delay
        return tuple(low + (x - k) * (high - low) for low, high in lags)


def identified_spec(directory: Path, tree: Mapping[str, Any]) -> TuneSpec:
    """
    Return what is tuned, from what `ctc identify` has written.

    Parameters
    ----------
    directory : Path
        With `identified.yaml` and `identify.json`.
    tree : mapping
        Further keys of the spec.

    Raises
    ------
    CtcError
        If a file cannot be read, or is none of `ctc identify`.

    """
    path = directory / NUMBERS
    setup = parameter_file.load(directory / VALUES)
    try:
        found = json.loads(path.read_text(encoding='utf-8'))
        uncertain = (*_friction(found), *_drives(found), *_model(found, setup))
        notes = tuple(_notes(found, setup))
    except OSError as error:
        raise CtcError(f'{path}: {error.strerror or error}') from None
    except (ValueError, KeyError, TypeError, AttributeError, IndexError):
        raise CtcError(f'{path}: not a file of ctc identify') from None
    # The rate in the file is what the recommended law makes do with, no limit of the drives.
    rate = setup.plant.torque_rate_limit
    section = {'torque_rate_limit': list(rate) if rate else inf, **(tree.get('tune') or {})}
    spec = parse_tune({'params_file': VALUES, **tree, 'tune': section}, directory / VALUES,
                      uncertain)
    return dataclasses.replace(spec, notes=notes)


def _friction(found: Mapping[str, Any]) -> Iterator[Uncertain]:
    """Yield factors of friction: for all joints, the widest interval of any."""
    for name in ('coulomb', 'viscous'):
        part = max((_half(x[name]) / x[name]['value'] for x in found['friction']
                    if (x[name]['value'] or 0.0) > 0.0), default=0.0)
        if part > 0.0:
            yield _factor(name, f'plant.{name}_friction', part)


def _drives(found: Mapping[str, Any]) -> Iterator[Uncertain]:
    """Yield each delay that is possible, with the intervals of its lags."""
    drives = tuple((int(x['delay_samples']), tuple(
        (max(0.0, float(low)), float(high)) for low, high in x['actuator_lag_interval_95_s']))
        for x in found['delays_possible'])
    if any(high > low for _, lags in drives for low, high in lags) or len(drives) > 1:
        parameters = PlantConfig.parameters()
        targets = tuple(('plant', parameters[x]) for x in ('input_delay', 'actuator_lag'))
        yield PossibleDrives('delay and lag', targets, False, 'uniform',
                             (0.0, float(len(drives))), drives)


def _model(found: Mapping[str, Any], setup: Setup) -> Iterator[Uncertain]:
    """Yield a scale of the controller's model, and the payload that it lacks."""
    known = [x for x in found['model_errors'] if x['value'] is not None]
    part = max([_MODEL, *(abs(x['value']) + _half(x) for x in known if not x['unit'])])
    yield read_uncertain('model', {
        'parameters': ['controller.inertia_scale', 'controller.gravity_scale'],
        'uniform': [1.0 - min(part, 0.9), 1.0 + part]})
    for x in known:
        if x['unit'] and _drawn(x, setup):
            yield read_uncertain('payload', {'parameter': 'plant.payload', 'uniform': [
                max(0.0, x['value'] - _half(x)), x['value'] + _half(x)]})


def _notes(found: Mapping[str, Any], setup: Setup) -> Iterator[str]:
    """Yield what is not known, and not drawn."""
    if found['delay_samples'] is None and len(found['delays_possible']) < 2:
        yield f'the delay is not known, and {setup.plant.input_delay} in {VALUES}'
    for x in found['model_errors']:
        if x['value'] is not None and x['unit'] and not _drawn(x, setup):
            yield f'{x["name"]} of {x["value"]:.3g} {x["unit"]} is not drawn'


def _drawn(error: Mapping[str, Any], setup: Setup) -> bool:
    """Return whether the plant can have a payload."""
    return bool(setup.plant.described and error['value'] > 0.0 and _half(error) > 0.0)


def _factor(name: str, parameter: str, part: float) -> Uncertain:
    return read_uncertain(name, {'parameter': parameter, 'factor': True,
                                 'uniform': [max(0.0, 1.0 - part), 1.0 + part]})


def _half(number: Mapping[str, Any]) -> float:
    """Return half the interval of a number; 0 without one."""
    low, high = number.get('interval_95') or (0.0, 0.0)
    return 0.5 * float(high - low)
