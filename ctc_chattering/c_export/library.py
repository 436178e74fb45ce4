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
import json
from math import isinf
from pathlib import Path
import re
import textwrap
from typing import Any, NamedTuple

from ctc_chattering.analysis.output import write_text, writing
from ctc_chattering.compiled.machine_code import Code, memory_of
from ctc_chattering.compiled.records import load, packed
from ctc_chattering.control.controller import Controller, ControllerConfig
from ctc_chattering.control.step import CompiledStep, ControlSettings, regained
from ctc_chattering.controller.trips import LARGEST_GROWTH, PATIENCE, WATCHED
from ctc_chattering.dynamics.compiled_model import set_mass_and_bias, set_terms
from ctc_chattering.dynamics.model import Model
from ctc_chattering.errors import CtcError, UsageError
from ctc_chattering.numerics.time_grid import period_ns
from ctc_chattering.parameters import LARGEST, LEAST
import numpy as np

_TEMPLATES = Path(__file__).with_name('templates')
#: What compiled code calls, by its name in C.
_FUNCTIONS = {set_terms: 'ctc_dynamics', set_mass_and_bias: 'ctc_mass'}
#: Parts of the block are words of so many bytes.
_WORD = 8
#: What `ctc_set_gains` takes, and its function.
_GAINS, _SET = ('kp', 'kv', 'ka'), 'ctc_gains'


class Block:
    """
    Content of the block of memory on which machine code works.

    Attributes
    ----------
    content : bytearray
        As it is at the start; 0 where a pointer is.
    pointers : list of (int, int)
        Where there is a pointer within the block, and to where [bytes].

    """

    def __init__(self) -> None:
        self.content = bytearray()
        self.pointers: list[tuple[int, int]] = []
        self._at: dict[int, int] = {}

    def at(self, part: Any) -> int:
        """Return where a record or array is in the block [bytes]; the first time, it is added."""
        memory: Any = next(memory_of(part))
        if memory.ctypes.data not in self._at:
            self._at[memory.ctypes.data] = len(self.content)
            self.content += memory.tobytes() + bytes(-memory.nbytes % _WORD)
        return self._at[memory.ctypes.data]

    def add(self, arguments: tuple[Any, ...], places: Any) -> int:
        """Add arguments of a function, and their places; return where these are [bytes]."""
        targets = [x if x is None else self.at(x) for x in memory_of(arguments)]
        start = self.at(places)
        for k, target in enumerate(targets):
            if target is not None:
                self.set_pointer(start + _WORD * k, target)
        return start

    def set_pointer(self, at: int, target: int) -> None:
        """Have a pointer to `target` at a place [bytes]."""
        self.content[at:at + _WORD] = bytes(_WORD)
        self.pointers.append((at, target))


class Image(NamedTuple):
    """
    A law as the block of memory is at the start; all places are in words of 8 bytes.

    Attributes
    ----------
    content : bytes
        Numbers of the law, and what is remembered.
    pointers, calls : list of tuple
        Where there is a pointer, and to where; where there is the address of a function, and its
        name.
    named : dict of str to int
        Where steps read and write, by the names in ``ctc_law.c``.

    """

    content: bytes
    pointers: list[tuple[int, int]]
    calls: list[tuple[int, str]]
    named: dict[str, int]


def step_of(config: ControllerConfig, model: Model) -> CompiledStep:
    """Return the step of a law at the start; raise `CtcError` where C cannot have it."""
    controller = Controller(config.changed({'compiled': True}), model)
    step = controller.compiled_step()
    if step is None:
        raise CtcError(f'model {config.model} with law {config.law} cannot be exported; allowed: '
                       'models two_link and urdf, laws of marked records')
    for name, x in (('kp', controller.settings.kp), ('kv', controller.settings.kv)):
        if np.count_nonzero(x) > model.n:
            raise CtcError(f'{name}: a full matrix cannot be exported; allowed: one per joint')
    return step


def takes_gains(step: CompiledStep, config: ControllerConfig, model: Model) -> bool:
    """Return whether `regained` gives what a controller with other gains is made of."""
    joints = np.arange(1.0, model.n + 1.0)
    gains = {name: k * joints for k, name in enumerate(_GAINS, 3)}
    other, now = Controller(config.changed(gains), model), load(step.code.arguments[0].law)
    law = now.with_gains(other.settings.kp, other.settings.kv, gains['ka'])
    return all(packed(a).tobytes() == packed(b).tobytes() for a, b in (
        (law, other.law), (law.reconfigured(now.initial()), other.memories.law)))


