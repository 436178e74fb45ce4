"""What one control step computes."""

from __future__ import annotations

from typing import NamedTuple, Protocol

from ctc_chattering.core.array_model import Array
from ctc_chattering.core.model import Vector


class Sample(Protocol):
    """What one control step computed; every vector has shape (n,)."""

    @property
    def tau(self) -> Vector:
        """Torque to send, within the effort limit [N·m]."""

    @property
    def e(self) -> Vector:
        """Position error e = q_d - q [rad]."""

    @property
    def de(self) -> Vector:
        """Velocity error de = dq_d - dq [rad/s]."""

    @property
    def v(self) -> Vector:
        """
        Filtered error [rad/s].

        e, de and v belong to the state; what follows to the torque, which under an input delay is
        for the state predicted over it.
        """

    @property
    def inverse_dynamics(self) -> Vector:
        """M [ddq_d + Kv de + Kp e] + C dq + G [N·m]."""

    @property
    def compensation(self) -> Vector:
        """C v, which both laws subtract [N·m]."""

    @property
    def chattering(self) -> Vector:
        """Ka sgn(v), however switched, which law (6) subtracts; 0 under law (2) [N·m]."""

    @property
    def excess(self) -> Vector | None:
        """What the limits have cut off the torque [N·m]; None for nothing."""


class ListSample(NamedTuple):
    """A `Sample` of lists."""

    tau: Vector
    e: Vector
    de: Vector
    v: Vector
    inverse_dynamics: Vector
    compensation: Vector
    chattering: Vector
    excess: Vector | None


class ArraySample(NamedTuple):
    """A `Sample` that makes lists of what is rarely asked for when it is."""

    tau: Vector
    chattering: Vector
    excess: Vector | None
    #: The rows v, e, de, four that are of no concern here, inverse dynamics and compensation.
    rows: Array

    @property
    def e(self) -> Vector:
        """Position error."""
        return _listed(self.rows[1])

    @property
    def de(self) -> Vector:
        """Velocity error."""
        return _listed(self.rows[2])

    @property
    def v(self) -> Vector:
        """Filtered error."""
        return _listed(self.rows[0])

    @property
    def inverse_dynamics(self) -> Vector:
        """Inverse dynamics."""
        return _listed(self.rows[7])

    @property
    def compensation(self) -> Vector:
        """C v."""
        return _listed(self.rows[8])


def _listed(row: Array) -> list[float]:
    values: list[float] = row.tolist()
    return values
