"""Every term of the law over a recorded run, recomputed by the controller itself."""

from __future__ import annotations

from array import array
from collections.abc import Mapping, Sequence
import dataclasses
from typing import Any

import numpy as np

from ctc_chattering.control.controller import Controller, ControllerConfig
from ctc_chattering.dynamics.model import Model
from ctc_chattering.numerics.gaps import missing
from ctc_chattering.simulation.closed_loop import Array, Run

#: Missing samples at a stretch that are interpolated.
BRIDGED = 20


@dataclasses.dataclass(frozen=True)
class Terms:
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
          unsent: bool = False) -> Terms:
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

    """
    due = sorted(configs, key=lambda item: item[0])
    law = Controller(due[0][1], model)
    n = len(law.config.joint_names)
    columns = [array('d') for _ in range(5)]
    lyapunov = array('d')
    samples = list(zip(run.t.tolist(), *(
        x.tolist() for x in (run.q, run.dq, run.q_d, run.dq_d, run.ddq_d))))
    delay = law.config.input_delay
    lacking = [0, *missing(run.t, law.config.control_period).tolist()]
    doubtful = False
    for k, (t, q, dq, q_d, dq_d, ddq_d) in enumerate(samples):
        if lacking[k] and not unsent:
            _bridge(law, samples[k - 1], samples[k], lacking[k])
            doubtful = True
        while due and t >= due[0][0]:
            law.configure(due.pop(0)[1])
        if doubtful and known and t in known:
            law.filter.state = np.array(known[t]) + law.config.b * np.subtract(dq_d, dq)
            doubtful = False
        ahead = [samples[min(k + j, len(samples) - 1)][3:] for j in range(1, delay + 1)]
        s = law.step(q, dq, q_d, dq_d, ddq_d, ahead)
        for column, row in zip(
                columns, (s.tau, s.nominal, s.compensation, s.robust, s.v)):
            column.extend(row)
        lyapunov.append(law.lyapunov(q, s.v))
    tau, nominal, compensation, robust, v = (np.array(c).reshape(-1, n) for c in columns)
    return Terms(tau, nominal, compensation, robust, v, np.array(lyapunov))


def _bridge(law: Controller, before: Any, after: Any, count: int) -> None:
    """Take `law` over `count` missing samples between two (t, q, dq, q_d, dq_d, ddq_d)."""
    if count > BRIDGED:
        law.reset(bumpless=True)
        return
    for j in range(1, count + 1):
        share = j / (count + 1)
        q, dq, q_d, dq_d, ddq_d = (
            [a + share * (b - a) for a, b in zip(x, y)] for x, y in zip(before[1:], after[1:]))
        law.step(q, dq, q_d, dq_d, ddq_d, [after[3:]] * law.config.input_delay)
