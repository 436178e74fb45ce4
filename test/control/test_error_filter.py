"""The filter (3): exact for its pole, without acceleration, bumpless."""

from ctc_chattering.control.error_filter import ErrorFilter
import numpy as np
from oracles import Array, random_spd
import pytest
from scipy.integrate import solve_ivp  # type: ignore[import-untyped]


def _output(made: ErrorFilter, de: Array | list[float]) -> list[float]:
    """Return v as a list."""
    listed: list[float] = made.output(np.array(de), made.state).tolist()
    return listed


def _update(made: ErrorFilter, de: Array | list[float], u: Array | list[float]) -> None:
    """Advance the filter by one period."""
    made.state = made.next_state(made.state, np.array(de), np.array(u))


def _filter(n: int, lambda_: float, b: float, h: float) -> ErrorFilter:
    made = ErrorFilter(n)
    made.configure(lambda_, b, h)
    return made


@pytest.mark.parametrize('h', [1e-4, 1e-2, 0.5, 3.0])
@pytest.mark.parametrize(('lambda_', 'b'), [(10.0, 1.0), (0.3, 2.5), (200.0, 0.1)])
def test_step_response_is_the_closed_form(h: float, lambda_: float, b: float) -> None:
    """Check ξ(t) = b (λ de - f)(1 - exp(-λ t)) / λ for any h, even far above 1/λ."""
    de, feedback = [0.7, -1.3], [5.0, 2.0]
    made = _filter(2, lambda_, b, h)
    for k in range(50):
        xi = b * (lambda_ * np.array(de) - feedback) * (1 - np.exp(-lambda_ * k * h)) / lambda_
        assert _output(made, de) == pytest.approx((xi - b * np.array(de)).tolist(), abs=1e-12)
        _update(made, de, feedback)


def test_free_response_decays_with_the_pole() -> None:
    """Check ξ(t) = ξ(0) exp(-λ t) once the errors are 0."""
    made = _filter(1, 4.0, 1.0, 0.01)
    _update(made, [3.0], [0.0])
    start = _output(made, [0.0])[0]
    for k in range(300):
        assert _output(made, [0.0])[0] == pytest.approx(start * np.exp(-4.0 * 0.01 * k), rel=1e-12)
        _update(made, [0.0], [0.0])


def _signals(t: float) -> tuple[Array, Array, Array]:
    """Return e and its two derivatives for three joints."""
    w = np.array([2.0, 5.0, 9.0])
    phase = np.array([0.3, 1.0, -2.0])
    x = w * t + phase
    return np.sin(x) / w, np.cos(x), -w * np.sin(x)


@pytest.mark.parametrize('b', [1.0, 0.4])
def test_three_joints_with_full_gains_against_the_continuous_equation(b: float) -> None:
    """
    Check v against p/(p+λ) with the acceleration, which the filter itself never sees.

    dv/dt + λ v = -b [dde + Kv de + Kp e] is equation (4) times b. The hold makes an error of the
    order of h: it must be small and halve with h.
    """
    rng = np.random.default_rng(1)
    kv, kp, lambda_ = random_spd(rng, 3) * 5.0, random_spd(rng, 3) * 10.0, 3.0

    def field(t: float, v: Array) -> Array:
        e, de, dde = _signals(t)
        return -lambda_ * v - b * (dde + kv @ de + kp @ e)

    exact = solve_ivp(field, (0.0, 2.0), -b * _signals(0.0)[1], method='DOP853', rtol=1e-11,
                      atol=1e-12).y[:, -1]
    errors = []
    for h in (2e-3, 1e-3):
        made = _filter(3, lambda_, b, h)
        for k in range(round(2.0 / h)):
            e, de, _ = _signals(k * h)
            _update(made, de.tolist(), (kv @ de + kp @ e).tolist())
        errors.append(np.abs(np.array(_output(made, _signals(2.0)[1].tolist())) - exact).max())
    assert errors[0] < 0.05 * np.abs(exact).max()
    assert errors[0] / errors[1] == pytest.approx(2.0, rel=0.1)


def test_recursion_by_hand() -> None:
    """Check the sampled solution for random inputs against numpy's full-matrix form."""
    rng = np.random.default_rng(7)
    kv, kp = random_spd(rng, 3), random_spd(rng, 3)
    lambda_, b, h = 7.0, 1.3, 0.02
    made, xi = _filter(3, lambda_, b, h), np.zeros(3)
    for _ in range(200):
        e, de = rng.normal(size=3), rng.normal(size=3)
        np.testing.assert_allclose(_output(made, de.tolist()), xi - b * de, atol=1e-12)
        _update(made, de.tolist(), (kv @ de + kp @ e).tolist())
        bracket = b * ((lambda_ * np.eye(3) - kv) @ de - kp @ e)
        xi = np.exp(-lambda_ * h) * xi + (1 - np.exp(-lambda_ * h)) / lambda_ * bracket


