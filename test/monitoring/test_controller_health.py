"""What a controller's report says of states that are skipped, late or come at another rate."""

from ctc_chattering.monitoring.controller_health import ControllerHealth
import pytest

SECOND, MS = 10 ** 9, 10 ** 6
SLOW = 'the step takes 2 ms (p50) at a period of 1 ms: too slow for the sample rate'


def report(taken: int, skipped: int, cause: str = '', simulated: bool = False,
           period: int = MS) -> list[tuple[int, str]]:
    """Return the last report of four seconds with so many states a second."""
    health = ControllerHealth(('joint1',), MS)
    found: list[tuple[int, str]] = []
    for k in range(4 * taken):
        before = k * skipped // taken
        health.take((k + before) * period, before)
        if (k + 1) % taken == 0:
            found = health.report(k // taken * SECOND, {}, simulated, cause)
    return found


@pytest.mark.parametrize(('skipped', 'level'), [(0, 0), (200, 0), (300, 1), (1100, 2)])
def test_skipped_states_are_reported_with_their_cause(skipped: int, level: int) -> None:
    """They count for the rate of the stamps, which is right."""
    assert report(1000, skipped, SLOW, simulated=True) == []
    found = report(1000, skipped, SLOW)
    assert [x for x, _ in found] == [level] * bool(level)
    if found:
        share = 100 * skipped / (1000 + skipped)
        assert found[0][1] == f'{share:.0f} % of the states skipped for newer ones: {SLOW}'
        assert 'this computer is too busy' in report(1000, skipped)[0][1]


@pytest.mark.parametrize('skipped', [0, 100])
def test_a_wrong_rate_is_reported(skipped: int) -> None:
    assert report(500, skipped, period=2 * MS) == [
        (1, 'states come every 2 ms; control_period is 1 ms')]


def test_states_before_a_restart_are_no_part_of_the_rate() -> None:
    health = ControllerHealth(('joint1',), MS)
    for k in range(10):
        health.take(k * MS)
    health.restart()
    health.take(1000 * MS, 900)
    health.take(1002 * MS, 901)
    health.report(0, {}, False)
    assert health.sample_rate.mean == pytest.approx(1e-3)
