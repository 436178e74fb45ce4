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

"""Every term of the law over the states of a run, recomputed by the controller itself."""

from __future__ import annotations

from collections.abc import Sequence
import dataclasses
from typing import Any

from ctc_chattering.analysis.signals import SignalOrigin
from ctc_chattering.control.controller import Controller, ControllerConfig
from ctc_chattering.dynamics.model import Model
from ctc_chattering.numerics.time_grid import NANOSECONDS
from ctc_chattering.simulation.closed_loop import Array, Run
import numpy as np


@dataclasses.dataclass(frozen=True)
class RunTerms:
    """
    Terms of the law, sample by sample, at times of their own.

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
        Whether they are recorded or computed.

    """

    t: Array
    tau: Array
    nominal: Array
    compensation: Array
    robust: Array
    v: Array
    lyapunov: Array
    origin: SignalOrigin = SignalOrigin.COMPUTED


def terms(run: Run, configs: Sequence[tuple[float, ControllerConfig]],
          model: Model | None = None, ahead: Array | None = None) -> RunTerms:
    """
    Run the controller over the states and the reference of `run`.

    That is what it did if it has received these states and no others, at once.

    Parameters
    ----------
    run : Run
        Its `tau` and `v` are not used. Under an input delay the reference is taken to rest after
        the last sample, so that as many torques at the end may differ from those sent.
    configs : sequence of (time, ControllerConfig)
        Configurations, each in force from the first sample at or after its time [s].
    model : Model, optional
        In place of the one that the configurations name.
    ahead : ndarray, shape (N, input_delay, 3, n), optional
        What is desired at the samples of the delay; by default at the samples of the run that
        follow.

    """
    due = sorted(configs, key=lambda item: item[0])
    law = Controller(due[0][1], model)
    delay = law.config.input_delay
    rows = np.stack((run.q, run.dq, run.q_d, run.dq_d, run.ddq_d), axis=1)
    points: Any = np.concatenate((rows, rows[-1:].repeat(delay, axis=0)))[:, 2:]
    columns: dict[str, Any] = {name: np.zeros_like(run.q) for name in (
        'tau', 'nominal', 'compensation', 'robust', 'v')}
    lyapunov = np.zeros_like(run.t)
    for k, t in enumerate(run.t.tolist()):
        while due and t >= due[0][0]:
            law.configure(due.pop(0)[1])
        q, dq, q_d, dq_d, ddq_d = rows[k]
        sample = law.step(q, dq, q_d, dq_d, ddq_d,
                          points[k + 1:k + 1 + delay] if ahead is None else list(ahead[k]),
                          round(NANOSECONDS * t))
        for name, column in columns.items():
            column[k] = getattr(sample, name)
        lyapunov[k] = law.lyapunov(q.tolist(), sample.v)
    return RunTerms(run.t, lyapunov=lyapunov, **columns)
