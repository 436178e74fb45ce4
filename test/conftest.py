"""
What all tests have in common.

The processes that they start have the rights of an ordinary user, whoever runs the tests, and
signals end them, where the tests run under nohup or in the background too.
Hypothesis tries the same examples every time, however slow the machine.
"""

import signal

from hypothesis import HealthCheck, settings
import pytest
from rights import drop_rights

# No test depends on the time an example takes.
_TIMELESS = settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.register_profile('repeatable', _TIMELESS, derandomize=True)
#: For `make slow`, which looks for new ones.
settings.register_profile('random', _TIMELESS, derandomize=False)
settings.load_profile('repeatable')


def pytest_configure(config: pytest.Config) -> None:
    """Take signals and rights as an ordinary user has them."""
    if config.getoption('numprocesses', None) and not hasattr(config, 'workerinput'):
        return  # It starts those that run the tests.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGHUP, signal.SIG_DFL)
    drop_rights()
