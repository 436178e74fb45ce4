# Copyright 2026 The ctc_chattering maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""The corrected URDF, and the identification with it."""

from __future__ import annotations

from collections.abc import Mapping
import dataclasses
import re

from ctc_chattering.dynamics.corrected_urdf import corrected_urdf
from ctc_chattering.identification.regression.causes import CauseKind
from ctc_chattering.identification.regression.finding import ALL_JOINTS, Finding, Severity
from ctc_chattering.identification.regression.identify import Identification
from ctc_chattering.identification.regression.least_squares import BENT, TermKind
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np

#: By how much the corrected model may explain the torque of a joint worse.
_WORSE = 1.02
#: Part of its friction by which it may be worse in any case.
_TRIFLE = 0.002
#: Torque scale that is one, and no trifle.
_SCALE = 0.003
#: Part of a joint's torque, with friction, below which a correction is none.
_LEAST = 0.01
#: Of causes that the data do not tell apart; the torque of the corrected model has them all.
_AMBIGUOUS = 'explained as well by'


def corrected_description(found: Identification, description: str,
                          locked: Mapping[str, float] | None = None) -> str:
    """
    Return the corrected URDF; empty where the model is right, or something is refused.

    Parameters
    ----------
    found : Identification
        With the bodies that fit.
    description : str
        The URDF of the model; empty for another model.
    locked : mapping of str to float, optional
        As the model has it.

    """
    bodies = found.bodies
    if not description or bodies is None or not bodies.differ or any(
            x.severity == Severity.REFUSED for x in found.findings):
        return ''
    size = bodies.torque(bodies.found - bodies.estimate.known)
    whole = bodies.torque(bodies.found) + [abs(x.coulomb.value or 0.0) for x in found.friction]
    # On data that it was not fitted to, it must be better, and on no joint worse.
    held_out = found.held_out
    if not (size > _LEAST * whole).any() or not len(held_out) or (
            held_out > _WORSE).any() or _scale_in_doubt(found):
        return ''
    return corrected_urdf(description, found.joints, bodies.parameters, bodies.rotor.tolist(),
                          bodies.tilt.tolist(), locked)


def _scale_in_doubt(found: Identification) -> bool:
    """Return whether a torque scale explains as much as what is in the bodies."""
    chosen = found.selected.explanation
    mine = [] if chosen is None else chosen.causes
    return any(cause.kind == CauseKind.SCALE and abs(value[0]) > _SCALE and not any(
        cause is x for x in mine) for other in found.selected.alike
        for cause, value in zip(other.causes, other.values))


def with_correction(before: Identification, after: Identification, name: str
                    ) -> Identification | None:
    """
    Return the identification with a corrected model, with what was wrong; None if it is no better.

    Parameters
    ----------
    before, after : Identification
        With the model as it was, and corrected.
    name : str
        Of the file that has the correction.

    """
    friction = _friction(after)
    was, now = (np.sqrt(np.square(np.where(x.data.used(), x.data.residual - friction, 0.0)).sum(
        axis=0)) for x in (before, after))
    refused = any(x.severity == Severity.REFUSED for x in after.findings)
    size = np.sqrt(np.square(np.where(after.data.used(), friction, 0.0)).sum(axis=0))
    if refused or ((now > _WORSE * was) & (now - was > _TRIFLE * size)).any():
        return None
    still = {_words(x) for x in after.findings}
    cured = [Finding(Severity.NOTE, x.joint, f'with the URDF as it was: {x.reason}')
             for x in before.findings if _words(x) not in still and _AMBIGUOUS not in x.reason]
    assert before.bodies is not None
    change = before.bodies.torque(before.bodies.found - before.bodies.estimate.known)
    text = ', '.join(f'{x:.2g}' for x in change)
    return dataclasses.replace(
        after, errors=before.errors, rotor=before.rotor, tilt=before.tilt, bodies=before.bodies,
        findings=(*after.findings, Finding(
            Severity.NOTE, ALL_JOINTS, f'the URDF is corrected in {name}, which changes the '
            f'torque by {text} N*m RMS in this motion'), *cured))


def _friction(found: Identification) -> Array:
    """Return the friction as identified in each window, shape (J, n) [N·m]."""
    fit = found.selected.fit
    mine = [k for k, term in enumerate(fit.terms)
            if term.kind not in (TermKind.MODEL, TermKind.SCALE, *BENT)]
    torque: Array = found.data.columns(fit.terms)[:, :, mine] @ fit.value[mine]
    return torque


def _words(finding: Finding) -> tuple[int, str]:
    """Return what a finding says, without its numbers."""
    return finding.joint, re.sub(r'[-+]?[\d.]+(e[-+]?\d+)?', '', finding.reason)
