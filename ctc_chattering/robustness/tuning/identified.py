"""What `ctc identify` leaves uncertain: friction within its intervals, delay, lag, and masses."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
import dataclasses
import json
from pathlib import Path
from typing import Any

from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.parameter_file import Setup
from ctc_chattering.errors import CtcError
from ctc_chattering.parameters import Parameter
from ctc_chattering.robustness.quantity import read_uncertain, Uncertain
from ctc_chattering.robustness.tuning.spec import parse_tune, TuneSpec
from ctc_chattering.simulation.plant_config import PlantConfig

#: Names in the directory that `ctc identify` writes.
VALUES, NUMBERS = 'identified.yaml', 'identify.json'
#: Part of M, C and G that may be wrong in any case.
_MODEL = 0.05


@dataclasses.dataclass(frozen=True)
class PossibleDelays(Uncertain):
    """
    Delays with the lags that explain the recording as well: the number is that of the delay.

    Attributes
    ----------
    lags : mapping of float to tuple of float, shape (n,)
        By delay [s].

    """

    lags: Mapping[float, tuple[float, ...]]

    def value(self, spec: Parameter, x: float, _now: Any, _n: int) -> Any:
        """Return the delay, or the lag of each joint."""
        return int(x) if spec.name == 'input_delay' else self.lags[x]


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
    spec = parse_tune({'params_file': VALUES, **tree}, directory / VALUES, uncertain)
    return dataclasses.replace(spec, notes=notes)


def _friction(found: Mapping[str, Any]) -> Iterator[Uncertain]:
    """Yield factors of friction: for all joints, the widest interval of any."""
    for name in ('coulomb', 'viscous'):
        part = max((_half(x[name]) / x[name]['value'] for x in found['friction']
                    if (x[name]['value'] or 0.0) > 0.0), default=0.0)
        if part > 0.0:
            yield _factor(name, f'plant.{name}_friction', part)


def _drives(found: Mapping[str, Any]) -> Iterator[Uncertain]:
    """Yield delays and lags: each pair that is possible, or two standard errors of the lags."""
    pairs = {float(x['delay_samples']): tuple(map(float, x['actuator_lag_s']))
             for x in found['delays_possible']}
    if len(pairs) > 1:
        parameters = PlantConfig.parameters()
        targets = tuple(('plant', parameters[x]) for x in ('input_delay', 'actuator_lag'))
        yield PossibleDelays('delay', targets, False, 'choice', tuple(sorted(pairs)), pairs)
        return
    both = [(lag, 2.0 * error) for lag, error in zip(
        found['actuator_lag_s'], found['actuator_lag_error_s']) if error]
    if any(lag for lag, _ in both):
        yield _factor('lag', 'plant.actuator_lag',
                      min(1.0, max(error / lag for lag, error in both if lag)))
    elif both:
        yield read_uncertain('lag', {'parameter': 'plant.actuator_lag',
                                     'uniform': [0.0, max(error for _, error in both)]})


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
