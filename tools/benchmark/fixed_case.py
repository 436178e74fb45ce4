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
The two-link arm of the file `friction` under law (2), and nothing else, in scalars.

What a compiled loop needs at least: no array, no other law, no imperfection, and friction that is
as simple as it can be; a joint whose velocity changes its sign within a step rests at the end of
it, where the package finds the instant. The same source text is compiled by numba, for one run
after the other, and by JAX, for many runs in step.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from importlib import import_module
from math import cos, exp, pi, sin
import os
from typing import Any

import numba
import numpy as np
import numpy.typing as npt

#: Sample period and step of the integrator [s].
PERIOD = 1e-3
#: Friction of the file [N·m].
FRICTION = 9.9
_KP = 100.0
_KV = 50.0
_LAMBDA = 10.0
_GRAVITY = 9.81
_DECAY = exp(-_LAMBDA * PERIOD)
_GAIN = (1.0 - _DECAY) / _LAMBDA
_OMEGA = 2.0 * pi

Floats = npt.NDArray[np.float64]
Compiler = Callable[[Any], Any]


def _dynamics(sin: Any, cos: Any, where: Any, compiled: Compiler) -> tuple[Any, Any]:
    """Return the terms of M, C and G that vary, and the acceleration with joints at rest."""
    @compiled
    def model(q1: Any, q2: Any) -> Any:
        c2, g2 = cos(q2), 0.63 * _GRAVITY * sin(q1 + q2)
        return (8.77 + 1.02 * c2, 0.76 + 0.51 * c2, 0.51 * sin(q2),
                7.6 * _GRAVITY * sin(q1) + g2, g2)

    @compiled
    def accelerate(q1: Any, q2: Any, d1: Any, d2: Any, u1: Any, u2: Any, rest1: Any, rest2: Any
                   ) -> Any:
        m11, m12, k, g1, g2 = model(q1, q2)
        m12 = where(rest1 | rest2, 0.0, m12)
        r1 = where(rest1, 0.0, u1 + k * d2 * (d1 + d1 + d2) - g1)
        r2 = where(rest2, 0.0, u2 - k * d1 * d1 - g2)
        by = 1.0 / (0.62 * m11 - m12 * m12)
        return by * (0.62 * r1 - m12 * r2), by * (m11 * r2 - m12 * r1)

    return model, accelerate


def _friction(model: Any, accelerate: Any, where: Any, compiled: Compiler) -> Any:
    """Return a function that decides how both joints move: 1, -1, or 0 at rest."""
    @compiled
    def mode(d: Any, held: Any, friction: Any) -> Any:
        at_rest = where(held > friction, 1.0, where(held < -friction, -1.0, 0.0))
        return where(d > 0.0, 1.0, where(d < 0.0, -1.0, at_rest))

    @compiled
    def modes(q1: Any, q2: Any, d1: Any, d2: Any, u1: Any, u2: Any, friction: Any) -> Any:
        n1, n2 = mode(d1, 0.0, friction), mode(d2, 0.0, friction)
        a1, a2 = accelerate(q1, q2, d1, d2, u1 - friction * n1, u2 - friction * n2,
                            n1 == 0.0, n2 == 0.0)
        m11, m12, k, g1, g2 = model(q1, q2)
        held1 = u1 - (m11 * a1 + m12 * a2 - k * d2 * (d1 + d1 + d2) + g1)
        held2 = u2 - (m12 * a1 + 0.62 * a2 + k * d1 * d1 + g2)
        return mode(d1, held1, friction), mode(d2, held2, friction)

    return modes


def _runge_kutta(accelerate: Any, compiled: Compiler) -> Any:
    """Return a step of fourth order."""
    @compiled
    def runge_kutta(q1: Any, q2: Any, d1: Any, d2: Any, u1: Any, u2: Any, rest1: Any, rest2: Any
                    ) -> Any:
        h, half, sixth = PERIOD, 0.5 * PERIOD, PERIOD / 6.0
        a1, a2 = accelerate(q1, q2, d1, d2, u1, u2, rest1, rest2)
        e1, e2 = d1 + half * a1, d2 + half * a2
        b1, b2 = accelerate(q1 + half * d1, q2 + half * d2, e1, e2, u1, u2, rest1, rest2)
        f1, f2 = d1 + half * b1, d2 + half * b2
        c1, c2 = accelerate(q1 + half * e1, q2 + half * e2, f1, f2, u1, u2, rest1, rest2)
        g1, g2 = d1 + h * c1, d2 + h * c2
        z1, z2 = accelerate(q1 + h * f1, q2 + h * f2, g1, g2, u1, u2, rest1, rest2)
        return (q1 + sixth * (d1 + 2.0 * (e1 + f1) + g1), q2 + sixth * (d2 + 2.0 * (e2 + f2) + g2),
                d1 + sixth * (a1 + 2.0 * (b1 + c1) + z1), d2 + sixth * (a2 + 2.0 * (b2 + c2) + z2))

    return runge_kutta