def image_of(step: CompiledStep, gains: Code) -> Image:
    """Return the block of memory of a step that has not been called, and of `regained`."""
    block, (records, points) = Block(), step.code.arguments
    places = block.add(step.code.arguments, step.code.places)
    calls = []
    for record, code, arguments, places_there in step.arm.calls:
        target, at = block.add(arguments, places_there), block.at(record)
        block.set_pointer(at + _offset(record, 'places'), target)
        calls.append(((at + _offset(record, 'function')) // _WORD, _FUNCTIONS[code.function]))
    for at, _ in calls:
        block.content[_WORD * at:_WORD * (at + 1)] = bytes(_WORD)
    settings = block.at(records.settings)
    strained = (block.at(records.memories) + _offset(
        records.memories, 'law', 'oscillation', 'strained')
        if 'oscillation' in records.memories.dtype['law'].names else 0)
    named = {'PLACES': places, 'MEASURED': block.at(records.measured), 'STRAINED': strained,
             'REFERENCE': block.at(points), 'MADE': block.at(records.made),
             'MASS_MATRIX': block.at(records.now) + _offset(records.now, 'M'),
             'MEMORIES': block.at(records.memories), 'KP': settings + _offset(
                 records.settings, 'kp'), 'KV': settings + _offset(records.settings, 'kv'),
             'KA': block.at(gains.arguments[1]), 'GAIN_PLACES': block.add(
                 gains.arguments, gains.places)}
    return Image(
        bytes(block.content), [(at // _WORD, target // _WORD) for at, target in block.pointers],
        calls, {name: at // _WORD for name, at in named.items()})


def _offset(record: Any, *names: str) -> int:
    """Return where a field of a field of a record is [bytes]."""
    kind, found = record.dtype, 0
    for name in names:
        kind, offset = kind.fields[name][:2]
        found += offset
    return found


def export(config: ControllerConfig, model: Model, out: Path, processor: str = 'host',
           package: str = '') -> int:
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

    Raises
    ------
    CtcError
        If the law cannot be exported for this robot.

    """
    if package and not re.fullmatch('[a-z][a-z0-9_]*', package):
        raise UsageError(f'--ros2-control {package}: not allowed; allowed: small letters, digits '
                         'and _, as of ROS packages')
    step = step_of(config, model)
    gains = Code(regained, (step.code.arguments[0], np.array(config.ka)), 'gains')
    codes = {'ctc_control': step.code, **{
        _FUNCTIONS[x.code.function]: x.code for x in step.arm.calls}}
    if takes_gains(step, config, model):
        codes[_SET] = gains
    from ctc_chattering.compiled.object_file import object_file
    code, text = object_file(codes, processor)
    values = {**_values(config, load(step.code.arguments[0].settings)), 'PACKAGE': package,
              'DATA': _data(image := image_of(step, gains), list(codes), config),
              'WORDS': len(image.content) // _WORD}
    library = out / 'ctc_law' if package else out
    _write(_TEMPLATES, library, values)
    if package:
        _write(_TEMPLATES / 'ros2_control', out, values)
    with writing(library):
        (library / 'ctc_law_code.o').write_bytes(code)
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
            'JOINT_NAMES': json.dumps(config.joint_names, ensure_ascii=False)[1:-1],
            'DELAY': config.input_delay, 'PERIOD': config.control_period,
            'PERIOD_NS': period_ns(config.control_period),
            'RATE': f'{1.0 / config.control_period:g}',
            'GROWTH': LARGEST_GROWTH, 'PATIENCE': PATIENCE, 'LEAST': LEAST, 'LARGEST': LARGEST,
            **{name.upper(): ', '.join(map(repr, map(float, x)))
               for name, x in zip(_GAINS, gains)}}


def _data(image: Image, functions: Sequence[str], config: ControllerConfig) -> str:
    """Return the numbers of a law in C."""
    constants = image.named | {
        'WATCHED': int(config.law == WATCHED), 'LARGEST_GROWTH': LARGEST_GROWTH,
        'PATIENCE': PATIENCE, 'GAINS_FUNCTION': _SET if _SET in functions else 'NULL'}
    bounds = [config.parameters()[name].bounds for name in _GAINS]
    words = np.frombuffer(image.content, np.uint64).tolist()
    tables = {
        'uint64_t content[]': [f'{x:#x}' for x in words],
        'double bounds[3][2]': [f'{{{low}, {high}}}' for low, high in bounds],
        'double error_limit[CTC_JOINTS]': [
            'INFINITY' if isinf(x) else repr(x) for x in config.error_limit],
        'struct { uint32_t at, to; } pointers[]': [f'{{{a}, {b}}}' for a, b in image.pointers],
        'struct { uint32_t at; code *function; } calls[]': [
            f'{{{at}, {name}}}' for at, name in image.calls]}
    lines = [f'#define {name} {value}' for name, value in constants.items()]
    lines += [f'code {name};' for name in functions]
    lines += [f'static const {head} = {{{", ".join(rows)}}};' for head, rows in tables.items()]
    return '\n'.join(line for text in lines for line in textwrap.wrap(text, 99))
