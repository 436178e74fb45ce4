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

"""The law and the switching of `examples/`: named by a parameter, as plain Python and compiled."""

from __future__ import annotations

from pathlib import Path

from ctc_chattering.analysis.result import simulate
from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.package_share import config_directory
from ctc_chattering.control.controller import Controller, ControllerConfig
from ctc_chattering.errors import CtcError
from ctc_chattering.simulation.closed_loop import Run
from machine_code import compile_runs
import numpy as np
from oracles import paper_c, paper_g, paper_m
import pytest

EXAMPLES = Path(__file__).resolve().parents[2] / 'examples'


@pytest.fixture(autouse=True)
def _found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(EXAMPLES))


@pytest.mark.slow
@pytest.mark.parametrize('values', [
    {'law': 'own_law:LeakyIntegral', 'ki': [400.0, 400.0]},
    {'law': 'chattering', 'switching': 'own_switching:Smooth'}])
def test_the_same_run_compiled(values: dict[str, object]) -> None:
    def run(values: dict[str, object], plain: bool = False) -> Run:
        setup = parameter_file.load(config_directory() / 'friction.yaml', {
            'plant': {'duration': 0.5, 'compiled': not plain},
            'controller': {**values, 'compiled': not plain}})
        compile_runs(setup)
        found = simulate(setup).run
        assert found.compiled != plain
        return found
    plain, found, without = run(values, True), run(values), run({'law': 'compensation'})
    np.testing.assert_allclose(found.tau, plain.tau, rtol=1e-9, atol=1e-9)
    assert np.abs(without.tau - found.tau).max() > 1.0


def test_the_terms_by_hand() -> None:
    rng = np.random.default_rng(1)
    q, dq, q_d, dq_d, ddq_d = rng.normal(size=(5, 2))
    M, C, G, h = paper_m(q), paper_c(q, dq), paper_g(q), 1e-3
    own = Controller(ControllerConfig(law='own_law:LeakyIntegral'))
    e, de = q_d - q, dq_d - dq
    N = M @ (ddq_d + 50.0 * de + 100.0 * e) + C @ dq + G
    np.testing.assert_allclose(own.step(q, dq, q_d, dq_d, ddq_d).tau, N)
    P = h * 100.0 * M @ (de + 2.0 * e)
    np.testing.assert_allclose(own.step(q, dq, q_d, dq_d, ddq_d).tau, N + P)
    smooth = Controller(ControllerConfig(switching='own_switching:Smooth'))
    np.testing.assert_allclose(smooth.step(q, dq, q_d, dq_d, ddq_d).tau,
                               N + C @ de - 10.0 * np.tanh(-de / 0.05))


@pytest.mark.parametrize('values', [
    {'law': 'own_law'}, {'law': 'own_law:Nothing'}, {'law': 'no_module:Law'},
    {'law': 'own_switching:Smooth'}, {'switching': 'own_law:LeakyIntegral'}])
def test_what_is_none(values: dict[str, str]) -> None:
    words = r'package.module:Name|there is no law (own_law:Nothing|no_module:Law)|no class marked'
    with pytest.raises(CtcError, match=words):
        Controller(ControllerConfig.from_mapping(values))
