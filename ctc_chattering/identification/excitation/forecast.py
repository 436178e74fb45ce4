"""
What a motion is good for, foretold with the model: conditioning, torques, and joints that stick.

The regression is that of friction and of errors of the model, joint by joint::

    tau_i = Kf_i sgn(dq_i) + offset_i + Kv_i dq_i + a_i (M ddq + C dq)_i + g_i G_i
"""

from __future__ import annotations

from collections.abc import Sequence
import dataclasses

from ctc_chattering.analysis.number_format import rounded
from ctc_chattering.dynamics.model import Model
from ctc_chattering.errors import ParameterError
from ctc_chattering.identification.excitation.limits import Bounds, ExcitationConfig
from ctc_chattering.identification.excitation.random_motion import Excitation, random_excitation
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.numerics.time_grid import NANOSECONDS
from ctc_chattering.trajectory.waypoints import Route, Waypoints
import numpy as np

#: Step in which a motion is evaluated while one is chosen, and for what is reported [s].
_COARSE, _FINE = 0.05, 0.01
#: A column less than this part of the largest is none: a joint without gravity.
_NOTHING = 1e-9
#: Part of the amplitude of the slow reversals within which friction may hold a joint.
_STICKING = 0.2
#: Largest product of the velocity gain with control period and delay.
_GAIN = 0.1


@dataclasses.dataclass(frozen=True)
class AssumedFriction:
    """Assumed Coulomb [N·m] and viscous [N·m·s/rad] friction, each of shape (n,)."""

    coulomb: Array
    viscous: Array


@dataclasses.dataclass(frozen=True)
class Played:
    """
    A motion as it is played, with its torques.

    Attributes
    ----------
    t : ndarray, shape (N,)
        Time [s].
    q, dq, ddq : ndarray, shape (N, n)
        Position [rad], velocity [rad/s] and acceleration [rad/s²].
    inertial, gravity, tau : ndarray, shape (N, n)
        M ddq + C dq; G; both with friction [N·m].

    """

    t: Array
    q: Array
    dq: Array
    ddq: Array
    inertial: Array
    gravity: Array
    tau: Array

    @property
    def peak_torque(self) -> Array:
        """Largest torque of each joint, shape (n,) [N·m]."""
        peak: Array = np.abs(self.tau).max(axis=0)
        return peak


def played(route: Route, start: Sequence[float], model: Model, friction: AssumedFriction,
           step: float = _FINE) -> Played:
    """
    Return a motion through waypoints, from rest at `start`, with its torques.

    Parameters
    ----------
    route : Route
        The waypoints, in the order of the model's joints.
    start : sequence of float, shape (n,)
        Position at t = 0 [rad].
    model : Model
        Gives the torques.
    friction : AssumedFriction
        At rest, Coulomb friction acts with the rest of the torque.
    step : float
        Time between two samples [s].

    """
    rest = (0.0,) * len(start)
    way = Waypoints(route.times, route.points, (0, (tuple(start), rest, rest)))
    times = range(0, way.end + 1, round(step * NANOSECONDS))
    points = [way.at(t) for t in times]
    q, dq, ddq = (np.array(rows) for rows in zip(*points))
    gravity = np.array([model.gravity_torque(row) for row, _, _ in points])
    inertial = np.array([model.inverse_dynamics(*point) for point in points]) - gravity
    smooth = inertial + gravity + friction.viscous * dq
    sign = np.sign(np.where(dq == 0.0, smooth, dq))
    return Played(np.array(times) / NANOSECONDS, q, dq, ddq, inertial, gravity,
                  smooth + friction.coulomb * sign)


