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

"""
A learned correction in a file.

It is kept there between runs. `ctc learn` writes it, and the parameter ``learning_file`` of the
reference names it. Beside the correction it has the motion, robot and law for which it was
learned, and is refused for others. It is in NumPy's format, and holds no pickled objects, so that
reading it runs no code.
"""

from __future__ import annotations

from hashlib import sha256
from io import BytesIO
import json
import os
from pathlib import Path
from typing import Any
from zipfile import ZipFile

from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.errors import CtcError, prefixed
from ctc_chattering.input_files import LARGEST, read_bytes
from ctc_chattering.learning.motion import RepeatedMotion
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.numerics.time_grid import period_ns
from ctc_chattering.output_files import check_file, write_bytes
from ctc_chattering.trajectory.reference import ReferenceConfig
import numpy as np

#: Limits of the controller, which do not act in ordinary passes.
LIMITS = {'effort_limit', 'effort_rate_limit', 'anti_windup', 'error_limit'}
#: Parameters of the controller that may differ, since they do not change the errors of a pass:
#: limits, rate of the reports, machine code, path of the description (its text is compared), and
#: resonance, which only designs use.
_WITHOUT_INFLUENCE = LIMITS | {'state_decimation', 'compiled', 'description', 'resonance'}
#: Part of the learning bound by which rounding may exceed it.
_ROUNDING = 1e-9


def read_correction(path: Path, motion: RepeatedMotion, reference: ReferenceConfig,
                    controller: ControllerConfig | None, description: str) -> Array:
    """
    Return a file's correction, shape (N, n) [rad].

    Parameters
    ----------
    path : Path
        The file.
    motion : RepeatedMotion
        The present motion.
    reference : ReferenceConfig
        Joints, period and bound.
    controller : ControllerConfig or None
        None while it is not known: law and robot are then not compared.
    description : str
        Text of the controller's description of the robot, '' for none.

    Raises
    ------
    CtcError
        If there is no such file, it is no learned file, or was learned for another motion, robot
        or law, or is beyond the bound.

    """
    if not os.path.lexists(path):
        raise CtcError(f'{path}: there is no such file; make it with: ctc learn BAG --out {path}')
    learned, rows = _load(path)
    for name, value in _describe(motion, reference, controller, description).items():
        if learned.get(name) != value:
            difference = f'another {name}' if name in ('motion', 'robot') else (
                f'{name} {learned.get(name)!r:.100}, and now it is {value!r}')
            raise CtcError(f'{path}: was learned for {difference}; make it anew from a bag of '
                           'this setup: ctc learn BAG')
    shape = motion.duration // period_ns(reference.control_period), len(reference.joint_names)
    bound = reference.learning_bound
    if rows.dtype != float or rows.shape != shape or not (
            np.abs(rows) <= bound * (1.0 + _ROUNDING)).all():
        raise CtcError(f'{path}: the correction must be {shape[0]} x {shape[1]} numbers within '
                       f'learning_bound, {bound:g} rad')
    return rows


def write_correction(path: Path, rows: Array, motion: RepeatedMotion, reference: ReferenceConfig,
                     controller: ControllerConfig, description: str) -> None:
    """
    Write a correction, shape (N, n) [rad].

    With it is written what `read_correction` compares.
    """
    learned = json.dumps(_describe(motion, reference, controller, description))
    content = BytesIO()
    np.savez_compressed(content, rows=rows, learned=learned)
    write_bytes(path, content.getvalue())


def check_replaceable(path: Path, overwrite: bool) -> None:
    """
    Raise `CtcError` if a file must not be replaced.

    Only a learned file is replaced, if `overwrite` allows it.
    """
    check_file(path, overwrite)
    if os.path.lexists(path):
        with prefixed('not overwritten: '):
            _load(path)


def _load(path: Path) -> tuple[dict[str, Any], Array]:
    """
    Return what a file was learned for, and its correction.

    Other files raise `CtcError`.
    """
    content = BytesIO(read_bytes(path))
    try:
        with ZipFile(content) as archive:
            size = sum(member.file_size for member in archive.infolist())
        if size <= LARGEST:
            with np.load(content) as arrays:
                return dict(json.loads(str(arrays['learned']))), arrays['rows']
    except Exception:  # Of arbitrary bytes, decoders raise arbitrary exceptions.
        pass
    raise CtcError(f'{path}: is damaged, or no file of ctc learn')


def _describe(motion: RepeatedMotion, reference: ReferenceConfig,
              controller: ControllerConfig | None, description: str) -> dict[str, Any]:
    """Return motion, robot and law as JSON values."""
    values: dict[str, Any] = {'motion': motion.name, 'joints': reference.joint_names}
    if controller is not None:
        values['robot'] = sha256(description.encode()).hexdigest()
        values |= {name: value for name, value in controller.as_mapping().items()
                   if name not in _WITHOUT_INFLUENCE and controller.takes(name)}
    described: dict[str, Any] = json.loads(json.dumps(values))
    return described
