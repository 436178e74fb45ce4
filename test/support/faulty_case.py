"""A robot with a fault, and how it is recorded."""

from __future__ import annotations

from collections.abc import Callable
import dataclasses

from ctc_chattering.analysis.recording import Recording
from ctc_chattering.trajectory.waypoints import Route
from faulty_robots import Faulty
import numpy as np

Rng = np.random.Generator


@dataclasses.dataclass(frozen=True)
class Case:
    """
    A robot with a fault, and how it is recorded.

    Attributes
    ----------
    robot : Faulty
        The truth.
    effort : str
        What the states have: none, motor, or link.
    alter : callable, optional
        What the recorder makes of the recording.
    bag : bool
        Whether it must go through a bag with receive jitter.
    slower : callable, optional
        What the lab makes of the usual motion.
    believed : str
        The arm whose description the user gives, if it is another one.

    """

    robot: Faulty
    effort: str = 'none'
    alter: Callable[[Recording], Recording] | None = None
    bag: bool = False
    slower: Callable[[Route], Route] | None = None
    believed: str = ''


Made = Callable[[Faulty, Rng, float], Faulty | Case]
