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

"""Terms of the law, recomputed over the states of a run."""

from __future__ import annotations

import dataclasses
from typing import Any

from ctc_chattering.analysis.signals import SignalOrigin
from ctc_chattering.analysis.terms import terms
from ctc_chattering.control.controller import ControllerConfig
from ctc_chattering.simulation.closed_loop import Event, Run, run_closed_loop
from ctc_chattering.simulation.plant_config import PlantConfig
from ctc_chattering.trajectory.reference import ReferenceConfig
import numpy as np
from oracles import paper_c, paper_g, paper_m
import pytest

CONTROLLER = ControllerConfig(
    kp=(90.0, 20.0, 20.0, 130.0), kv=(40.0, 5.0, 5.0, 60.0), effort_limit=(300.0, 300.0),
    compiled=False)  # Other tests may compile its law between run and terms.
PLANT = PlantConfig(duration=1.0, compiled=False, disturbance_amplitude=(1.0, 1.0),
                    disturbance_frequency=(1.0, 2.0))


def _run(*events: Event) -> Run:
    return run_closed_loop(PLANT, CONTROLLER, ReferenceConfig(), events)


def test_terms_are_those_of_the_run_bit_for_bit_through_events() -> None:
    """Check a law, gains and a filter that change in the run, given in any order."""
    changes: list[tuple[float, dict[str, Any]]] = [
        (0.4, {'law': 'compensation'}), (0.2005, {'kp': [50.0, 60.0], 'lambda': 3.0}),
        (0.7, {'law': 'chattering', 'ka': [20.0, 5.0]})]
    run = _run(*(Event(t, 'controller', values) for t, values in changes))
    configs, config = [(0.0, CONTROLLER)], CONTROLLER
    for t, values in sorted(changes, key=lambda change: change[0]):
        config = config.changed(values)
        configs.append((t, config))
    found = terms(run, configs[::-1])
    assert (found.tau == run.tau).all()
    assert (found.v == run.v).all()
    off = (run.t >= 0.4) & (run.t < 0.7)
    assert (found.robust[off] == 0.0).all()
    assert (found.robust[~off] != 0.0).any(axis=1).all()
    assert not (terms(run, [(0.0, CONTROLLER)]).tau == run.tau).all()


def test_terms_follow_the_equations_of_the_paper() -> None:
    """Check every term of law (6) and V of (9) against numpy at each sample."""
    run = run_closed_loop(PLANT, ControllerConfig(), ReferenceConfig())
    found = terms(run, [(0.0, ControllerConfig())])
    for k in range(0, len(run.t), 7):
        q, dq, v = run.q[k].tolist(), run.dq[k].tolist(), run.v[k]
        a = run.ddq_d[k] + 50 * (run.dq_d[k] - dq) + 100 * (run.q_d[k] - q)
        np.testing.assert_allclose(
            found.nominal[k], paper_m(q) @ a + paper_c(q, dq) @ dq + paper_g(q),
            rtol=1e-11, atol=1e-10)
        np.testing.assert_allclose(found.compensation[k], paper_c(q, dq) @ v, atol=1e-11)
        np.testing.assert_allclose(found.robust[k], 10.0 * np.sign(v))
        assert found.lyapunov[k] == pytest.approx(0.5 * v @ paper_m(q) @ v)
    np.testing.assert_allclose(
        found.tau, found.nominal - found.compensation - found.robust, atol=1e-9)


def test_terms_are_exact_where_samples_were_lost() -> None:
    """Check that the law went on by the stamps of the others, to the last bit."""
    config = dataclasses.replace(CONTROLLER, switching='implicit_observer')
    run = run_closed_loop(
        dataclasses.replace(PLANT, sample_loss=0.3), config, ReferenceConfig())
    assert 500 < len(run.t) < 900
    found = terms(run, [(0.0, config)])
    assert (found.tau == run.tau).all() and (found.v == run.v).all()
    assert found.t is run.t and found.origin is SignalOrigin.COMPUTED
