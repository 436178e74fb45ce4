"""
What all tests have in common.

The processes that they start have the rights of an ordinary user, whoever runs the tests, and
signals end them, where the tests run under nohup or in the background too.
Hypothesis tries the same examples every time, however slow the machine.
"""

from concurrent.futures import ThreadPoolExecutor
import ctypes
import signal

from hypothesis import HealthCheck, settings
import pytest

# No test depends on the time an example takes.
_TIMELESS = settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.register_profile('repeatable', _TIMELESS, derandomize=True)
#: For `make slow`, which looks for new ones.
settings.register_profile('random', _TIMELESS, derandomize=False)
settings.load_profile('repeatable')

_PR_CAPBSET_DROP = 24
_CAP_IPC_LOCK, _CAP_SYS_NICE = 14, 23
#: A thread that still has the rights of who runs the tests, and passes them on to what it starts.
WITH_RIGHTS = ThreadPoolExecutor(1)


def pytest_configure(config: pytest.Config) -> None:
    """Have what this thread starts from now on ask for real-time scheduling in vain."""
    if config.getoption('numprocesses', None) and not hasattr(config, 'workerinput'):
        return  # It starts those that run the tests.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGHUP, signal.SIG_DFL)
    WITH_RIGHTS.submit(int).result()  # It takes its rights from us when it begins.
    for capability in (_CAP_IPC_LOCK, _CAP_SYS_NICE):
        ctypes.CDLL(None).prctl(_PR_CAPBSET_DROP, capability, 0, 0, 0)
