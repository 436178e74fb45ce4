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
Export of a law for one robot to C.

`ctc export-c` calls `export`. The library has object code, a header, and the numbers of the law.
Machine code takes records and arrays by their addresses. In C all of them lie in one block of
memory, `ctc_law`. `MemoryBlock` collects its content at the start, and the pointers within it. The
C code itself is text in `templates`: `ctc_law.c` copies the content, sets the pointers, and calls
the machine code.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from math import isinf
from pathlib import Path
import re
import textwrap
from typing import Any

from ctc_chattering.compiled.machine_code import argument_memory, Code
from ctc_chattering.compiled.records import load, packed
from ctc_chattering.control.compiled_step import apply_gains, CompiledStep
from ctc_chattering.control.controller import Controller, ControllerConfig
from ctc_chattering.control.laws.registry import law_class
from ctc_chattering.control.settings import ControlSettings
from ctc_chattering.controller.positions import LIMITS
from ctc_chattering.controller.trips import TRIP_LIMITS
from ctc_chattering.dynamics.compiled_model import ARM_FUNCTIONS
from ctc_chattering.dynamics.model import Model
from ctc_chattering.errors import CtcError, UsageError
from ctc_chattering.numerics.time_grid import period_ns
from ctc_chattering.output_files import write_bytes, write_text
from ctc_chattering.output_folder import new_folder
from ctc_chattering.parameters import LARGEST, LEAST
from ctc_chattering.trajectory.transitions import BRAKING_TIME
import numpy as np

_TEMPLATES = Path(__file__).with_name('templates')
#: The command that writes a library.
EXPORT = 'ctc export-c'
#: Functions of the model that compiled code calls, with their names in C.
_FUNCTIONS = {function: name for functions in ARM_FUNCTIONS.values()
              for function, name in zip(functions, ('ctc_dynamics', 'ctc_mass'))}
#: Gains that `ctc_set_gains` takes.
_GAINS = ('kp', 'kv', 'ka')
#: Name in C of the compiled `apply_gains`.
_GAINS_FUNCTION = 'ctc_gains'
_WORD_BYTES = 8


class MemoryBlock:
    """
    Block of memory on which machine code works, in words of 8 bytes.

    Attributes
    ----------
    words : list of int
        Content at the start.
    pointers : list of (int, int)
        Positions of a word and of the word whose address it holds.
    calls : list of (int, str)
        Position of a word, and name of the function whose address it holds.

    """

    def __init__(self) -> None:
        self.words: list[int] = []
        self.pointers: list[tuple[int, int]] = []
        self.calls: list[tuple[int, str]] = []
        self._positions: dict[int, int] = {}

    def position(self, data: Any, *fields: str) -> int:
        """
        Return the position of a record or array, which is added the first time.

        Parameters
        ----------
        data : NumPy record or array
            Part of the memory.
        *fields : str
            Path to a field of the record, whose position is then returned.

        """
        memory: Any = next(argument_memory(data))
        address = memory.ctypes.data
        if address not in self._positions:
            self._positions[address] = len(self.words)
            content = memory.tobytes() + bytes(-memory.nbytes % _WORD_BYTES)
            self.words += np.frombuffer(content, np.uint64).tolist()
        position, dtype = self._positions[address], data.dtype
        for name in fields:
            dtype, offset = dtype.fields[name][:2]
            position += offset // _WORD_BYTES
        return position

    def add_call(self, arguments: tuple[Any, ...], addresses: Any) -> int:
        """
        Add the arguments of a function, and the array of their addresses.

        The position of this array is returned.
        """
        targets = [x if x is None else self.position(x) for x in argument_memory(arguments)]
        start = self.position(addresses)
        self.pointers += [(k, x) for k, x in enumerate(targets, start) if x is not None]
        return start


