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

"""The terms of the law, recomputed over a run."""

import dataclasses
from typing import Any

from ctc_chattering.analysis.terms import terms
from ctc_chattering.control.controller import ControllerConfig
from ctc_chattering.simulation.closed_loop import Event, Run, simulate
from ctc_chattering.simulation.plant_config import PlantConfig
from ctc_chattering.trajectory.reference import ReferenceConfig
import numpy as np
from oracles import paper_c, paper_g, paper_m
import pytest

CONTROLLER = ControllerConfig(
    kp=(90.0, 20.0, 20.0, 130.0), kv=(40.0, 5.0, 5.0, 60.0), effort_limit=(300.0, 300.0))
PLANT = PlantConfig(duration=1.0, disturbance_amplitude=(1.0, 1.0),
                    disturbance_frequency=(1.0, 2.0))


def _run(*events: Event) -> Run:
    return simulate(PLANT, CONTROLLER, ReferenceConfig(), events)


def test_bit_for_bit_through_events() -> None:
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


def test_parts_are_the_equations() -> None:
    """Check every term of law (6) and V of (9) against numpy at each sample."""
    run = simulate(PLANT, ControllerConfig(), ReferenceConfig())
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


@pytest.mark.parametrize('few', [1, 15])
def test_samples_that_are_missing(few: int) -> None:
    """Check that v and the chattering term are right after a few missing samples, repeatedly."""
    config = dataclasses.replace(CONTROLLER, switching='implicit', effort_limit=(1e4, 1e4))
    run = simulate(PLANT, config, ReferenceConfig())
    kept = np.arange(len(run.t)) % (2 * few + 5) >= few
    kept[:100] = True
    found = terms(Run(*(x[kept] for x in list(vars(run).values())[:-1])), [(0.0, config)])
    assert np.abs(found.v - run.v[kept]).max() < 0.01 * np.abs(run.v).max()
    whole = terms(run, [(0.0, config)])
    late = run.t[kept] > 0.5
    difference = np.abs(found.robust - whole.robust[kept])[late]
    assert np.percentile(difference, 90.0) < (1.0 if few < 10 else 4.0)


def test_many_missing_samples() -> None:
    """Check that v begins again at 0, and goes on from where it is known."""
    run = _run()
    kept = (run.t < 0.3) | (run.t > 0.4)
    part = Run(*(x[kept] for x in list(vars(run).values())[:-1]))
    k = int(np.flatnonzero(np.diff(part.t) > 0.05)[0]) + 1
    found = terms(part, [(0.0, CONTROLLER)])
    assert (found.v[:k] == run.v[kept][:k]).all()
    assert not found.v[k].any()
    known = {part.t[k + 7]: part.v[k + 7].tolist(), part.t[k + 9]: [7.0, 7.0]}
    known[part.t[5]] = [7.0, 7.0]
    found = terms(part, [(0.0, CONTROLLER)], known=known)
    np.testing.assert_allclose(found.v[k + 7:], part.v[k + 7:], atol=1e-9)
