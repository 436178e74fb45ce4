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

"""Every term of the law over a recorded run, recomputed by the controller itself."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import dataclasses
from typing import Any

from ctc_chattering.control.controller import Controller, ControllerConfig
from ctc_chattering.dynamics.model import Model
from ctc_chattering.numerics.time_grid import missing, NANOSECONDS
from ctc_chattering.simulation.closed_loop import Array, Run
import numpy as np

#: Missing samples at a stretch that are interpolated.
BRIDGED = 20


@dataclasses.dataclass(frozen=True)
class RunTerms:
    """
    Terms of the law sample by sample.

    Attributes
    ----------
    tau, nominal, compensation, robust : ndarray, shape (N, n)
        Torque, and its parts: tau = nominal - compensation - robust [N·m].
    v : ndarray, shape (N, n)
        Filtered error [rad/s].
    lyapunov : ndarray, shape (N,)
        V of equation (9) [J].

    """

    tau: Array
    nominal: Array
    compensation: Array
    robust: Array
    v: Array
    lyapunov: Array


def terms(run: Run, configs: Sequence[tuple[float, ControllerConfig]],
          model: Model | None = None, known: Mapping[float, Sequence[float]] | None = None,
          unsent: bool = False, ahead: Sequence[Any] | None = None) -> RunTerms:
    """
    Run the controller over the states and the reference of `run`.

    Where samples are missing, the controller runs over straight lines between the neighbours, up
    to `BRIDGED` of them; over more it begins again with v = 0, as it does itself without states.

    Parameters
    ----------
    run : Run
        Its `tau` and `v` are not used. Under an input delay the reference is taken to rest after
        the last sample, so that as many torques at the end may differ from those sent.
    configs : sequence of (time, ControllerConfig)
        Configurations, each in force from the first sample at or after its time [s].
    model : Model, optional
        In place of the one that the configurations name.
    known : mapping of float to sequence of float, shape (n,), optional
        By times of samples [s], v as the controller published it [rad/s]: after missing samples
        it is taken from here.
    unsent : bool
        Missing samples were never sent: the controller has not stepped there.
    ahead : sequence, shape (N, input_delay, 3, n), optional
        What is desired at the samples of the delay; by default at the samples of the run that
        follow.

    """
    due = sorted(configs, key=lambda item: item[0])
    law = Controller(due[0][1], model)
    delay = law.config.input_delay
    rows = np.stack((run.q, run.dq, run.q_d, run.dq_d, run.ddq_d), axis=1)
    points: Any = np.concatenate((rows, rows[-1:].repeat(delay, axis=0)))[:, 2:]
    gaps = [0, *missing(run.t, law.config.control_period)]
    columns = {name: np.zeros_like(run.q) for name in (
        'tau', 'nominal', 'compensation', 'robust', 'v')}
    lyapunov = np.zeros_like(run.t)
    doubtful = False
    for k, t in enumerate(run.t.tolist()):
        if gaps[k] and not unsent:
            _bridge(law, rows[k - 1], rows[k], gaps[k], run.t[k - 1:k + 1])
            doubtful = True
        while due and t >= due[0][0]:
            law.configure(due.pop(0)[1])
        q, dq, q_d, dq_d, ddq_d = rows[k]
        if doubtful and known and t in known:
            law.memories = law.memories._replace(control=law.memories.control._replace(
                xi=np.array(known[t]) + law.config.b * (dq_d - dq)))
            doubtful = False
        sample = law.step(q, dq, q_d, dq_d, ddq_d,
                          points[k + 1:k + 1 + delay] if ahead is None else ahead[k],
                          round(NANOSECONDS * t))
        for name, column in columns.items():
            column[k] = getattr(sample, name)
        lyapunov[k] = law.lyapunov(q.tolist(), sample.v)
    return RunTerms(**columns, lyapunov=lyapunov)


def _bridge(law: Controller, before: Array, after: Array, count: int, t: Array) -> None:
    """Take `law` over `count` missing samples between two rows (q, dq, q_d, dq_d, ddq_d) at t."""
    if count > BRIDGED:
        law.reset(bumpless=True)
        return
    ahead: Any = [after[2:]] * law.config.input_delay
    for share in np.arange(1, count + 1) / (count + 1):
        q, dq, q_d, dq_d, ddq_d = before + share * (after - before)
        law.step(q, dq, q_d, dq_d, ddq_d, ahead,
                 round(NANOSECONDS * float(t[0] + share * (t[1] - t[0]))))
