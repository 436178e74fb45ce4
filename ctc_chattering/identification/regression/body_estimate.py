"""Inertial parameters of the moved bodies, as a model has them and as a motion shows them."""

from __future__ import annotations

import dataclasses

from ctc_chattering.numerics.linear_algebra import Array

#: The ten parameters of a body, in Pinocchio's order: mass [kg], first moments [kg·m], and moments
#: of inertia about the joint's frame [kg·m²].
PARAMETERS = ('m', 'mx', 'my', 'mz', 'Ixx', 'Ixy', 'Iyy', 'Ixz', 'Iyz', 'Izz')


@dataclasses.dataclass(frozen=True)
class BodyEstimate:
    """
    Parameters of B bodies: links that are fixed to each other are one, in its joint's frame.

    A motion shows fewer combinations than there are parameters. `information` is 0 along what it
    does not show, and `value` is `prior` there.

    Attributes
    ----------
    names : tuple of str, length B
        Of the heaviest link of each body.
    prior, value : ndarray, shape (B, 10)
        `PARAMETERS` of the model, and those that fit the motion best; nothing makes these belong
        to a body.
    information : ndarray, shape (10 B, 10 B)
        Normal matrix of the parameters, row by row, without what friction explains: with the
        parameters x, twice the logarithm of the likelihood ratio is
        (x - value)ᵀ information (x - value). [1/(kg, kg·m, kg·m²)²]

    """

    names: tuple[str, ...]
    prior: Array
    value: Array
    information: Array
