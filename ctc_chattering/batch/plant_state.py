"""Parameters and state of the compiled plant."""

from __future__ import annotations

import dataclasses
from math import ceil, inf

from ctc_chattering.batch.dynamics import Flags
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.numerics.time_grid import period_ns, samples, seconds
from ctc_chattering.simulation.plant_config import PlantConfig
import numpy as np
import numpy.typing as npt

#: Torques in transit that there is room for: `input_delay` is at most 100.
LONGEST_DELAY = 100


@dataclasses.dataclass
class PlantSettings:
    """Parameters of a plant in SI units, as `PlantConfig` declares them; arrays of shape (n,)."""

    #: Sample period [ns] and [s], steps of the integrator in it, and index of the last sample.
    period_ns: int
    period: float
    substeps: int
    last: int
    coulomb: Array
    viscous: Array
    stribeck: Array
    stribeck_velocity: Array
    load: Array
    asymmetry: Array
    #: Whether any joint has friction that depends on the velocity, the load, the direction.
    varies_with_velocity: bool
    loaded: bool
    uneven: bool
    amplitude: Array
    frequency: Array
    #: Push, and the first sample after it.
    push: Array
    push_end: int
    #: Whether there is a disturbance, and whether the drives are ideal.
    disturbed: bool
    ideal: bool
    lag: Array
    rate: Array
    delay: int
    saturation: Array
    resolution: Array
    sample_loss: float
    late_samples: float


@dataclasses.dataclass
class PlantState:
    """State of a plant; arrays of shape (n,) unless they say otherwise."""

    k: int
    q: Array
    dq: Array
    #: Torque of the drives, received, commanded over this period, and in transit (101, n) [N·m].
    applied: Array
    received: Array
    command: Array
    coming: Array
    #: Of `drives.command`.
    gap: Array
    torque: Array
    mean: Array
    #: Friction at rest, and of the joints that slide with its sign [N·m].
    breakaway: Array
    friction: Array
    mode: npt.NDArray[np.int64]
    fixed: Flags
    #: Whether the modes are decided, and whether a joint sticks.
    decided: int
    sticking: int
    lost: int
    lost_in_a_row: int


@dataclasses.dataclass
class PlantScratch:
    """Scratch of the integrator; arrays of shape (n,)."""

    #: Torque less constant friction; torques at the start, middle and end of a step.
    load: Array
    start: Array
    middle: Array
    end: Array
    #: Torque of a stage less the friction of its velocity.
    u: Array
    #: Positions, velocities and accelerations of the stages.
    x: Array
    v2: Array
    v3: Array
    v4: Array
    a1: Array
    a2: Array
    a3: Array
    a4: Array
    #: State at the end of a step.
    q: Array
    dq: Array


def plant_settings(config: PlantConfig) -> PlantSettings:
    """Return the numbers of a configuration."""
    ns = period_ns(config.control_period)
    h = seconds(ns)
    pushed = any(config.disturbance_push)
    return PlantSettings(
        ns, h, max(1, ceil(h / config.integration_step - 1e-9)), samples(config.duration, ns),
        np.array(config.coulomb_friction), np.array(config.viscous_friction),
        np.array(config.stribeck_friction), np.array(config.stribeck_velocity),
        np.array(config.load_friction), np.array(config.friction_asymmetry),
        any(config.viscous_friction) or any(config.stribeck_friction),
        any(config.load_friction), any(config.friction_asymmetry),
        np.array(config.disturbance_amplitude), np.array(config.disturbance_frequency),
        np.array(config.disturbance_push),
        round(config.disturbance_push_duration / h) if pushed else 0,
        any(config.disturbance_amplitude),
        not any(config.actuator_lag) and min(config.torque_rate_limit) == inf,
        np.array(config.actuator_lag), np.array(config.torque_rate_limit), config.input_delay,
        np.array(config.torque_saturation), np.array(config.torque_resolution),
        config.sample_loss, config.late_samples)


def plant_state(config: PlantConfig) -> PlantState:
    """Return the state at the start."""
    zero = np.zeros(len(config.joint_names))
    flags = zero.astype(np.int8)
    return PlantState(
        0, np.array(config.initial_position), np.array(config.initial_velocity), zero, zero, zero,
        np.zeros((LONGEST_DELAY + 1, len(zero))), zero, zero, zero, zero, zero,
        zero.astype(np.int64), flags, 0, 0, 0, 0)


def plant_scratch(n: int) -> PlantScratch:
    """Return scratch for `n` joints."""
    return PlantScratch(*[np.zeros(n)] * len(dataclasses.fields(PlantScratch)))