def condition_numbers(motion: Played) -> Array:
    """
    Return the condition number of each joint's regression, as it is and with scaled columns.

    Parameters
    ----------
    motion : Played
        A column that is 0, such as gravity about a vertical axis, is left out.

    Returns
    -------
    ndarray, shape (n, 2)

    """
    found = []
    for i in range(motion.q.shape[1]):
        a = np.column_stack([np.sign(motion.dq[:, i]), np.ones(len(motion.t)), motion.dq[:, i],
                             motion.inertial[:, i], motion.gravity[:, i]])
        norms = np.linalg.norm(a, axis=0)
        a, norms = (x[..., norms > _NOTHING * norms.max()] for x in (a, norms))
        found.append((np.linalg.cond(a), np.linalg.cond(a / norms)))
    return np.array(found)


def best_excitation(config: ExcitationConfig, bounds: Bounds, model: Model,
                    friction: AssumedFriction, effort: Array, draws: int, seed: int) -> Excitation:
    """
    Return the best conditioned of random motions.

    Parameters
    ----------
    config, bounds
        What is asked for, and what the motion keeps.
    model, friction
        What the torques are computed with.
    effort : ndarray, shape (n,)
        Largest torques [N·m]; inf for unlimited.
    draws, seed : int
        Number of motions, and seed of their random numbers.

    Raises
    ------
    ParameterError
        If the duration is too short, or all motions exceed the largest torques.

    """
    rng = np.random.default_rng(seed)
    best: tuple[float, Excitation] | None = None
    beyond: tuple[float, int, float] | None = None
    for _ in range(draws):
        candidate = random_excitation(config, bounds, rng)
        motion = played(candidate.route, config.start, model, friction, _COARSE)
        i = int((motion.peak_torque / effort).argmax())
        share = float(motion.peak_torque[i] / effort[i])
        if share > 1.0:
            beyond = min(beyond or (np.inf, 0, 0.0), (share, i, float(motion.peak_torque[i])))
            continue
        condition = float(condition_numbers(motion)[:, 1].max())
        if best is None or condition < best[0]:
            best = condition, candidate
    if best is None:
        assert beyond is not None
        _, i, torque = beyond
        raise ParameterError(
            f'peak torque of {config.joint_names[i]}', rounded(torque, 4),
            f'at most {effort[i]:g} N*m, its effort limit; of {draws} motions this one is the '
            'least: choose smaller limits or another centre')
    return best[1]


def sticking(model: Model, positions: Array, kp: Array, friction: AssumedFriction) -> Array:
    """
    Return how far friction can hold each joint from the motion under computed torque, (n,) [rad].

    All joints stick while the law's torque M Kp e is within ±Kf: |e| ≤ |Kp⁻¹ M⁻¹| Kf.

    Parameters
    ----------
    model : Model
        Gives M.
    positions : ndarray, shape (m, n)
        Where to evaluate it; the largest distance is returned.
    kp : ndarray, shape (n,)
        Position gains [1/s²].
    friction : AssumedFriction
        Its Coulomb friction counts.

    """
    inverse = np.array([np.linalg.inv(np.array(model.mass_matrix(q.tolist())))
                        for q in positions])
    distance: Array = (np.abs(inverse) @ friction.coulomb).max(axis=0) / kp
    return distance


def gains(kp: Array, kv: Array, hold: Array, slow: Array, delay: float) -> tuple[Array, Array]:
    """
    Return gains with which friction takes little of the slow reversals, as far as they may rise.

    Parameters
    ----------
    kp, kv : ndarray, shape (n,)
        Gains [1/s², 1/s]; they are never lowered.
    hold : ndarray, shape (n,)
        What `sticking` returns for them [rad].
    slow : ndarray, shape (n,)
        Amplitude of the reversals [rad].
    delay : float
        Control period and input delay [s].

    """
    most = (0.5 * _GAIN / delay) ** 2
    wanted = np.ceil(np.minimum(kp * hold / (_STICKING * slow), most))
    higher = np.where(hold > _STICKING * slow, np.maximum(kp, wanted), kp)
    return higher, np.where(higher > kp, np.maximum(kv, np.ceil(2.0 * np.sqrt(higher))), kv)