def test_slow_pole_keeps_its_digits() -> None:
    """Check (1 - exp(-λ h)) / λ where λ h is far below the float spacing at 1: it is h."""
    made = _filter(1, 1e-12, 1.0, 1e-6)
    _update(made, [0.0], [1.0])
    assert _output(made, [0.0])[0] == pytest.approx(-1e-6, rel=1e-12)


def test_state_is_preserved() -> None:
    """Check that new gains give no step in v, take effect afterwards, and reset gives zero."""
    made = _filter(2, 10.0, 1.0, 0.01)
    for _ in range(20):
        _update(made, [1.0, -2.0], [30.0, 4.0])
    before = _output(made, [0.5, 0.5])
    made.configure(2.0, 1.0, 0.02)
    assert _output(made, [0.5, 0.5]) == before
    xi = np.array(_output(made, [0.0, 0.0]))
    _update(made, [0.0, 0.0], [0.0, 0.0])
    assert _output(made, [0.0, 0.0]) == pytest.approx((xi * np.exp(-0.04)).tolist())
    made.configure(2.0, 3.0, 0.02)
    xi = np.array(_output(made, [0.0, 0.0]))
    assert _output(made, [1.0, 0.0]) == pytest.approx((xi - [3.0, 0.0]).tolist())
    made.reset()
    assert list(_output(made, [0.0, 0.0])) == [0.0, 0.0]


def test_starts_at_rest() -> None:
    """Check ξ(0) = 0, so that v(0) = -b de(0)."""
    assert _output(_filter(3, 5.0, 2.0, 1e-3), [1.0, -2.0, 0.0]) == [-2.0, 4.0, 0.0]


@pytest.mark.parametrize('b', [1.0, 0.4])
def test_initialized_bumpless_it_has_no_output(b: float) -> None:
    """Check v = 0 to the last bit whatever ξ was, and that it then goes on as from any ξ."""
    rng = np.random.default_rng(2)
    made = _filter(3, 7.0, b, 0.01)
    for _ in range(20):
        _update(made, rng.normal(size=3).tolist(), rng.normal(size=3).tolist())
    de, feedback = rng.normal(size=3), rng.normal(size=3)
    assert any(_output(made, de.tolist()))
    made.initialize_bumpless(de)
    assert list(_output(made, de.tolist())) == [0.0, 0.0, 0.0]
    _update(made, de.tolist(), feedback.tolist())
    decay = np.exp(-7.0 * 0.01)
    expected = b * de * decay + b * (1 - decay) / 7.0 * (7.0 * de - feedback)
    np.testing.assert_allclose(_output(made, [0.0] * 3), expected, rtol=1e-12)


@pytest.mark.parametrize(('b', 'h'), [(1.0, 1e-3), (2.5, 0.02)])
def test_correction_is_added_to_state_and_response(b: float, h: float) -> None:
    """Check that with b h times an acceleration it undoes what that does to v over a period."""
    acceleration, made = np.array([3.0, -40.0]), _filter(2, 5.0, b, h)
    made.state = np.array([0.2, -0.1])
    de, u = np.array([0.3, 0.2]), np.array([1.0, -2.0])
    plain = made.next_state(made.state, de, u)
    corrected = made.next_state(made.state, de, u, b * h * acceleration)
    np.testing.assert_allclose(
        made.output(de + h * acceleration, corrected), made.output(de, plain), atol=1e-13)
    v = made.output(de, made.state)
    np.testing.assert_allclose(
        made.nominal_response(v, u, b * h * acceleration) - made.nominal_response(v, u),
        b * h * acceleration, atol=1e-13)


@pytest.mark.parametrize('h', [1e-3, 0.02])
def test_nominal_response_is_the_next_output_without_an_error_acceleration(h: float) -> None:
    """Check v of the next sample where dde = -(Kv de + Kp e), by the filter's own recursion."""
    made = _filter(2, 5.0, 1.7, h)
    made.state = np.array([0.2, -0.1])
    de, u = np.array([0.3, 0.2]), np.array([1.0, -2.0])
    v = made.output(de, made.state)
    wanted = made.output(de - h * u, made.next_state(made.state, de, u))
    np.testing.assert_allclose(made.nominal_response(v, u), wanted, atol=1e-14)
