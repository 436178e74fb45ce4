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

"""Machine code of functions of records: the numbers of plain Python, and no numba to run it."""

from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
import subprocess
import sys
from types import SimpleNamespace
from typing import Any, NamedTuple

from ctc_chattering.compiled import compilable, machine_code
from ctc_chattering.compiled.machine_code import Code
from ctc_chattering.compiled.records import packed, record_of
from ctc_chattering.errors import CtcError
import numpy as np
import pytest


class Pair(NamedTuple):
    """Two NumPy records."""

    first: Any
    second: Any


def added(pair: Pair, table: Any) -> int:
    """Add the last numbers of all rows, and the numbers of the second record to the first."""
    total = 0.0
    for i in range(len(table)):
        total += table[i, 1, 2]
    for i in range(3):
        pair.first.x[i] += total * pair.second.x[i]
    pair.first.k = len(table)
    return int(pair.second.k) + 1


def _arguments(rows: int) -> tuple[Pair, Any]:
    def made(k: int) -> Any:
        return record_of(SimpleNamespace(x=np.array([1.0, 2.0, -3.0]), k=np.array(k)))
    return Pair(made(4), made(5)), np.arange(6.0 * rows).reshape(rows, 2, 3)


def build(code: Code) -> None:
    """Compile; the module that does so is not imported by who only runs the code."""
    import_module('ctc_chattering.compiled.build').build(code)


