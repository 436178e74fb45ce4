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
A law of your own: computed torque with an estimate that leaks.

::

    τ = M (ddq_d + Kv de + Kp e) + C dq + G + P̂,     P̂[k+1] = (1 - h / T) P̂[k] + h Γ M s,
    s = de + e / T

``python own_law.py`` prints its errors beside those of two laws of the package. For nodes and
``ctc``, put the module where Python finds it, and name the class: ``law: own_law:LeakyIntegral``.
What a law has is in `ctc_chattering/control/laws/base.py`, what its methods may use in
`ctc_chattering/compiled/compilable.py`. It runs in nodes and in `ctc simulate`, and compiled in
maps, all from this text. The arguments of `law` are its traits: the parameters that it takes, what
watches it, and the rule of its recommended gains.
"""

from __future__ import annotations

from typing import NamedTuple

from ctc_chattering import (
    Applied,
    ControllerConfig,
    dot,
    law,
    load_parameters,
    PoleRule,
    record,
    simulate,
    State,
    Terms,
)
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
#: T [s].
_TIME = 0.5


@record
class Leaky(NamedTuple):
    """The memory."""

    #: P̂ [N·m], shape (n,).
    perturbation: Array


@law(symbol='-P̂', parameters=('ki',), is_watched=True, is_bounded=False,
     gain_rule=PoleRule(0.3, times_p={'ki': 4.0}))
class LeakyIntegral(NamedTuple):
    """The law with its gains."""

    #: h [s], and h Γ [1/s], shape (n,); here Γ is the parameter ki.
    period: float
    gain: Array

    @classmethod
    def from_config(cls, config: ControllerConfig, period: float) -> LeakyIntegral:
        """Return the law of a configuration."""
        return cls(period, period * np.array(config.ki))

    def initial(self) -> Leaky:
        """Return P̂ = 0."""
        return Leaky(0.0 * self.gain)

    def terms(self, memory: Leaky, state: State) -> tuple[Terms, Leaky]:
        """Return nominal term, compensation, robust term and clipping error."""
        return Terms(state.N, state.zero, -memory.perturbation, state.zero), memory

    def advanced(self, memory: Leaky, now: State, applied: Applied) -> Leaky:
        """Return the memory a period later."""
        s = now.de + now.e / _TIME
        kept = (1.0 - self.period / _TIME) * memory.perturbation
        return Leaky(kept + self.gain * dot(now.M, s))

    def estimate(self, memory: Leaky, now: State) -> Array:
        """Return P̂, from which a law that follows begins."""
        return memory.perturbation


if __name__ == '__main__':
    for choice in ('compensation', 'integral', LeakyIntegral):
        result = simulate(load_parameters('friction', {
            'plant': {'duration': 6.0}, 'controller': {'law': choice, 'ki': 400.0}}))
        e1, e2 = result.metrics()['rms_error_rad']
        print(f'{result.law:25} RMS error {e1:.1e}, {e2:.1e} rad')
