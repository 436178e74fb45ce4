"""The desired motion: a sinusoid on every joint, q_d = center + amplitude sin(2π f t + phase)."""

from __future__ import annotations

import dataclasses
from math import cos, pi, sin
from typing import ClassVar

from ctc_chattering.core.grid import period_ns
from ctc_chattering.core.model import Vector
from ctc_chattering.core.parameters import Config, parameter


@dataclasses.dataclass(frozen=True)
class ReferenceConfig(Config):
    """Parameters of the desired motion."""

    title: ClassVar[str] = 'reference'

    joint_names: tuple[str, ...] = parameter(
        'joint_names', 'str[]', ('joint1', 'joint2'), 'Joints of the desired motion.',
        read_only=True)
    center: tuple[float, ...] = parameter(
        'center', 'float[]', (pi, 0.5 * pi), 'Centre of the sinusoid.', unit='rad', shape='n',
        read_only=True)
    amplitude: tuple[float, ...] = parameter(
        'amplitude', 'float[]', 0.5, 'Amplitude of the sinusoid.', unit='rad', shape='n',
        read_only=True)
    frequency: tuple[float, ...] = parameter(
        'frequency', 'float[]', 1.0, 'Frequency of the sinusoid.', unit='Hz', minimum=0.0,
        shape='n', read_only=True)
    phase: tuple[float, ...] = parameter(
        'phase', 'float[]', 0.0, 'Phase of the sinusoid at t = 0.', unit='rad', shape='n',
        read_only=True)
    control_period: float = parameter(
        'control_period', 'float', 1e-3, 'Spacing of the points.', unit='s', minimum=0.0,
        exclusive=True, read_only=True)

    def validate(self) -> None:
        """Check the period."""
        period_ns(self.control_period)


class Sinusoid:
    """
    The desired motion as a function of time.

    Parameters
    ----------
    config : ReferenceConfig

    """

    def __init__(self, config: ReferenceConfig) -> None:
        self._joints = [
            (c, a, 2.0 * pi * f, p) for c, a, f, p in zip(
                config.center, config.amplitude, config.frequency, config.phase)]

    def at(self, t: float) -> tuple[Vector, Vector, Vector]:
        """Return q_d [rad], dq_d [rad/s] and ddq_d [rad/s²], each of shape (n,), at `t` [s]."""
        q_d, dq_d, ddq_d = [], [], []
        for center, amplitude, omega, phase in self._joints:
            angle = omega * t + phase
            x = amplitude * sin(angle)
            q_d.append(center + x)
            dq_d.append(omega * amplitude * cos(angle))
            ddq_d.append(-omega * omega * x)
        return q_d, dq_d, ddq_d
