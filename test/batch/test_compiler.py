"""Where compiled code is kept, and that one process compiles at a time."""

from pathlib import Path
from threading import Thread

from ctc_chattering.batch import compiler
import pytest


def test_another_source_text_is_another_cache(monkeypatch: pytest.MonkeyPatch, tmp_path: Path
                                              ) -> None:
    assert compiler.cache_directory().name == compiler.source_key()
    copy = tmp_path / 'batch'
    copy.mkdir()
    for path in Path(compiler.__file__).parent.glob('*.py'):
        (copy / path.name).write_bytes(path.read_bytes())
    for folder in ('simulation', 'dynamics', 'numerics', 'control/laws'):
        (tmp_path / folder).mkdir(parents=True)
    drive, law = (tmp_path / name for name in ('simulation/drive.py', 'control/laws/law.py'))
    for path in (drive, law):
        path.write_text('h = 1')
    monkeypatch.setattr(compiler, '_HERE', copy)
    before = compiler.source_key()
    assert before != compiler.cache_directory().name
    for path in (copy / 'plant.py', drive, law):
        path.write_bytes(path.read_bytes() + b'\n')
        assert compiler.source_key() != before
        before = compiler.source_key()


def test_one_at_a_time(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Without the lock the second one would have entered long before the first one leaves."""
    monkeypatch.setattr(compiler, 'cache_directory', lambda: tmp_path)
    order: list[str] = []

    def enter() -> None:
        with compiler.compiling(3):
            order.append('second')

    second = Thread(target=enter)
    with compiler.compiling(3):
        assert not compiler.is_compiled(3)
        second.start()
        second.join(0.5)
        order.append('first')
    second.join()
    assert order == ['first', 'second']
    assert compiler.is_compiled(3)
    assert not compiler.is_compiled(4)


def test_what_fails_is_not_compiled(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(compiler, 'cache_directory', lambda: tmp_path)
    with pytest.raises(ValueError, match='no'), compiler.compiling(2):
        raise ValueError('no')
    assert not compiler.is_compiled(2)
