"""What the tests of this folder compare to the last bit is plain Python, whatever is compiled."""

from __future__ import annotations

from collections.abc import Iterator

from ctc_chattering.numerics.machine_code import Code
import pytest

#: These say themselves what they compile.
_OTHERS = ('test_compiled_step.py', 'test_control_steps.py', 'test_declared_parameters.py')


@pytest.fixture(autouse=True, scope='module')
def _plain(request: pytest.FixtureRequest) -> Iterator[None]:
    with pytest.MonkeyPatch.context() as context:
        if request.path.name not in _OTHERS:
            context.setattr(Code, 'compiled', property(lambda _: False))
        yield