def compile_law(config: ControllerConfig, model: Model) -> CompiledStep:
    """
    Return the compiled step of a new controller.

    `CtcError` is raised if the law cannot be exported.
    """
    controller = Controller(config.changed({'compiled': True}), model)
    step = controller.compiled_step()
    if step is None:
        raise CtcError(f'model {config.model} with law {config.law} cannot be exported; allowed: '
                       'models two_link and urdf, laws made of marked records')
    settings = controller.settings
    if any(np.count_nonzero(x) > model.n for x in (settings.kp, settings.kv)):
        raise CtcError('kp, kv: a full matrix cannot be exported; allowed: one value per joint')
    return step


def gains_are_separable(step: CompiledStep, config: ControllerConfig, model: Model) -> bool:
    """Return whether `apply_gains` equals the construction with other gains."""
    joints = np.arange(1.0, model.n + 1.0)
    gains = {name: k * joints for k, name in enumerate(_GAINS, 3)}
    expected = Controller(config.changed(gains), model)
    present = load(step.code.arguments[0].law)
    law = present.with_gains(expected.settings.kp, expected.settings.kv, gains['ka'])
    return all(packed(a).tobytes() == packed(b).tobytes() for a, b in (
        (law, expected.law), (law.reconfigured(present.initial()), expected.memories.law)))


def check_package(name: str) -> None:
    """Raise `UsageError` unless a ROS package with a controller can have this name."""
    if not re.fullmatch('[a-z][a-z0-9_]*', name):
        raise UsageError(f'--ros2-control {name}: this is not a name of a ROS package; allowed: '
                         'small letters, digits and _, beginning with a letter')
    description = (_TEMPLATES / 'ros2_control' / 'package.xml').read_text(encoding='utf-8')
    if name in re.findall(r'depend>(\w+)<', description):
        raise UsageError(f'--ros2-control {name}: the controller needs the package of this name; '
                         'choose another name')


def c_string(text: str) -> str:
    """
    Return a literal of C and C++ for text in UTF-8.

    Two question marks are escaped, since they may begin a trigraph.
    """
    content = text.encode('utf-8', 'surrogatepass').decode('latin-1')
    return '"' + re.sub(r'[^ -~]|["\\?]', lambda x: f'\\{ord(x[0]):03o}', content) + '"'


def export(config: ControllerConfig, model: Model, out: Path, processor: str = 'host',
           package: str = '', overwrite: bool = False) -> int:
    """
    Write the library of one robot, and return the size of its code.

    Parameters
    ----------
    config : ControllerConfig
        Law and gains.
    model : Model
        Model of the robot.
    out : Path
        Directory to make.
    processor : str
        As `object_file` takes it.
    package : str
        Name of an ament_cmake package with a ros2_control controller in `out`. The library is then
        in its folder ``ctc_law``. Empty for the library alone.
    overwrite : bool
        Replace the files that an earlier call has written there.

    Raises
    ------
    CtcError
        If the law cannot be exported for this robot, other files are there, or one cannot be
        written.

    """
    if package:
        check_package(package)
    from ctc_chattering.compiled.object_file import check_processor, object_file
    check_processor(processor)
    step = compile_law(config, model)
    gains = Code(apply_gains, (step.code.arguments[0], np.array(config.ka)), 'gains')
    codes = {'ctc_control': step.code}
    codes |= {_FUNCTIONS[x.code.function]: x.code for x in step.arm.calls}
    if gains_are_separable(step, config, model):
        codes[_GAINS_FUNCTION] = gains
    code, assembly = object_file(codes, processor)
    values = {
        'PACKAGE': package,
        'CONTINUOUS': _listed(map(int, config.which_are_continuous(model.continuous))),
        'FUNCTIONS': ''.join(f'code {name};\n' for name in codes),
        'GAINS_FUNCTION': _GAINS_FUNCTION if _GAINS_FUNCTION in codes else 'NULL',
        **_settings(config, load(step.code.arguments[0].settings)),
        **_memory(step, gains)}
    with new_folder(out, EXPORT, overwrite) as folder:
        library = folder / 'ctc_law' if package else folder
        _write(_TEMPLATES, library, values)
        if package:
            _write(_TEMPLATES / 'ros2_control', folder, values)
        write_bytes(library / 'ctc_law_code.o', code)
        write_text(library / 'ctc_law_code.ll', assembly)
    return len(code)


