"""What `ctc excite` takes and prints."""

from __future__ import annotations

import argparse
from math import inf
from typing import Any

import numpy as np

from ctc_chattering.cli.table import print_columns
from ctc_chattering.errors import ParameterError
from ctc_chattering.experiment.parameter_file import Setup
from ctc_chattering.identification.excitation import ExcitationConfig
from ctc_chattering.identification.excitation_forecast import STICKING
from ctc_chattering.identification.excitation_run import Plan, request_of
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.parameters import Parameter

#: Options that are parameters of the motion.
_SCALARS = ('duration', 'poses', 'velocity_scale')
_LISTS = ('center', 'position_range', 'velocity_limit', 'acceleration_limit')


def config_of(options: argparse.Namespace, setup: Setup) -> ExcitationConfig:
    """Return what the options ask for; `ParameterError` for what is not allowed."""
    n = len(setup.controller.joint_names)
    values: dict[str, Any] = {name: getattr(options, name) for name in _SCALARS}
    for name in _LISTS:
        text = getattr(options, name)
        if text is not None:
            values[name] = _per_joint(name, text, n)
    return request_of(setup, values)


def friction_of(options: argparse.Namespace, n: int) -> Array | None:
    """Return the friction that an option gives, shape (n,) [N·m]; None without it."""
    if options.friction is None:
        return None
    values = _per_joint('friction', options.friction, n)
    Parameter('friction', 'float[]', None, '', minimum=0.0, shape='n').check(values, n)
    return np.array(values)


def _per_joint(name: str, text: str, n: int) -> tuple[float, ...]:
    """Return the numbers of an option; one stands for all joints."""
    try:
        values = tuple(float(word) for word in text.split(','))
    except ValueError:
        raise ParameterError(name, text, f'a number, or {n} numbers A,B,C') from None
    return values * n if len(values) == 1 else values


def show(found: Plan) -> None:
    """Print what the motion reaches of what it may, and what is foretold of it."""
    motion, bounds = found.motion, found.bounds
    rows = [('joint', 'position', 'velocity', 'of', 'acceleration', 'of', 'torque', 'of',
             'condition', 'scaled', 'sticks')]
    for i, joint in enumerate(found.limits):
        q = motion.q[:, i]
        peaks = zip((*(np.abs(x[:, i]).max() for x in (motion.dq, motion.ddq, motion.tau)),),
                    (bounds.velocity[i], bounds.acceleration[i], found.effort[i]))
        rows.append((  # type: ignore[arg-type]
            joint.name, f'{q.min():.2f} to {q.max():.2f}',
            *(f'{x:.3g}' for pair in peaks for x in pair),
            *(f'{x:.1f}' for x in found.conditions[i]), f'{found.hold[i]:.2f}'))
    print_columns(rows)
    (first, _), (_, last) = found.excitation.slow[0], found.excitation.slow[-1]
    begin, end = found.excitation.fourier
    print(f'slow reversals at {len(found.excitation.slow)} poses from {first:.1f} to {last:.1f} s, '
          f'Fourier series from {begin:.1f} to {end:.1f} s; units of rad (m), s, N·m (N)')
    print('condition: condition number of the regression of friction, offset and errors of '
          'inertia and gravity; sticks: distance from the motion within which the expected '
          f'friction holds the joint, with kp {_listed(found.kp)}')
    _warn(found)


def _warn(found: Plan) -> None:
    """Print which limits are assumed, and which joints friction holds in the reversals."""
    for quantity in ('velocity', 'acceleration'):
        names = [joint.name for joint in found.limits if getattr(joint, quantity)[1] == inf]
        if names:
            print(f'no {quantity} limit in the description, the one above is assumed: '
                  + ', '.join(names))
    for joint, hold, slow in zip(found.limits, found.hold, found.bounds.slow):
        if hold > 1.05 * STICKING * slow:
            print(f'warning: friction holds {joint.name} within {hold:.2f} {joint.unit} of the '
                  f'motion, and its slow reversals are ±{slow:.2f}: raise kp, or position_range')


def _listed(values: Array) -> str:
    return '[' + ', '.join(f'{x:g}' for x in values) + ']'
