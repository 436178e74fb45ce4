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
A control law for one robot as a C library: object code, a header, and its numbers.

Machine code works on records and arrays by their addresses. In C they are one block of memory,
`ctc_law`, whose content at the start `Block` collects, with the pointers within it. The rest is
text: `templates/ctc_law.c` copies the content, sets the pointers, and calls the code.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
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
#: What compiled code calls, by its name in C.
_FUNCTIONS = {function: name for functions in ARM_FUNCTIONS.values()
              for function, name in zip(functions, ('ctc_dynamics', 'ctc_mass'))}
#: Parts of the block are words of so many bytes.
_WORD = 8
#: What `ctc_set_gains` takes, and its function.
_GAINS, _SET = ('kp', 'kv', 'ka'), 'ctc_gains'


class Block:
    """
    The block of memory on which machine code works, in words of 8 bytes.

    Attributes
    ----------
    words : list of int
        Content at the start.
    pointers, calls : list of tuple
        Where there is a pointer within the block, and to where; where there is the address of a
        function, and its name.

    """

    def __init__(self) -> None:
        self.words: list[int] = []
        self.pointers: list[tuple[int, int]] = []
        self.calls: list[tuple[int, str]] = []
        self._at: dict[int, int] = {}

    def at(self, part: Any, *fields: str) -> int:
        """
        Return where a record or array is in the block; the first time, it is added.

        Parameters
        ----------
        part : NumPy record or array
            Which one.
        *fields : str
            A field of it, a field of that one, and so on, which then is what is sought.

        """
        memory: Any = next(argument_memory(part))
        if memory.ctypes.data not in self._at:
            self._at[memory.ctypes.data] = len(self.words)
            content = memory.tobytes() + bytes(-memory.nbytes % _WORD)
            self.words += np.frombuffer(content, np.uint64).tolist()
        found, kind = self._at[memory.ctypes.data], part.dtype
        for name in fields:
            kind, offset = kind.fields[name][:2]
            found += offset // _WORD
        return found

    def add(self, arguments: tuple[Any, ...], addresses: Any) -> int:
        """Add arguments of a function, and their addresses; return where these are."""
        targets = [x if x is None else self.at(x) for x in argument_memory(arguments)]
        start = self.at(addresses)
        self.pointers += [(k, x) for k, x in enumerate(targets, start) if x is not None]
        return start


def step_of(config: ControllerConfig, model: Model) -> CompiledStep:
    """Return the step of a law at the start; raise `CtcError` where C cannot have it."""
    controller = Controller(config.changed({'compiled': True}), model)
    step = controller.compiled_step()
    if step is None:
        raise CtcError(f'model {config.model} with law {config.law} cannot be exported; allowed: '
                       'models two_link and urdf, laws of marked records')
    settings = controller.settings
    if any(np.count_nonzero(x) > model.n for x in (settings.kp, settings.kv)):
        raise CtcError('kp, kv: a full matrix cannot be exported; allowed: one per joint')
    return step


def takes_gains(step: CompiledStep, config: ControllerConfig, model: Model) -> bool:
    """Return whether `apply_gains` gives what a controller with other gains is made of."""
    joints = np.arange(1.0, model.n + 1.0)
    gains = {name: k * joints for k, name in enumerate(_GAINS, 3)}
    other, now = Controller(config.changed(gains), model), load(step.code.arguments[0].law)
    law = now.with_gains(other.settings.kp, other.settings.kv, gains['ka'])
    return all(packed(a).tobytes() == packed(b).tobytes() for a, b in (
        (law, other.law), (law.reconfigured(now.initial()), other.memories.law)))


def block_of(step: CompiledStep, gains: Code) -> tuple[Block, dict[str, int]]:
    """
    Return the memory of a step that has not been called, and of `apply_gains`.

    With it where steps read and write, by the names in ``ctc_law.c``; 0 for what a law lacks.
    """
    block, (records, points) = Block(), step.code.arguments
    settings, memories = records.settings, records.memories
    observes = 'oscillation' in memories.dtype['law'].names
    named = {
        'PLACES': block.add(step.code.arguments, step.code.addresses),
        'GAIN_PLACES': block.add(gains.arguments, gains.addresses),
        'MEMORIES': block.at(memories), 'MEASURED': block.at(records.measured),
        'REFERENCE': block.at(points), 'MADE': block.at(records.result),
        'MASS_MATRIX': block.at(records.now, 'M'), 'KP': block.at(settings, 'kp'),
        'KV': block.at(settings, 'kv'), 'KA': block.at(gains.arguments[1]),
        **{name.upper(): block.at(memories, 'law', 'oscillation', name) if observes else 0
           for name in ('strained', 'cycling')}}
    for record, code, arguments, places in step.arm.calls:
        block.pointers.append((block.at(record, 'arguments'), block.add(arguments, places)))
        block.calls.append((block.at(record, 'function'), _FUNCTIONS[code.function]))
    for at, _ in (*block.pointers, *block.calls):
        block.words[at] = 0
    return block, named


def check_package(name: str) -> None:
    """Raise `UsageError` unless a ROS package with a controller can have this name."""
    if not re.fullmatch('[a-z][a-z0-9_]*', name):
        raise UsageError(f'--ros2-control {name}: not allowed; allowed: small letters, digits '
                         'and _, as of ROS packages')
    description = (_TEMPLATES / 'ros2_control' / 'package.xml').read_text(encoding='utf-8')
    if name in re.findall(r'depend>(\w+)<', description):
        raise UsageError(f'--ros2-control {name}: not allowed: the controller needs the package '
                         'of this name')


