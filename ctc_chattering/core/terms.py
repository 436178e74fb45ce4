"""Every term of the law over a recorded run, computed anew by the controller itself."""

from __future__ import annotations

from array import array
from collections.abc import Sequence
import dataclasses

import numpy as np

from ctc_chattering.core.controller import Controller, ControllerConfig
from ctc_chattering.core.model import Model
from ctc_chattering.core.simulation import Array, Run


@dataclasses.dataclass(frozen=True)
class Terms:
    """
    Terms of the laws (2) and (6) sample by sample.

    Attributes
    ----------
    tau, inverse_dynamics, compensation, chattering : ndarray, shape (N, n)
        Torque, and its parts: tau = inverse_dynamics - compensation - chattering [N·m].
    v : ndarray, shape (N, n)
        Filtered error [rad/s].
    lyapunov : ndarray, shape (N,)
        V of equation (9) [J].

    """

    tau: Array
    inverse_dynamics: Array
    compensation: Array
    chattering: Array
    v: Array
    lyapunov: Array


def terms(run: Run, configs: Sequence[tuple[float, ControllerConfig]],
          model: Model | None = None) -> Terms:
    """
    Run the controller over the states and the reference of `run`.

    Parameters
    ----------
    run : Run
        Its `tau` and `v` are not used. Under an input delay the reference is taken to rest after
        the last sample, so that as many torques at the end may differ from those sent.
    configs : sequence of (time, ControllerConfig)
        Configurations, each in force from the first sample at or after its time [s].
    model : Model, optional
        In place of the one that the configurations name.

    """
    due = sorted(configs, key=lambda item: item[0])
    law = Controller(due[0][1], model)
    n = len(law.config.joint_names)
    columns = [array('d') for _ in range(5)]
    lyapunov = array('d')
    rows = (x.tolist() for x in (run.q, run.dq, run.q_d, run.dq_d, run.ddq_d))
    samples = list(zip(run.t.tolist(), *rows))
    delay = law.config.input_delay
    for k, (t, q, dq, q_d, dq_d, ddq_d) in enumerate(samples):
        while due and t >= due[0][0]:
            law.configure(due.pop(0)[1])
        ahead = [samples[min(k + j, len(samples) - 1)][3:] for j in range(1, delay + 1)]
        s = law.step(q, dq, q_d, dq_d, ddq_d, ahead)
        for column, row in zip(
                columns, (s.tau, s.inverse_dynamics, s.compensation, s.chattering, s.v)):
            column.extend(row)
        lyapunov.append(law.lyapunov(q, s.v))
    tau, inverse, compensation, chattering, v = (np.array(c).reshape(-1, n) for c in columns)
    return Terms(tau, inverse, compensation, chattering, v, np.array(lyapunov))
