"""An arm of one's own that cannot move: in a module, so that other processes find it."""

from __future__ import annotations

from collections.abc import Sequence

from ctc_chattering.dynamics.two_link import TwoLink
from ctc_chattering.numerics.linear_algebra import Vector


class Broken(TwoLink):
    """The paper's arm; asked for an acceleration it raises `error`."""

    error: type[Exception] = MemoryError

    def __init__(self, joint_names: Sequence[str], gravity: float) -> None:
        del joint_names
        super().__init__(gravity)

    def forward_dynamics(self, *_: object) -> Vector:
        raise self.error('no more')
