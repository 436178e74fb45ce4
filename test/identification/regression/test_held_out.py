"""Corrected bodies on windows that they were not fitted to."""

from __future__ import annotations

from ctc_chattering.dynamics.urdf_model import UrdfModel
from ctc_chattering.identification.regression.error_columns import ErrorColumns
from ctc_chattering.identification.regression.held_out import left_over
from ctc_chattering.identification.regression.least_squares import Data, Term, TermKind
from ctc_chattering.identification.regression.rows import STRIBECK
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np
import pytest
import urdfs

#: Windows.
COUNT = 400
TERMS = [Term(kind, i) for i in range(2) for kind in (TermKind.FORWARDS, TermKind.BACKWARDS)]


def ratios(rotor: Array, noise: float = 1e-3) -> Array:
    """Return what corrected bodies leave with these rotors in each window, shape (COUNT, 2)."""
    model = UrdfModel(urdfs.two_links(), urdfs.TWO_LINKS)
    columns = ErrorColumns.of(model)
    assert columns is not None
    rng = np.random.default_rng(3)
    states = rng.normal(size=(COUNT, 3, 2))
    way = np.sign(states[:, 1])
    residual = rotor * states[:, 2] + 2.0 * way + noise * rng.normal(size=(COUNT, 2))
    base = np.array([model.inverse_dynamics(*(x.tolist() for x in state)) for state in states])
    more = np.array([columns.at(*state) for state in states])
    data = Data(np.arange(float(COUNT)), states[:, 1], way, more,
                np.zeros((COUNT, 2, len(STRIBECK))), np.abs(base), np.zeros((COUNT, 2)),
                residual, (0,), base + residual, np.full(2, 1e-4))
    return left_over(data, TERMS, columns, None)


@pytest.mark.parametrize('later', [0.3, -0.3])
def test_a_rotor_that_stays_is_corrected_and_one_that_changes_is_worse(later: float) -> None:
    rotor = np.where(np.arange(COUNT) < COUNT // 2, 0.3, later)[:, None] * np.ones(2)
    found = ratios(rotor)
    assert (found < 0.2).all() if later > 0.0 else (found > 1.3).all(), found


def test_noise_of_a_joint_that_nothing_corrects_is_not_worse() -> None:
    found = ratios(np.array([0.0, 0.3]))
    assert found[0] < 1.01 and found[1] < 0.2, found