def _write(templates: Path, out: Path, values: Mapping[str, object]) -> None:
    """Write the files of templates, with values instead of ``@NAME@``."""
    for path in filter(Path.is_file, templates.iterdir()):
        write_text(out / path.name, re.sub(
            '@([A-Z0-9_]+)@', lambda x: str(values[x[1]]), path.read_text(encoding='utf-8')))


def _listed(items: Iterable[object]) -> str:
    """Return the items of an array in C."""
    return ', '.join(map(str, items))


def _settings(config: ControllerConfig, settings: ControlSettings) -> dict[str, object]:
    """Return values of the templates from configuration and limits."""
    bounds = [config.parameters()[name].bounds for name in _GAINS]
    return {
        'LAW': config.law, 'JOINTS': len(config.joint_names),
        'JOINT_NAMES': _listed(map(c_string, config.joint_names)),
        'DELAY': config.input_delay, 'PERIOD': config.control_period,
        'PERIOD_NS': period_ns(config.control_period),
        'RATE': f'{1.0 / config.control_period:g}',
        'WATCHED': int(law_class(config.law).is_watched), 'GROWTH': TRIP_LIMITS.growth,
        'MAX_STRAINED_S': TRIP_LIMITS.strained, 'MAX_CYCLING_S': TRIP_LIMITS.cycling,
        'MARGIN': LIMITS.margin, 'ACCELERATION': LIMITS.acceleration,
        'BRAKING_TIME': BRAKING_TIME, 'LEAST': LEAST, 'LARGEST': LARGEST,
        'KP': _listed(settings.kp.diagonal().tolist()),
        'KV': _listed(settings.kv.diagonal().tolist()), 'KA': _listed(config.ka),
        'BOUNDS': _listed(f'{{{low}, {high}}}' for low, high in bounds),
        'ERROR_LIMIT': _listed('INFINITY' if isinf(x) else x for x in config.error_limit)}


def _memory(step: CompiledStep, gains: Code) -> dict[str, object]:
    """Return values of the templates for the memory of the functions."""
    block, (records, points) = MemoryBlock(), step.code.arguments
    memories, settings = records.memories, records.settings
    values: dict[str, object] = {
        'STEP_ADDRESSES': block.add_call(step.code.arguments, step.code.addresses),
        'GAIN_ADDRESSES': block.add_call(gains.arguments, gains.addresses),
        'MEMORIES': block.position(memories), 'MEASURED': block.position(records.measured),
        'REFERENCE': block.position(points), 'TERMS': block.position(records.result),
        'MASS_MATRIX': block.position(records.now, 'M'),
        'KP_POSITION': block.position(settings, 'kp'),
        'KV_POSITION': block.position(settings, 'kv'),
        'KA_POSITION': block.position(gains.arguments[1])}
    observes_oscillation = 'oscillation' in memories.dtype['law'].names
    for name in ('strained', 'cycling'):
        values[name.upper()] = block.position(
            memories, 'law', 'oscillation', name) if observes_oscillation else 0
    for record, code, arguments, addresses in step.arm.calls:
        pointer = block.position(record, 'arguments')
        block.pointers.append((pointer, block.add_call(arguments, addresses)))
        block.calls.append((block.position(record, 'function'), _FUNCTIONS[code.function]))
    for position, _ in (*block.pointers, *block.calls):
        block.words[position] = 0
    pointers = _listed(f'{{{a}, {b}}}' for a, b in block.pointers)
    values['POINTERS'] = textwrap.fill(pointers, 99)
    values['CALLS'] = _listed(f'{{{position}, {name}}}' for position, name in block.calls)
    values['WORDS'] = len(block.words)
    values['CONTENT'] = textwrap.fill(_listed(map(hex, block.words)), 99)
    return values
