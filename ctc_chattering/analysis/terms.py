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
Terms of the law, recomputed by the controller itself.

For a bag, `Replay` says whether the law, recomputed over the recorded states, gives the torques
that were recorded.
"""

from __future__ import annotations

from collections.abc import Sequence
import dataclasses
from enum import auto, Enum
from typing import Any, NamedTuple

from ctc_chattering.analysis.signals import SignalOrigin
from ctc_chattering.control.controller import Controller, ControllerConfig
from ctc_chattering.dynamics.model import Model
from ctc_chattering.number_format import format_numbers
from ctc_chattering.numerics.time_grid import NANOSECONDS
from ctc_chattering.simulation.closed_loop import Array, Run
import numpy as np


@dataclasses.dataclass(frozen=True)
class RunTerms:
    """
    Terms of the law at times of their own.

    Attributes
    ----------
    t : ndarray, shape (N,)
        Times [s]: those of the states, or of every Nth that the controller published.
    tau, nominal, compensation, robust : ndarray, shape (N, n)
        Torque, and its parts: tau = nominal - compensation - robust [N·m].
    v : ndarray, shape (N, n)
        Filtered error [rad/s].
    lyapunov : ndarray, shape (N,)
        V of equation (9) [J].
    origin : SignalOrigin
        Source of all of them.

    """

    t: Array
    tau: Array
    nominal: Array
    compensation: Array
    robust: Array
    v: Array
    lyapunov: Array
    origin: SignalOrigin = SignalOrigin.COMPUTED


class ReplayVerdict(Enum):
    """Outcome of recomputing the law over recorded states."""

    EXACT = auto()
    OTHER_TORQUES = auto()
    NOT_ONE_TO_ONE = auto()
    TOO_LONG = auto()


class Replay(NamedTuple):
    """
    Comparison of the recomputed law with recorded torques.

    Attributes
    ----------
    verdict : ReplayVerdict
        Recomputed terms are shown only if it is `ReplayVerdict.EXACT`.
    difference : tuple of float
        RMS difference to the recorded torques, a number a joint [N·m]. It is empty unless the
        verdict is `ReplayVerdict.OTHER_TORQUES`.

    """

    verdict: ReplayVerdict
    difference: tuple[float, ...] = ()

    def __str__(self) -> str:
        """Return the reason for not showing recomputed terms."""
        if self.verdict is ReplayVerdict.OTHER_TORQUES:
            return (
                'the law, recomputed over the recorded states, differs from the torques sent '
                f'by {format_numbers(self.difference)} N·m RMS'
            )
        return {
            ReplayVerdict.EXACT: '',
            ReplayVerdict.NOT_ONE_TO_ONE: 'not every state has one command that answers it',
            ReplayVerdict.TOO_LONG: 'the run is too long to recompute the law',
        }[self.verdict]


def terms(
    run: Run,
    configs: Sequence[tuple[float, ControllerConfig]],
    model: Model | None = None,
    ahead: Array | None = None,
) -> RunTerms:
    """
    Recompute the terms of the law over `run`.

    The controller runs over its states and its reference.

    The terms are those of the run if it received these states and no others, each at once.

    Parameters
    ----------
    run : Run
        Samples, whose `tau` and `v` are not used. Under an input delay the reference is assumed
        to rest after the last sample: as many torques at the end may differ from those sent.
    configs : sequence of (time, ControllerConfig)
        Configurations, each in force from the first sample at or after its time [s].
    model : Model, optional
        Model of the controller. The default is the one that the configurations name.
    ahead : ndarray, shape (N, input_delay, 3, n), optional
        Desired motion during the delay of each sample. The default is that of the samples which
        follow.

    """
    due = sorted(configs, key=lambda item: item[0])
    law = Controller(due[0][1], model)
    delay = law.config.input_delay
    rows = np.stack((run.q, run.dq, run.q_d, run.dq_d, run.ddq_d), axis=1)
    later = np.concatenate((rows, rows[-1:].repeat(delay, axis=0)))[1:, 2:]
    columns: dict[str, Any] = {
        name: np.zeros_like(run.q) for name in ('tau', 'nominal', 'compensation', 'robust', 'v')
    }
    lyapunov = np.zeros_like(run.t)
    for k, t in enumerate(run.t.tolist()):
        while due and t >= due[0][0]:
            law.configure(due.pop(0)[1])
        desired = later[k:k + delay] if ahead is None else ahead[k]
        q, dq, q_d, dq_d, ddq_d = rows[k]
        sample = law.step(q, dq, q_d, dq_d, ddq_d, list(desired), round(NANOSECONDS * t))
        for name, column in columns.items():
            column[k] = getattr(sample, name)
        lyapunov[k] = law.lyapunov(q.tolist(), sample.v)
    return RunTerms(run.t, lyapunov=lyapunov, **columns)