def make_step(sin: Any, cos: Any, where: Any, compiled: Compiler) -> Any:
    """
    Return a function that goes on by a period.

    It takes the number of the sample and of the first that is evaluated, friction [N·m], and
    positions [rad], velocities [rad/s], states of the filter (3) [rad/s] and sums of the squared
    errors [rad²] of both joints; it returns the last four a period later.
    """
    model, accelerate = _dynamics(sin, cos, where, compiled)
    modes = _friction(model, accelerate, where, compiled)
    runge_kutta = _runge_kutta(accelerate, compiled)

    @compiled
    def step(k: Any, first: Any, friction: Any, state: Any) -> Any:
        q1, q2, d1, d2, x1, x2, sum1, sum2 = state
        angle = _OMEGA * PERIOD * k
        s, c = 0.5 * sin(angle), 0.5 * _OMEGA * cos(angle)
        e1, e2, de1, de2 = pi + s - q1, 0.5 * pi + s - q2, c - d1, c - d2
        sum1, sum2 = (where(k < first, 0.0, sum1 + e1 * e1),
                      where(k < first, 0.0, sum2 + e2 * e2))
        u1, u2 = _KV * de1 + _KP * e1, _KV * de2 + _KP * e2
        w1, w2 = d1 - (x1 - de1), d2 - (x2 - de2)                     # dq - v
        m11, m12, r, g1, g2 = model(q1, q2)
        y1, y2 = u1 - _OMEGA * _OMEGA * s, u2 - _OMEGA * _OMEGA * s
        tau1 = m11 * y1 + m12 * y2 - r * (d2 * w1 + (d1 + d2) * w2) + g1
        tau2 = m12 * y1 + 0.62 * y2 + r * d1 * w1 + g2                # (2)
        x1, x2 = (_DECAY * x1 + _GAIN * (_LAMBDA * de1 - u1),
                  _DECAY * x2 + _GAIN * (_LAMBDA * de2 - u2))         # (3)
        n1, n2 = modes(q1, q2, d1, d2, tau1, tau2, friction)
        q1, q2, d1, d2 = runge_kutta(q1, q2, d1, d2, tau1 - friction * n1, tau2 - friction * n2,
                                     n1 == 0.0, n2 == 0.0)
        return (q1, q2, where(d1 * n1 * friction < 0.0, 0.0, d1),
                where(d2 * n2 * friction < 0.0, 0.0, d2), x1, x2, sum1, sum2)

    return step


def by_numba() -> Callable[[Floats, int, int], Floats]:
    """Return a function of friction, first evaluated sample and steps: RMS errors (runs, 2)."""
    @numba.njit(error_model='numpy', forceinline=True)
    def where(condition: bool, a: float, b: float) -> float:
        return a if condition else b

    step = make_step(sin, cos, where, numba.njit(error_model='numpy', forceinline=True))

    @numba.njit(error_model='numpy')
    def run(friction: float, first: int, steps: int) -> tuple[float, float]:
        state = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        for k in range(steps + 1):
            state = step(k, first, friction, state)
        return state[6], state[7]

    def errors(friction: Floats, first: int, steps: int) -> Floats:
        sums = np.array([run(x, first, steps) for x in friction.tolist()])
        return np.sqrt(sums / (steps + 1 - first))

    return errors


def by_jax() -> Callable[[Floats, int, int], Floats]:
    """Return the same by JAX, in float64, one thread; raise `ImportError` if it is not there."""
    os.environ['XLA_FLAGS'] = ('--xla_cpu_multi_thread_eigen=false '
                               'intra_op_parallelism_threads=1')
    os.environ['JAX_PLATFORMS'] = 'cpu'
    jax, lax, jnp = map(import_module, ('jax', 'jax.lax', 'jax.numpy'))
    jax.config.update('jax_enable_x64', True)

    def once(always: Any, function: Any) -> Any:
        """Keep XLA from computing `function` again for each of its results: 1.5 times as fast."""
        def called(*operands: Any) -> Any:
            results = jax.eval_shape(function, *operands)
            return lax.cond(always, function, lambda *_: tuple(
                jnp.zeros(x.shape, x.dtype) for x in results), *operands)
        return called if function.__name__ in ('accelerate', 'model') else function

    def run(friction: Any, first: Any, steps: int) -> Any:
        step = make_step(jnp.sin, jnp.cos, jnp.where, partial(once, first >= 0))
        state, _ = lax.scan(lambda state, k: (step(k, first, friction, state), None),
                            (jnp.zeros(()),) * 8, jnp.arange(steps + 1))
        return state[6], state[7]

    many = jax.jit(jax.vmap(run, (0, None, None)), static_argnums=2)

    def errors(friction: Floats, first: int, steps: int) -> Floats:
        sums = np.stack(many(friction, first, steps), axis=1)
        return np.sqrt(sums / (steps + 1 - first))

    return errors
