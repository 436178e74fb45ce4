"""The processes that tests start have the rights of an ordinary user, whoever runs the tests."""

from concurrent.futures import ThreadPoolExecutor
import ctypes

import pytest

_PR_CAPBSET_DROP = 24
_CAP_IPC_LOCK, _CAP_SYS_NICE = 14, 23
#: A thread that still has the rights of who runs the tests, and passes them on to what it starts.
WITH_RIGHTS = ThreadPoolExecutor(1)


def pytest_configure(config: pytest.Config) -> None:
    """Have what this thread starts from now on ask for real-time scheduling in vain."""
    if config.getoption('numprocesses', None) and not hasattr(config, 'workerinput'):
        return  # It starts those that run the tests.
    WITH_RIGHTS.submit(int).result()  # It takes its rights from us when it begins.
    for capability in (_CAP_IPC_LOCK, _CAP_SYS_NICE):
        ctypes.CDLL(None).prctl(_PR_CAPBSET_DROP, capability, 0, 0, 0)
