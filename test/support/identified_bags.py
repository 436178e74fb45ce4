"""A short bag of the paper's arm, for the tests that read one."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from identified_robots import record, Recorded
from motion_bags import messages_of, write


def recorded_bag(path: Path, made: Recorded, **more: Any) -> Path:
    """Write a recording into a bag; arguments as `messages_of` has them."""
    x = made.recording
    fields = {'q': x.q, 'dq': x.dq, 'effort': x.effort, 'command': x.command, **more}
    t = fields.pop('t', x.t)
    return write(path, messages_of(t, x.joints, **fields))


def short(seed: int = 1, duration: float = 8.0) -> Recorded:
    """Return a short recording."""
    return record('two_link', seed, duration)
