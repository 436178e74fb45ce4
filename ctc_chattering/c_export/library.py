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

from collections.abc import Iterable, Mapping, Sequence
import json
from math import isinf
from pathlib import Path
import re
import textwrap
from typing import Any, NamedTuple

from ctc_chattering.analysis.output import write_text, writing
from ctc_chattering.compiled.machine_code import memory_of
from ctc_chattering.compiled.records import load, packed
from ctc_chattering.control.controller import Controller, ControllerConfig
from ctc_chattering.control.laws.base import Law
from ctc_chattering.control.step import CompiledStep
from ctc_chattering.controller.trips import LARGEST_GROWTH, PATIENCE, WATCHED
from ctc_chattering.dynamics.compiled_model import set_mass_and_bias, set_terms
from ctc_chattering.dynamics.model import Model
from ctc_chattering.errors import CtcError, UsageError
from ctc_chattering.numerics.time_grid import period_ns
import numpy as np

_TEMPLATES = Path(__file__).with_name('templates')
#: What compiled code calls, by its name in C.
_FUNCTIONS = {set_terms: 'ctc_dynamics', set_mass_and_bias: 'ctc_mass'}
#: Parts of the block are words of so many bytes.
_WORD = 8


class Robot(NamedTuple):
    """A law with its robot: name of the gains, configuration and model."""

    name: str
    config: ControllerConfig
    model: Model


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
    start, rest : bytes
        Gains and memories, and what is the same for all gains.
    gains : int
        Words of the gains, which are first.
    forgotten : list of int
        What is set to 0 with other gains.
    pointers, calls : list of tuple
        Where there is a pointer, and to where; where there is the address of a function, and its
        name.
    named : dict of str to int
        Where steps read and write, by the names in ``ctc_law.c``.

    """

    start: bytes
    rest: bytes
    gains: int
    forgotten: list[int]
    pointers: list[tuple[int, int]]
    calls: list[tuple[int, str]]
    named: dict[str, int]


def step_of(robot: Robot) -> CompiledStep:
    """Return the step of a robot's law at the start; raise `CtcError` where C cannot have it."""
    config = robot.config
    step = Controller(config.changed({'compiled': True}), robot.model).compiled_step()
    if step is None:
        raise CtcError(f'{robot.name}: model {config.model} with law {config.law} cannot be '
                       'exported; allowed: models two_link and urdf, laws of marked records')
    return step


