"""The control step compiled: `control.control_step.step` on records in memory."""

from __future__ import annotations

from typing import Any, NamedTuple

from ctc_chattering.batch import dynamics
from ctc_chattering.batch.arm import Arm, arm_of, body_scratch, BodyScratch
from ctc_chattering.batch.compiler import compiled
from ctc_chattering.batch.records import record as record_of
from ctc_chattering.control.control_step import control_memory, in_transit
from ctc_chattering.control.control_step import step as control_step
from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.control.evaluation import Context, control_settings, Models
from ctc_chattering.control.laws.registry import law_class
from ctc_chattering.dynamics.model import Model
from ctc_chattering.numerics.compilable import dot, record, solve
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.numerics.simd.records import load, packed, register, rows, store, value, write
from ctc_chattering.numerics.time_grid import period_ns, seconds
import numpy as np

#: Rows of what a step computes, those of `control.controller.Sample` in this order.
TAU, E, DE, V, NOMINAL, COMPENSATION, ROBUST, SATURATION_ERROR = range(8)


@record
class Place(NamedTuple):
    """Where the dynamics of a state are kept; arrays of shape (n,) and (n, n)."""

    q: Array
    dq: Array
    M: Array
    C: Array
    G: Array


@record
class CompiledModel(NamedTuple):
    """A model, with a place for what it is evaluated to."""

    arm: Arm
    body: BodyScratch
    place: Place

    def evaluate(self, q: Array, dq: Array) -> tuple[Array, Array, Array]:
        """Return M, C and G, as `Model.evaluate` does."""
        place = self.place
        write(place.q, q)
        write(place.dq, dq)
        dynamics.evaluate(self.arm, place.q, place.dq, self.body, place.M, place.C, place.G)
        return value(place.M), value(place.C), value(place.G)

    def acceleration(self, q: Array, dq: Array, u: Array) -> Array:
        """Return ddq, as `Model.acceleration` does; M, C and G are lost."""
        M, C, G = self.evaluate(q, dq)
        return solve(M, u - dot(C, dq) - G)


class ControlRecords(NamedTuple):
    """A controller, each part a NumPy record of what it is named after, or an array."""

    settings: Any
    law: Any
    memory: Any
    law_memory: Any
    arm: Arm
    body: BodyScratch
    #: Where M, C and G of the sample are kept, of the arrival of its torque, and a period later.
    now: Any
    arriving: Any
    after: Any
    #: Torques in transit, shape (4 d, n).
    transit: Array
    #: Position [rad] and velocity [rad/s], shape (2, n), and what is computed of it, (8, n).
    measured: Array
    out: Array


def control_records(config: ControllerConfig, model: Model) -> ControlRecords:
    """Return the controller of a configuration at its start."""
    n, law = model.n, law_class(config.law).made(config, seconds(period_ns(config.control_period)))
    register()  # Its module may have been imported just now.
    zero, square = np.zeros(n), np.zeros((n, n))
    place = Place(zero, zero, square, square, zero)
    return ControlRecords(
        packed(control_settings(config, model.effort_limits)), packed(law),
        packed(control_memory(zero, config.input_delay)), packed(law.start()),
        record_of(arm_of(model, config.gravity, config.inertia_scale, config.gravity_scale)),
        record_of(body_scratch(n)), packed(place), packed(place), packed(place),
        in_transit(n, config.input_delay), np.zeros((2, n)), np.zeros((8, n)))


@compiled
def step(p: ControlRecords, points: Array) -> None:
    """
    Go on by a sample, and set `p.out`.

    Parameters
    ----------
    p : ControlRecords
        After the last sample, with what is measured.
    points : array, shape (1 + d, 3, n)
        The reference at this sample and those of the delay; there may be more.

    """
    memory = load(p.memory)
    like = memory.xi
    measured = rows(p.measured, like)
    models = Models(CompiledModel(p.arm, p.body, p.now), CompiledModel(p.arm, p.body, p.arriving),
                    CompiledModel(p.arm, p.body, p.after))
    made = control_step(
        Context(load(p.settings), models, rows(p.transit, like)), load(p.law), memory,
        load(p.law_memory), measured[0], measured[1], rows(points, like))
    store(p.memory, made.memory)
    store(p.law_memory, made.law_memory)
    out, terms = rows(p.out, like), made.parts
    out[TAU], out[E], out[DE], out[V] = made.sent.tau, made.now.e, made.now.de, made.now.v
    out[NOMINAL], out[COMPENSATION] = terms.nominal, terms.compensation
    out[ROBUST], out[SATURATION_ERROR] = terms.robust, made.sent.saturation_error
