"""What goes wrong while a controller runs: rates, chattering term, settings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ctc_chattering.control.controller import ControllerConfig, Sample
from ctc_chattering.monitoring.sample_rate import SampleRate
from ctc_chattering.monitoring.settings_check import unsafe_settings
from ctc_chattering.monitoring.term_saturation import TermSaturation
from ctc_chattering.monitoring.watchdog import HealthMonitor
from ctc_chattering.numerics.linear_algebra import Vector
from ctc_chattering.numerics.time_grid import seconds

#: Part of the states rejected, or skipped, that is a warning, and an error.
_REJECTED = 0.01, 0.1
_SKIPPED = 0.2, 0.5
#: Rejected messages that say nothing about the states of the robot.
_UNRELATED = 'second_publisher'


class ControllerHealth:
    """
    Counts what a controller takes and sends, for a report once a second.

    Parameters
    ----------
    names : sequence of str
        The joints.
    period : int
        Control period [ns].

    Attributes
    ----------
    taken, skipped, restarts, saturated : int
        States taken, states skipped for newer ones, restarts of the law, samples with a torque at
        its limit.
    robust : sequence of float, shape (n,)
        Robust term of the last sample [N·m]; empty before the first.
    rates : HealthMonitor
        Of restarts and rejected states.
    skips : HealthMonitor
        Of states skipped for newer ones.
    sample_rate : SampleRate
        Of the states' stamps.

    """

    def __init__(self, names: Sequence[str], period: int) -> None:
        self._names, self._period = names, period
        self.taken = self.skipped = self.restarts = self.saturated = 0
        self.robust: Vector = ()
        self.rates = HealthMonitor('restarts', 'of the states refused', *_REJECTED, period)
        self.skips = HealthMonitor('', 'of the states skipped for newer ones', *_SKIPPED, period)
        self.sample_rate = SampleRate(period)
        self._term_saturation = TermSaturation(len(names))
        self._rejected: Mapping[str, int] = {}
        self._config: ControllerConfig | None = None

    def take(self, t: int, skipped: int = 0) -> None:
        """Count a state of stamp `t` [ns]; so many have been `skipped` so far."""
        self.taken += 1
        self.sample_rate.note(t, skipped - self.skipped)
        self.skipped = skipped

    def restart(self) -> None:
        """Count a restart: the next state does not follow the last one."""
        self.restarts += 1
        self.sample_rate.pause()

    def pause(self) -> None:
        """Note that the next torque does not follow the last one."""
        self._term_saturation.pause()

    def add(self, sample: Sample, config: ControllerConfig) -> None:
        """Count a sample of the law."""
        self.robust, self._config = sample.robust, config
        self.saturated += sample.saturation_error is not None
        if config.takes('ka'):
            self._term_saturation.add(sample.robust, config.ka, config.switching_in_force)

    def report(self, now: int, rejected: Mapping[str, int], simulated: bool,
               cause: str = '') -> list[tuple[int, str]]:
        """
        Return what goes wrong at present: level (1 warning, 2 error) and text.

        Parameters
        ----------
        now : int
            Time [ns].
        rejected : mapping
            Messages rejected so far, by kind.
        simulated : bool
            Whether time is simulated: then it is no matter how late states come.
        cause : str
            What is known to be the cause of late and skipped states; '' where nothing is.

        """
        before, self._rejected = self._rejected, {
            kind: n for kind, n in rejected.items() if kind != _UNRELATED}
        total = sum(self._rejected.values())
        self.rates.note(now, self.restarts, total, self.taken + total, ', '.join(
            kind for kind, n in self._rejected.items() if n > before.get(kind, 0)))
        self.skips.note(now, 0, self.skipped, self.taken + self.skipped, '')
        self.sample_rate.rotate()
        found = []
        for monitor in (self.rates, self.skips):
            monitor.cause = cause
            if monitor.level and not simulated:
                found.append((monitor.level, str(monitor)))
        if self.sample_rate.wrong:
            found.append((1, f'states come every {1e3 * self.sample_rate.mean:.3g} ms; '
                          f'control_period is {1e3 * seconds(self._period):g} ms'))
        found += [(1, f'{name}: {joint}') for name, joint in zip(
            self._names, self._term_saturation.found()) if joint.cause]
        self._term_saturation.clear()
        if self._config is not None:
            found += [(1, text) for text in unsafe_settings(self._config)]
        return found