def c_string(text: str) -> str:
    """Return a literal of C and C++ for text in UTF-8; two question marks are no trigraph."""
    content = text.encode('utf-8', 'surrogatepass').decode('latin-1')
    return '"' + re.sub(r'[^ -~]|["\\?]', lambda x: f'\\{ord(x[0]):03o}', content) + '"'


def export(config: ControllerConfig, model: Model, out: Path, processor: str = 'host',
           package: str = '', overwrite: bool = False) -> int:
    """
    Write the library of one robot; return the size of its code.

    Parameters
    ----------
    config : ControllerConfig
        Law and gains.
    model : Model
        Of the robot.
    out : Path
        Directory to make.
    processor : str
        As `object_file` takes it.
    package : str
        Name of an ament_cmake package with a controller of ros2_control, which then is in `out`,
        and the library in its folder ``ctc_law``; empty for the library alone.
    overwrite : bool
        Replace what an earlier call has written there.

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
    step = step_of(config, model)
    gains = Code(apply_gains, (step.code.arguments[0], np.array(config.ka)), 'gains')
    codes = {'ctc_control': step.code, **{
        _FUNCTIONS[x.code.function]: x.code for x in step.arm.calls}}
    if takes_gains(step, config, model):
        codes[_SET] = gains
    code, text = object_file(codes, processor)
    block, named = block_of(step, gains)
    continuous = config.which_are_continuous(model.continuous)
    values = {**_values(config, load(step.code.arguments[0].settings)), 'PACKAGE': package,
              'CONTINUOUS': ', '.join(str(int(x)) for x in continuous),
              'BRAKING_TIME': BRAKING_TIME,
              'DATA': _data(block, named, list(codes), config), 'WORDS': len(block.words)}
    with new_folder(out, EXPORT, overwrite) as folder:
        library = folder / 'ctc_law' if package else folder
        _write(_TEMPLATES, library, values)
        if package:
            _write(_TEMPLATES / 'ros2_control', folder, values)
        write_bytes(library / 'ctc_law_code.o', code)
        write_text(library / 'ctc_law_code.ll', text)
    return len(code)


def _write(templates: Path, out: Path, values: Mapping[str, object]) -> None:
    """Write the files of templates with values in the place of ``@NAME@``."""
    for path in filter(Path.is_file, templates.iterdir()):
        write_text(out / path.name, re.sub(
            '@([A-Z0-9_]+)@', lambda x: str(values[x[1]]), path.read_text(encoding='utf-8')))


def _values(config: ControllerConfig, settings: ControlSettings) -> dict[str, object]:
    """Return what the header says of a law."""
    gains: tuple[Any, ...] = settings.kp.diagonal(), settings.kv.diagonal(), config.ka
    return {'LAW': config.law, 'JOINTS': len(config.joint_names),
            'JOINT_NAMES': ', '.join(map(c_string, config.joint_names)),
            'DELAY': config.input_delay, 'PERIOD': config.control_period,
            'PERIOD_NS': period_ns(config.control_period),
            'RATE': f'{1.0 / config.control_period:g}',
            'GROWTH': TRIP_LIMITS.growth, 'PATIENCE': TRIP_LIMITS.strained,
            'CYCLE': TRIP_LIMITS.cycling,
            'MARGIN': LIMITS.margin,
            'LEAST': LEAST, 'LARGEST': LARGEST,
            **{name.upper(): ', '.join(map(repr, map(float, x)))
               for name, x in zip(_GAINS, gains)}}


def _data(block: Block, named: dict[str, int], functions: Sequence[str],
          config: ControllerConfig) -> str:
    """Return the numbers of a law in C."""
    constants = named | {
        'WATCHED': int(law_class(config.law).is_watched), 'LARGEST_GROWTH': TRIP_LIMITS.growth,
        'PATIENCE': TRIP_LIMITS.strained, 'LONGEST_CYCLE': TRIP_LIMITS.cycling,
        'POSITION_MARGIN': LIMITS.margin,
        'LARGEST_ACCELERATION': LIMITS.acceleration,
        'GAINS_FUNCTION': _SET if _SET in functions else 'NULL'}
    bounds = [config.parameters()[name].bounds for name in _GAINS]
    tables = {
        'uint64_t content[]': [f'{x:#x}' for x in block.words],
        'double bounds[3][2]': [f'{{{low}, {high}}}' for low, high in bounds],
        'double error_limit[CTC_JOINTS]': [
            'INFINITY' if isinf(x) else repr(x) for x in config.error_limit],
        'struct { uint32_t at, to; } pointers[]': [f'{{{a}, {b}}}' for a, b in block.pointers],
        'struct { uint32_t at; code *function; } calls[]': [
            f'{{{at}, {name}}}' for at, name in block.calls]}
    lines = [f'#define {name} {value}' for name, value in constants.items()]
    lines += [f'code {name};' for name in functions]
    lines += [f'static const {head} = {{{", ".join(rows)}}};' for head, rows in tables.items()]
    return '\n'.join(line for text in lines for line in textwrap.wrap(text, 99))
