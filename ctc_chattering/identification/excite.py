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


"""From a robot's parameters to a motion that excites it, and the files that play it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from numbers import Real
from pathlib import Path
from typing import Any

from ctc_chattering.analysis.output import prepare
from ctc_chattering.arguments import checked, vector, whole
from ctc_chattering.configuration.loop_setup import Setup, Values
from ctc_chattering.errors import ParameterError
from ctc_chattering.identification.excitation.link_shapes import allowed_pairs
from ctc_chattering.identification.excitation.plan import (
    MOTION,
    Plan,
    plan,
    request_of,
    RUN,
    write,
)
import numpy as np


@checked(setup=Setup, request=(Mapping, type(None)), friction=(Sequence, type(None)), srdf=str,
         floor=(Real, type(None)))
def excite(setup: Setup, request: Mapping[str, Any] | None = None,
           friction: Sequence[float] | None = None, evaluations: int = 1000, seed: int = 0,
           srdf: str = '', floor: float | None = None) -> Plan:
    """
    Return a motion that shows the friction of every joint within the robot's limits.

    Parameters
    ----------
    setup : Setup
        Model, limits, gains and friction of the robot.
    request : mapping, optional
        What is asked of the motion: ``duration`` [s], ``poses``, ``center`` [rad],
        ``position_range`` [rad], ``velocity_limit`` [rad/s], ``acceleration_limit`` [rad/s²],
        ``velocity_scale``, ``clearance`` [m].
    friction : sequence of float, length n, optional
        Coulomb friction to expect, in place of the plant's [N·m].
    evaluations, seed : int
        Motions to evaluate in the search, and the seed of those from which it begins.
    srdf : str
        Text of an SRDF: links that it allows to touch are not checked for collisions.
    floor : float, optional
        Height of a floor in the frame of the root link [m].

    Returns
    -------
    Plan
        The motion with its peaks, condition number and distances; for `write_excitation`.

    Raises
    ------
    CtcError
        If an argument is not allowed, there is no model, or the limits cannot be kept.

    """
    evaluations, seed = whole('evaluations', evaluations, 1), whole('seed', seed, 0)
    config = request_of(setup, dict(request or {}))
    coulomb = None
    if friction is not None:
        coulomb = vector('friction', friction, len(config.joint_names))
        if not (coulomb >= 0.0).all() or not np.isfinite(coulomb).all():
            raise ParameterError('friction', friction, 'finite numbers >= 0')
    allowed = allowed_pairs(srdf) if srdf else ()
    return plan(setup, config, coulomb, evaluations, seed, allowed, floor)


@checked(found=Plan, setup=Setup, out=(str, Path))
def write_excitation(found: Plan, setup: Setup, out: str | Path) -> None:
    """
    Write a motion, and a parameter file that plays it.

    Parameters
    ----------
    found : Plan
        What `excite` has found.
    setup : Setup
        The robot for which it has.
    out : str or Path
        Directory for ``motion.yaml``, the waypoints, and ``run.yaml``, the robot's parameters
        with this motion under law compensation.

    Raises
    ------
    CtcError
        If a file exists already, or cannot be written.

    """
    sections: dict[str, Values] = {node: {
        **setup.values.get(node, {}), **config.as_mapping()} for node, config in (
            ('plant', setup.plant), ('controller', setup.controller),
            ('reference', setup.reference))}
    write(found, sections, prepare(Path(out), (MOTION, RUN)))
