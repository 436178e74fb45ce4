"""The models that the parameter ``model`` can name."""

from __future__ import annotations

from ctc_chattering.core.model import Model
from ctc_chattering.core.two_link import TwoLink
from ctc_chattering.errors import ParameterError

#: Values of the parameter ``model``.
MODELS = ('two_link',)


def make_model(name: str, gravity: float) -> Model:
    """Return the model called `name`, under `gravity` [m/s²]."""
    if name != 'two_link':
        raise ParameterError('model', name, ' | '.join(MODELS))
    return TwoLink(gravity)


def check_model(name: str, joint_names: tuple[str, ...]) -> None:
    """Raise `ParameterError` unless the model has as many joints as there are names."""
    if name == 'two_link' and len(joint_names) != TwoLink.n:
        raise ParameterError('joint_names', joint_names, f'{TwoLink.n} names for model {name}')
