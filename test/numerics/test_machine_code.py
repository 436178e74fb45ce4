"""Machine code of functions of records: the numbers of plain Python, and no numba to run it."""

from importlib import import_module
from pathlib import Path
import subprocess
import sys
from typing import Any, NamedTuple

from ctc_chattering.errors import CtcError
from ctc_chattering.numerics import machine_code
from ctc_chattering.numerics.machine_code import Call, Code, invoke
from ctc_chattering.numerics.records import numpy_record
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


def twice(places: Any) -> int:
    """Call a function by its address, two times."""
    return invoke(places.function, places.arguments) + invoke(places.function, places.arguments)


def _arguments(rows: int) -> tuple[Pair, Any]:
    def made(k: int) -> Any:
        return numpy_record({'x': np.array([1.0, 2.0, -3.0]), 'k': np.array(k)})
    return Pair(made(4), made(5)), np.arange(6.0 * rows).reshape(rows, 2, 3)


def build(code: Code) -> None:
    """Compile; the module that does so is not imported by who only runs the code."""
    import_module('ctc_chattering.numerics.simd.build').build(code)


@pytest.fixture(autouse=True)
def _empty(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(machine_code, 'cache_directory', lambda: tmp_path)


def test_as_plain_python() -> None:
    """Check results and what is written, for another length of an array too."""
    code = Code(added, _arguments(2), 'added')
    assert not code.compiled
    build(code)
    assert code.compiled
    for rows in (2, 5):
        plain, compiled = _arguments(rows), _arguments(rows)
        assert Call(code, compiled)() == added(*plain) == 6
        assert compiled[0].first == plain[0].first
        assert compiled[0].first.k == rows


def test_called_by_its_address() -> None:
    """Machine code calls machine code."""
    code, plain, compiled = Code(added, _arguments(2), 'added'), _arguments(3), _arguments(3)
    build(code)
    call = Call(code, compiled)
    places = numpy_record({'function': np.array(call.function),
                           'arguments': np.array(call.places.ctypes.data)})
    outer = Code(twice, (places,), 'twice')
    build(outer)
    assert Call(outer, (places,))() == 12
    added(*plain)
    assert compiled[0].first != plain[0].first
    added(*plain)
    assert compiled[0].first == plain[0].first


def test_without_numba(tmp_path: Path) -> None:
    """One process compiles it; the next one loads and calls it, and never imports numba."""
    script = f"""
import sys; sys.path.insert(0, {str(Path(__file__).parent)!r})
from pathlib import Path
from ctc_chattering.numerics import machine_code
machine_code.cache_directory = lambda: Path({str(tmp_path)!r})
import test_machine_code as t
code, made = machine_code.Code(t.added, t._arguments(2), 'added'), t._arguments(3)
if not code.compiled:
    t.build(code)
print(machine_code.Call(code, made)(), made[0].first.x.tolist(), 'numba' in sys.modules)"""
    plain = _arguments(3)
    added(*plain)
    for compiling in (True, False):
        ended = subprocess.run([sys.executable, '-c', script], stdout=subprocess.PIPE, text=True,
                               check=True)
        assert ended.stdout == f'6 {plain[0].first.x.tolist()} {compiling}\n'


def test_another_layout_text_or_processor_is_another_file(monkeypatch: pytest.MonkeyPatch) -> None:
    pair, table = _arguments(2)
    path = Code(added, (pair, table), 'added').path
    assert Code(added, (pair, np.zeros((9, 2, 3))), 'added').path == path
    assert Code(added, (pair, np.zeros((2, 2, 4))), 'added').path != path
    other = Pair(pair.first, numpy_record({'x': np.zeros(2), 'k': np.array(1)}))
    assert Code(added, (other, table), 'added').path != path
    for name in ('source_key', '_processor'):
        with monkeypatch.context() as context:
            context.setattr(machine_code, name, lambda: 'another')
            assert Code(added, (pair, table), 'added').path != path


def test_memory_is_not_asked_for() -> None:
    """What would make an array is refused when it is compiled."""
    def sliced(pair: Pair, table: Any) -> int:
        pair.first.x[:] = table[0, 0]
        return 0
    with pytest.raises(Exception, match='NRT required'):
        build(Code(sliced, _arguments(2), 'sliced'))


def test_a_directory_that_others_may_write_is_not_taken(
        monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Machine code of somebody else is never run."""
    monkeypatch.undo()
    monkeypatch.setattr(Path, 'home', lambda: tmp_path)
    monkeypatch.setattr('tempfile.gettempdir', lambda: str(tmp_path / 'tmp'))
    find = machine_code.cache_directory.__wrapped__
    assert find() == tmp_path / '.cache' / 'ctc_chattering' / 'machine_code'
    find().chmod(0o777)
    assert (tmp_path / 'tmp') in find().parents
    find().chmod(0o770)
    with pytest.raises(CtcError, match='no directory for compiled code'):
        find()