def image_of(step: CompiledStep) -> Image:
    """Return the block of memory of a step that has not been called."""
    block, (records, points) = Block(), step.code.arguments
    places = block.add(step.code.arguments, step.code.places)
    calls = []
    for record, code, arguments, places_there in step.arm.calls:
        target, at = block.add(arguments, places_there), block.at(record)
        block.set_pointer(at + _offset(record, 'places'), target)
        calls.append(((at + _offset(record, 'function')) // _WORD, _FUNCTIONS[code.function]))
    for at, _ in calls:
        block.content[_WORD * at:_WORD * (at + 1)] = bytes(_WORD)
    gains, start = block.at(records.memories), block.at(records.arrival)
    strained = (gains + _offset(records.memories, 'law', 'oscillation', 'strained')
                if 'oscillation' in records.memories.dtype['law'].names else 0)
    named = {'PLACES': places, 'MEASURED': block.at(records.measured), 'STRAINED': strained,
             'REFERENCE': block.at(points), 'MADE': block.at(records.made),
             'MASS_MATRIX': block.at(records.now) + _offset(records.now, 'M')}
    content = bytes(block.content)
    return Image(
        content[:start], content[start:], gains // _WORD,
        [gains // _WORD + word for word in _forgotten(step, load(records.law))],
        [(at // _WORD, target // _WORD) for at, target in block.pointers], calls,
        {name: at // _WORD for name, at in named.items()})


def _offset(record: Any, *names: str) -> int:
    """Return where a field of a field of a record is [bytes]."""
    kind, found = record.dtype, 0
    for name in names:
        kind, offset = kind.fields[name][:2]
        found += offset
    return found


def _forgotten(step: CompiledStep, law: Law) -> list[int]:
    """Return the words of the memories that a law sets to 0 when it gets other gains."""
    size = step.code.arguments[0].memories.dtype
    full = load(np.ones(size.itemsize // _WORD).view(size)[0])
    before, after = (np.frombuffer(packed(x).tobytes()) for x in (
        full, full._replace(law=law.reconfigured(full.law))))
    return [int(word) for word in np.flatnonzero(before != after)]


def export(robots: Sequence[Robot], out: Path, processor: str = 'host', package: str = '') -> int:
    """
    Write the library of one robot with one or several sets of gains; return the size of its code.

    Parameters
    ----------
    robots : sequence of Robot
        One for each set of gains.
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
        If a robot cannot be exported, or they differ in more than gains.

    """
    if package and not re.fullmatch('[a-z][a-z0-9_]*', package):
        raise UsageError(f'--ros2-control {package}: not allowed; allowed: small letters, digits '
                         'and _, as of ROS packages')
    first = robots[0].config
    if len(robots) > 1 and (':' in first.law + first.switching_in_force
                            or len({robot.name for robot in robots}) < len(robots)):
        raise CtcError('several sets of gains need files of different names, and no law or '
                       'switching of your own')
    step, *_ = made = [step_of(robot) for robot in robots]
    image, *others = map(image_of, made)
    for robot, x, other in zip(robots[1:], made[1:], others):
        if (x.code.layouts, other.rest, robot.config.control_period, robot.config.joint_names) != (
                step.code.layouts, image.rest, first.control_period, first.joint_names):
            raise CtcError(f'{robot.name} differs from {robots[0].name} in more than gains: in '
                           'robot, law, switching, delay or period')
    from ctc_chattering.compiled.object_file import object_file
    code, text = object_file({'ctc_control': step.code, **{
        _FUNCTIONS[x.code.function]: x.code for x in step.arm.calls}}, processor)
    starts = [image.start, *(x.start for x in others)]
    values = {**_values(robots), 'DATA': _data(image, starts, robots), 'PACKAGE': package,
              'WORDS': len(image.start + image.rest) // _WORD}
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


def _values(robots: Sequence[Robot]) -> dict[str, object]:
    """Return what the header says of a law."""
    config = robots[0].config
    return {'LAW': config.law, 'JOINTS': len(config.joint_names),
            'JOINT_NAMES': _strings(config.joint_names), 'DELAY': config.input_delay,
            'PERIOD': config.control_period, 'PERIOD_NS': period_ns(config.control_period),
            'GAIN_SETS': len(robots), 'GAIN_NAMES': _strings(x.name for x in robots),
            'GROWTH': LARGEST_GROWTH, 'PATIENCE': PATIENCE,
            'RATE': f'{1.0 / config.control_period:g}', 'FIRST_GAINS': _strings([robots[0].name])}


def _strings(texts: Iterable[str]) -> str:
    return ', '.join(json.dumps(text, ensure_ascii=False) for text in texts)


def _data(image: Image, starts: Sequence[bytes], robots: Sequence[Robot]) -> str:
    """Return the numbers of a law in C."""
    def words(content: bytes) -> str:
        return ', '.join(f'{x:#x}' for x in np.frombuffer(content, np.uint64).tolist())

    def limits(config: ControllerConfig) -> str:
        return ', '.join('INFINITY' if isinf(x) else repr(x) for x in config.error_limit)

    watched = int(robots[0].config.law == WATCHED)
    constants = image.named | {
        'GAIN_WORDS': image.gains, 'START_WORDS': len(starts[0]) // _WORD, 'WATCHED': watched,
        'LARGEST_GROWTH': LARGEST_GROWTH, 'PATIENCE': PATIENCE}
    tables = {
        'uint64_t starts[][START_WORDS]': [f'{{{words(x)}}}' for x in starts],
        'uint64_t rest[]': [words(image.rest)],
        'double error_limits[][CTC_JOINTS]': [f'{{{limits(x.config)}}}' for x in robots],
        'uint32_t forgotten[]': ['0', *map(str, image.forgotten)],
        'struct { uint32_t at, to; } pointers[]': [f'{{{a}, {b}}}' for a, b in image.pointers],
        'struct { uint32_t at; code *function; } calls[]': [
            f'{{{at}, {name}}}' for at, name in image.calls]}
    lines = [f'#define {name} {value}' for name, value in constants.items()]
    lines += [f'code {name};' for name in ('ctc_control', *_FUNCTIONS.values())]
    for head, rows in tables.items():
        lines += [f'static const {head} = {{', *(f'{row},' for row in rows), '};']
    return '\n'.join(line for text in lines for line in textwrap.wrap(text, 99))
