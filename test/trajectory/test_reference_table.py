"""The reference of compiled runs: one layout, for which the loop is compiled once."""

from ctc_chattering.trajectory.reference import make_motion, ReferenceConfig
from ctc_chattering.trajectory.reference_table import reference_table
import numpy as np
import pytest

MS = 1_000_000


@pytest.mark.parametrize('start', [0.0, 0.05])
def test_the_layout_is_the_same_for_every_motion(start: float) -> None:
    """The rows are those of the motion, in the order of the joints that is asked for."""
    config = ReferenceConfig(start_duration=start)
    where = {'joint1': (0.1, 0.0), 'joint2': (-0.2, 0.3)} if start else {}
    table = reference_table(
        config, None, tuple(where.items()), config.joint_names[::-1], MS, 100)
    assert table.flags.c_contiguous
    motion = make_motion(config, None, where)
    expected = [[row[::-1] for row in motion.at(k * MS)] for k in range(100)]
    np.testing.assert_allclose(table, expected, rtol=1e-12, atol=1e-12)