@pytest.fixture(autouse=True)
def _empty(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[None]:
    monkeypatch.setattr(machine_code, 'cache_directory', lambda: tmp_path)
    yield
    machine_code._key.cache_clear()


def test_as_plain_python() -> None:
    """Check results and what is written, for another length of an array too."""
    code = Code(added, _arguments(2), 'added')
    assert not code.compiled
    build(code)
    assert code.compiled
    for rows in (2, 5):
        plain, compiled = _arguments(rows), _arguments(rows)
        assert Code(added, compiled, 'added').call()() == added(*plain) == 6
        assert compiled[0].first == plain[0].first
        assert compiled[0].first.k == rows


def test_without_numba(tmp_path: Path) -> None:
    """Of two at once one compiles it; the next one calls it, and never imports numba."""
    script = f"""
import sys; sys.path.insert(0, {str(Path(__file__).parent)!r})
from pathlib import Path
from ctc_chattering.compiled import machine_code
machine_code.cache_directory = lambda: Path({str(tmp_path)!r})
import test_machine_code as t
code, made = machine_code.Code(t.added, t._arguments(2), 'added'), t._arguments(3)
compiled = []
if not code.compiled:
    from ctc_chattering.compiled import build
    make = build.compiled
    build.compiled = lambda code: compiled.append(code) or make(code)
    build.build(code)
print(machine_code.Code(t.added, made, 'added').call()(), made[0].first.x.tolist(), len(compiled),
      'numba' in sys.modules)"""

    def start() -> subprocess.Popen[str]:
        return subprocess.Popen([sys.executable, '-c', script], stdout=subprocess.PIPE, text=True)
    plain = _arguments(3)
    added(*plain)
    found = f'6 {plain[0].first.x.tolist()}'
    both = [start(), start()]
    ends = sorted(process.communicate()[0] for process in both)
    assert ends == [f'{found} 0 True\n', f'{found} 1 True\n']
    assert start().communicate()[0] == f'{found} 0 False\n'


def test_another_layout_text_or_processor_is_another_file(monkeypatch: pytest.MonkeyPatch) -> None:
    pair, table = _arguments(2)
    path = Code(added, (pair, table), 'added').path
    assert Code(added, (pair, np.zeros((9, 2, 3))), 'added').path == path
    assert Code(added, (pair, np.zeros((2, 2, 4))), 'added').path != path
    other = Pair(pair.first, record_of(SimpleNamespace(x=np.zeros(2), k=np.array(1))))
    assert Code(added, (other, table), 'added').path != path
    for name in ('source_key', '_processor'):
        with monkeypatch.context() as context:
            context.setattr(machine_code, name, lambda: 'another')
            machine_code._key.cache_clear()
            assert Code(added, (pair, table), 'added').path != path


def test_the_text_of_a_user_is_part_of_what_uses_it(
        monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Check a module of a user: what has its records is another file for another text."""
    text = ('from typing import Any, NamedTuple\n'
            'from ctc_chattering.compiled.compilable import record\n'
            '@record\nclass Gain(NamedTuple):\n    x: Any\n')
    path = tmp_path / 'module_of_a_user.py'
    path.write_text(text)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(compilable, 'RECORDS', compilable.RECORDS.copy())
    pair, table = _arguments(2)
    without = Code(added, (pair, table), 'added').path
    gain = packed(import_module('module_of_a_user').Gain(np.zeros(2)))

    def paths() -> tuple[Path, Path]:
        machine_code._key.cache_clear()
        return Code(added, (pair, table), 'added').path, Code(added, (gain, table), 'added').path
    assert paths()[0] == without
    first = paths()[1]
    path.write_text(text + '# Another factor.\n')
    assert paths() == (without, paths()[1]) != (without, first)
    monkeypatch.delattr(sys.modules['module_of_a_user'], '__file__')
    machine_code._key.cache_clear()
    assert not Code(added, (gain, table), 'added').compiled
    with pytest.raises(ImportError, match='module_of_a_user is not a file'):
        build(Code(added, (gain, table), 'added'))


def test_the_text_of_the_package_is_part_of_all(
        monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    source_key = machine_code.source_key.__wrapped__
    for name in ('compiled', 'numerics', 'dynamics', 'control/laws', 'simulation', 'analysis'):
        (tmp_path / name).mkdir(parents=True)
    monkeypatch.setattr(machine_code, '_PACKAGE', tmp_path)
    keys = [source_key()]
    for name in ('compiled/a', 'numerics/b', 'dynamics/c', 'control/laws/d', 'simulation/e',
                 'analysis/f'):
        (tmp_path / f'{name}.py').write_text('h = 1')
        keys.append(source_key())
    assert len(set(keys)) == 6
    assert keys[-1] == keys[-2]


@pytest.mark.parametrize('damage', ['truncated', 'a bit'])
def test_damaged_machine_code_is_never_run(damage: str) -> None:
    """It would crash the process, or compute something else; it is made again."""
    code = Code(added, _arguments(2), 'added')
    build(code)
    good = code.path.read_bytes()
    bad = bytearray(good)
    bad[len(bad) // 2] ^= 1
    code.path.write_bytes(good[:len(good) // 2] if damage == 'truncated' else bytes(bad))
    assert not code.compiled
    with pytest.raises(CtcError, match='is damaged'):
        code.call()
    build(code)
    assert code.call()() == 6


def test_without_a_directory_nothing_is_compiled(monkeypatch: pytest.MonkeyPatch) -> None:
    """Plain Python then computes, as it does where llvmlite is not installed."""
    def none() -> Path:
        raise CtcError('no directory')
    monkeypatch.setattr(machine_code, 'cache_directory', none)
    assert not Code(added, _arguments(2), 'added').compiled


def test_a_directory_that_others_may_write_is_not_taken(
        monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Machine code of somebody else is never run."""
    monkeypatch.undo()
    monkeypatch.setenv('HOME', str(tmp_path))
    monkeypatch.setattr('tempfile.gettempdir', lambda: str(tmp_path / 'tmp'))
    find = machine_code.cache_directory.__wrapped__
    assert find() == tmp_path / '.cache' / 'ctc_chattering' / 'machine_code'
    find().chmod(0o777)
    assert (tmp_path / 'tmp') in find().parents
    find().chmod(0o770)
    with pytest.raises(CtcError, match='no directory for compiled code'):
        find()


def test_a_full_disk_is_a_line_and_leaves_nothing(tmp_path: Path) -> None:
    """Take a process that may write files of 100 bytes."""
    script = f"""
import sys; sys.path.insert(0, {str(Path(__file__).parent)!r})
from pathlib import Path
import resource, signal
from ctc_chattering.compiled import machine_code
from ctc_chattering.errors import CtcError
machine_code.cache_directory = lambda: Path({str(tmp_path)!r})
import test_machine_code as t
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (100, 100))
try:
    t.build(machine_code.Code(t.added, t._arguments(2), 'added'))
except CtcError as error:
    print(error)"""
    done = subprocess.run([sys.executable, '-c', script], capture_output=True, text=True,
                          check=True)
    (file,) = tmp_path.glob('*.lock')
    assert done.stdout == f'cannot write {file.with_suffix(".o")}: File too large\n'
    assert [*tmp_path.iterdir()] == [file]
