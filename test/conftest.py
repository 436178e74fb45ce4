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
What all tests have in common.

Signals end the processes that they start, where the tests run under nohup or in the background
too.
Tests of pages are left out where there is no Chromium, and the summary says so; with
REQUIRE_BROWSER in the environment, as in CI, nothing is tested without it.
Hypothesis tries the same examples every time, however slow the machine.
"""

from collections.abc import Iterator
import gc
from importlib.util import find_spec
from itertools import accumulate, groupby
from operator import itemgetter
import os
import signal
from typing import Any

from browser import browser, chromium
from calibration import text
from ctc_chattering.compiled.machine_code import Code
from hypothesis import HealthCheck, settings
import pytest

# No test depends on the time an example takes.
_TIMELESS = settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.register_profile('repeatable', _TIMELESS, derandomize=True)
#: For `make slow`, which looks for new ones.
settings.register_profile('random', _TIMELESS, derandomize=False)
settings.load_profile('repeatable')


def pytest_configure(config: pytest.Config) -> None:
    """Take signals as an ordinary user has them."""
    if os.environ.get('REQUIRE_BROWSER') and chromium() is None:
        raise pytest.UsageError('there is no Chromium, and REQUIRE_BROWSER is set: '
                                'apt-get install chromium, or CHROMIUM=/its/path')
    if config.getoption('numprocesses', None) and not hasattr(config, 'workerinput'):
        return  # It starts those that run the tests.
    gc.disable()  # Nothing of what is imported is garbage.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGHUP, signal.SIG_DFL)


@pytest.hookimpl(trylast=True)  # Without tests that are left out by their marks.
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out what needs a browser, or control_msgs, where there is none; put in order."""
    for marker, there in (('browser', chromium()), ('control_msgs', find_spec('control_msgs'))):
        if there is None:
            left_out = [item for item in items if item.get_closest_marker(marker)]
            items[:] = [item for item in items if item not in left_out]
            config.hook.pytest_deselected(items=left_out)
    items[:] = spread(items)


def spread(items: list[pytest.Item]) -> list[pytest.Item]:
    """
    Return tests with the modules that start ROS processes spread evenly among the others.

    They mostly wait, and workers are given equal numbers of tests in this order: so some wait
    and others compute at all times. Those with many such tests are first: a worker may come to
    them last, when the others have nothing left to do.
    """
    def waits(module: list[pytest.Item]) -> int:
        return sum(item.get_closest_marker('ros') is not None for item in module)

    modules = sorted((list(module) for _, module in groupby(items, lambda item: item.path)),
                     key=waits, reverse=True)
    placed: list[tuple[float, list[pytest.Item]]] = []
    for waiting in (False, True):
        of_kind = [module for module in modules if waiting == bool(waits(module))]
        ends = list(accumulate(map(len, of_kind)))
        placed += [(end / ends[-1], module) for end, module in zip(ends, of_kind)]
    return [item for _, module in sorted(placed, key=itemgetter(0)) for item in module]


def pytest_collection_finish() -> None:
    """
    Have the garbage collector pass over what all tests share: modules, and the tests.

    It looks at what tests leave behind less often, since they make many objects that stay.
    """
    gc.collect()
    gc.freeze()
    gc.set_threshold(20_000, 20, 20)
    gc.enable()


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Say how fast the computer is, and whether something was left out."""
    terminalreporter.write_line(text())
    if chromium() is None:
        terminalreporter.write_line(
            'No Chromium: tests of the page were left out. apt-get install chromium')
    if find_spec('control_msgs') is None:
        terminalreporter.write_line(
            'No control_msgs: tests of the action were left out. tools/build_control_msgs')


#: Tests of the folder `control` that say themselves what they compile. The others compare to the
#: last bit, as plain Python, whatever is compiled on this computer.
_COMPILING = ('test_all_laws.py', 'test_compiled_step.py', 'test_extended_state_observer.py',
              'test_law_registry.py', 'test_observer_feedback.py', 'test_step.py')


@pytest.fixture(autouse=True, scope='module')
def _plain_control(request: pytest.FixtureRequest) -> Iterator[None]:
    with pytest.MonkeyPatch.context() as context:
        if 'control' in request.path.parts and request.path.name not in _COMPILING:
            context.setattr(Code, 'compiled', property(lambda _: False))
        yield


@pytest.fixture(scope='module')
def started_browser() -> Iterator[Any]:
    """Yield the browser that the tests of a module share."""
    with browser() as it:
        yield it
