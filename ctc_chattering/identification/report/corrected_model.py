"""The corrected URDF, and the identification with it."""

from __future__ import annotations

from collections.abc import Mapping
import dataclasses
import re

from ctc_chattering.dynamics.corrected_urdf import corrected_urdf
from ctc_chattering.identification.regression.causes import CauseKind
from ctc_chattering.identification.regression.finding import ALL_JOINTS, Finding, Severity
from ctc_chattering.identification.regression.identify import Identification
import numpy as np

#: By how much the corrected model may explain the torque of a joint worse.
_WORSE = 1.02
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
    was, now = (np.sqrt(np.square(np.where(x.data.used(), x.data.residual, 0.0)).sum(axis=0))
                for x in (before, after))
    refused = any(x.severity == Severity.REFUSED for x in after.findings)
    if refused or (now > _WORSE * was).any():
        return None
    still = {_words(x) for x in after.findings}
    cured = [Finding(Severity.NOTE, x.joint, f'with the URDF as it was: {x.reason}')
             for x in before.findings if _words(x) not in still and _AMBIGUOUS not in x.reason]
    assert before.bodies is not None
    change = before.bodies.torque(before.bodies.found - before.bodies.estimate.known)
    size = ', '.join(f'{x:.2g}' for x in change)
    return dataclasses.replace(
        after, errors=before.errors, rotor=before.rotor, tilt=before.tilt, bodies=before.bodies,
        findings=(*after.findings, Finding(
            Severity.NOTE, ALL_JOINTS, f'the URDF is corrected in {name}, which changes the '
            f'torque by {size} N*m RMS in this motion'), *cured))


def _words(finding: Finding) -> tuple[int, str]:
    """Return what a finding says, without its numbers."""
    return finding.joint, re.sub(r'[-+]?[\d.]+(e[-+]?\d+)?', '', finding.reason)
