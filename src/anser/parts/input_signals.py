"""Input signals of flight tests: step, doublet, 3-2-1-1, sine sweep and multisine, as functions of time."""

import abc
import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Self

import equinox as eqx
import numpy as np
from jaxtyping import Float

from anser.numerics.arrays import namespace
from anser.numerics.multisine_phases import multisine_phases, sum_of_harmonics
from anser.shapes import ScalarLike, Vector

TimeHistory = Float[np.ndarray, " time"]


class AbstractSignal(eqx.Module):
    """Signal as a function of time, in any unit; compiled flights can take the signal as an argument."""

    @abc.abstractmethod
    def at(self, time: Any) -> Any:
        """Return the values at times (s), a number or an array: NumPy outside of compiled code, JAX inside."""

    @abc.abstractmethod
    def scaled(self, factor: float) -> Self:
        """Return the signal multiplied by a factor."""

    def highest_frequency(self) -> float:
        """Return the highest frequency of the signal's sines, Hz; 0 if the signal has no sines."""
        return 0.0

    def shortest_pulse(self) -> float:
        """Return the shortest time between two changes of a piecewise constant signal, s; infinite if there is none."""
        return np.inf


class PulseSignal(AbstractSignal):
    """Piecewise constant signal, 0 at first, with changes by `jumps` at the times `edges` (s)."""

    edges: Vector | np.ndarray
    jumps: Vector | np.ndarray

    def at(self, time: Any) -> Any:
        """Return the values at times (s); a time within rounding of an edge counts as after the edge."""
        xp = namespace(time, self)
        t = xp.asarray(time)[..., None]
        tolerance = xp.maximum(_EDGE_TOLERANCE_S, _ROUNDINGS * np.finfo(t.dtype).eps * xp.abs(t))
        return xp.sum(xp.where(t + tolerance >= self.edges, self.jumps, 0.0), axis=-1)

    def scaled(self, factor: float) -> "PulseSignal":
        """Return the signal multiplied by a factor."""
        return PulseSignal(self.edges, self.jumps * factor)

    def shortest_pulse(self) -> float:
        """Return the shortest time between two changes, s; infinite for a single change."""
        return float(np.min(np.diff(self.edges), initial=np.inf))


class SweepSignal(AbstractSignal):
    """Sine of a frequency that rises exponentially, from `start` (s) for `duration` (s); 0 at other times.

    The frequency at the time t (s) after the start is `frequency` * exp(`rate` * t), in Hz.
    """

    amplitude: ScalarLike
    frequency: ScalarLike
    rate: ScalarLike
    start: ScalarLike
    duration: ScalarLike

    def at(self, time: Any) -> Any:
        """Return the values at times (s)."""
        xp = namespace(time, self)
        since = xp.asarray(time) - self.start
        t = xp.clip(since, 0.0, self.duration)
        rate = xp.where(self.rate == 0.0, 1.0, self.rate)
        cycles = self.frequency * xp.where(self.rate == 0.0, t, xp.expm1(rate * t) / rate)
        values = self.amplitude * xp.sin(2.0 * np.pi * cycles)
        return xp.where((since >= 0.0) & (since <= self.duration), values, 0.0)

    def scaled(self, factor: float) -> "SweepSignal":
        """Return the signal multiplied by a factor."""
        return eqx.tree_at(lambda s: s.amplitude, self, self.amplitude * factor)

    def highest_frequency(self) -> float:
        """Return the frequency at the end of the sweep, Hz."""
        return float(self.frequency * np.exp(self.rate * self.duration))


class SineSumSignal(AbstractSignal):
    """Sum of cosines from the time `start` (s) for `duration` (s); 0 at other times.

    Each cosine has an amplitude, a frequency (Hz) and a phase at the start (rad): one entry of the three arrays.
    """

    amplitudes: Vector | np.ndarray
    frequencies: Vector | np.ndarray
    phases: Vector | np.ndarray
    start: ScalarLike
    duration: ScalarLike

    def at(self, time: Any) -> Any:
        """Return the values at times (s)."""
        xp = namespace(time, self)
        since = xp.asarray(time) - self.start
        angles = 2.0 * np.pi * since[..., None] * self.frequencies + self.phases
        is_active = (since >= 0.0) & (since < self.duration)
        return xp.where(is_active, xp.sum(self.amplitudes * xp.cos(angles), axis=-1), 0.0)

    def scaled(self, factor: float) -> "SineSumSignal":
        """Return the signal multiplied by a factor."""
        return eqx.tree_at(lambda s: s.amplitudes, self, self.amplitudes * factor)

    def highest_frequency(self) -> float:
        """Return the frequency of the highest harmonic, Hz."""
        return float(np.max(self.frequencies))


class SignalSum(AbstractSignal):
    """Sum of signals."""

    terms: tuple[AbstractSignal, ...]

    def at(self, time: Any) -> Any:
        """Return the values at times (s)."""
        return functools.reduce(lambda total, term: total + term.at(time), self.terms[1:], self.terms[0].at(time))

    def scaled(self, factor: float) -> "SignalSum":
        """Return the sum multiplied by a factor."""
        return SignalSum(tuple(term.scaled(factor) for term in self.terms))

    def highest_frequency(self) -> float:
        """Return the highest frequency of the terms' sines, Hz."""
        return max(term.highest_frequency() for term in self.terms)

    def shortest_pulse(self) -> float:
        """Return the shortest time between two changes of a term, s."""
        return min(term.shortest_pulse() for term in self.terms)


_EDGE_TOLERANCE_S = 1e-9
_ROUNDINGS = 16


@dataclass(frozen=True)
class InputSignal:
    """Increment of one control input or command over time, in the unit of the input.

    Signals can be added, subtracted, and multiplied by a number.
    """

    #: The increment as a function of time, in the unit of the input: deg for a surface, a fraction for the throttle.
    signal: AbstractSignal
    description: str  #: Text for labels and provenance.

    def __call__(self, time_s: Sequence[float] | TimeHistory) -> TimeHistory:
        """Return the increments at times (s)."""
        return self.signal.at(np.asarray(time_s, dtype=float))

    def require_sampling(self, step_s: float, place: str) -> None:
        """Raise ValueError if the samples, every `step_s` seconds, cannot show the signal; `place` names the input.

        A sine must be at most as fast as half the sampling rate, a pulse at least as long as a step.
        """
        shortest_s = self.signal.shortest_pulse()
        if shortest_s < step_s * (1.0 - 1e-9):
            raise ValueError(f"{place}: arrived a pulse of {shortest_s:g} s; expected at least the step, {step_s:g} s")
        highest_hz = self.signal.highest_frequency()
        if highest_hz > 0.5 / step_s * (1.0 + 1e-9):
            raise ValueError(
                f"{place}: arrived a frequency of {highest_hz:g} Hz; expected at most {0.5 / step_s:g} Hz, half the "
                f"rate of the samples, with a step of {step_s:g} s"
            )

    def __add__(self, other: "InputSignal") -> "InputSignal":
        if not isinstance(other, InputSignal):
            return NotImplemented
        return InputSignal(SignalSum((self.signal, other.signal)), f"{self.description} + {other.description}")

    def __neg__(self) -> "InputSignal":
        return -1.0 * self

    def __sub__(self, other: "InputSignal") -> "InputSignal":
        return self + (-other)

    def __mul__(self, factor: float) -> "InputSignal":
        if not isinstance(factor, int | float | np.number):
            return NotImplemented
        return InputSignal(self.signal.scaled(float(factor)), f"{factor:g} ({self.description})")

    __rmul__ = __mul__


def step_input(amplitude: float, start_s: float = 1.0) -> InputSignal:
    """Return a step by `amplitude` (in the unit of the input) at the time `start_s`.

    Raises ValueError if a number is not finite or the start is negative.
    """
    _require_numbers(amplitude=amplitude, start_s=start_s)
    return _pulses((amplitude,), (np.inf,), start_s, f"step of {amplitude:g} at {start_s:g} s")


def doublet(amplitude: float, start_s: float = 1.0, width_s: float = 1.0) -> InputSignal:
    """Return a doublet: from `start_s`, a pulse of `amplitude`, then a pulse of -`amplitude`, each `width_s` long.

    The amplitude is in the unit of the input. Raises ValueError if a number is not finite, the start is negative, or
    the width is not positive.
    """
    _require_numbers(amplitude=amplitude, start_s=start_s, width_s=width_s)
    description = f"doublet of {amplitude:g} at {start_s:g} s, pulses of {width_s:g} s"
    return _pulses((amplitude, -amplitude), (width_s, width_s), start_s, description)


def three_two_one_one(amplitude: float, start_s: float = 1.0, width_s: float = 0.7) -> InputSignal:
    """Return a 3-2-1-1: four pulses of alternating sign from `start_s`, 3, 2, 1 and 1 times `width_s` long.

    The amplitude is in the unit of the input. Source: Klein and Morelli, Aircraft System Identification (2006), chapter
    9. Raises ValueError if a number is not finite, the start is negative, or the width is not positive.
    """
    _require_numbers(amplitude=amplitude, start_s=start_s, width_s=width_s)
    description = f"3-2-1-1 of {amplitude:g} at {start_s:g} s, unit of {width_s:g} s"
    widths = (3.0 * width_s, 2.0 * width_s, width_s, width_s)
    return _pulses((amplitude, -amplitude, amplitude, -amplitude), widths, start_s, description)


def _pulses(amplitudes: Sequence[float], widths_s: Sequence[float], start_s: float, description: str) -> InputSignal:
    edges_s = start_s + np.concatenate([[0.0], np.cumsum(widths_s)])
    jumps = np.diff([0.0, *amplitudes, 0.0])
    lasts = np.isfinite(edges_s)
    return InputSignal(PulseSignal(edges_s[lasts], jumps[lasts]), description)


def sine_sweep(
    amplitude: float, frequencies_hz: tuple[float, float], duration_s: float, start_s: float = 1.0
) -> InputSignal:
    """Return a sine sweep, with a frequency that rises exponentially from the first to the second of `frequencies_hz`.

    The sweep lasts from `start_s` for `duration_s`, with equal time in each octave; the signal is zero at other times.
    Raises ValueError if a frequency is not positive, the second frequency is below the first, amplitude or start is not
    finite, the start is negative, or the duration is not positive.
    """
    low, high = _frequencies(frequencies_hz)
    _require_numbers(amplitude=amplitude, duration_s=duration_s, start_s=start_s)
    numbers = np.array([amplitude, low, np.log(high / low) / duration_s, start_s, duration_s], dtype=float)
    signal = SweepSignal(*numbers)
    return InputSignal(signal, f"sweep of {amplitude:g} from {low:g} to {high:g} Hz in {duration_s:g} s")


def multisine(
    amplitude: float,
    frequencies_hz: tuple[float, float],
    duration_s: float,
    start_s: float = 1.0,
    *,
    channel: int = 0,
    channels: int = 1,
    power_exponent: float = 0.0,
) -> InputSignal:
    """Return a sum of harmonics of 1 / `duration_s` between two frequencies, with phases for a small peak factor.

    The harmonics are distributed in turn over `channels` inputs. Signals of different `channel` with the same duration
    are orthogonal, and can excite several surfaces at the same time. The signal starts near zero. The peak factor,
    relative to a single sine, is 1.0 to 1.15 for up to about 60 harmonics (optimized phases), and 1.2 to 1.5 for more
    harmonics (Schroeder's phases).

    Raises ValueError if an argument is out of range, or a channel gets no harmonic.

    Parameters
    ----------
    amplitude
        Greatest magnitude of the signal in the unit of the input, met to 0.1 percent.
    frequencies_hz
        Least and greatest frequency, Hz.
    duration_s
        Duration of the signal, and its period, s; the signal is zero before and after.
    start_s
        Start of the signal, s.
    channel, channels
        Index of this input, from 0, and number of inputs that share the harmonics.
    power_exponent
        The power of a harmonic is proportional to its frequency to this exponent; 0: equal powers, -1: about equal
        power in each octave.
    """
    low, high = _frequencies(frequencies_hz)
    _require_numbers(amplitude=amplitude, power_exponent=power_exponent, duration_s=duration_s, start_s=start_s)
    if not 0 <= channel < channels:
        raise ValueError(f"channel: arrived {channel} of {channels} channels; expected 0 to {channels - 1}")
    harmonics = multisine_harmonics((low, high), duration_s)[channel::channels]
    if harmonics.size == 0:
        raise ValueError(
            f"frequencies_hz: arrived {low:g} to {high:g} Hz with a duration of {duration_s:g} s; expected a range "
            f"with a harmonic of {1.0 / duration_s:g} Hz for each of {channels} channels"
        )
    amplitudes = (harmonics / harmonics[0]) ** (0.5 * power_exponent)
    phases = multisine_phases(tuple(harmonics.tolist()), tuple(amplitudes.tolist()))
    # grid: fractions of the period
    grid = np.linspace(0.0, 1.0, _SAMPLES_PER_PERIOD * int(harmonics[-1]) + 1)
    samples = sum_of_harmonics(harmonics, amplitudes, np.asarray(phases), grid)
    rising = np.flatnonzero((samples[:-1] <= 0.0) & (samples[1:] > 0.0))[0]
    fraction = samples[rising] / (samples[rising] - samples[rising + 1])
    zero = grid[rising] + fraction * (grid[1] - grid[0])
    signal = SineSumSignal(
        amplitudes * (amplitude / np.max(np.abs(samples))),
        harmonics / duration_s,
        np.asarray(phases) + 2.0 * np.pi * zero * harmonics,
        float(start_s),
        float(duration_s),
    )
    lines = f"{harmonics[0] / duration_s:g} to {harmonics[-1] / duration_s:g} Hz"
    return InputSignal(signal, f"multisine of {amplitude:g}, {harmonics.size} harmonics from {lines}")


def multisine_harmonics(frequencies_hz: tuple[float, float], duration_s: float) -> np.ndarray:
    """Return the numbers k >= 1 of all harmonics, k / `duration_s`, between two frequencies (Hz), ascending."""
    first, last = (np.ceil(frequencies_hz[0] * duration_s - 1e-9), np.floor(frequencies_hz[1] * duration_s + 1e-9))
    return np.arange(max(int(first), 1), int(last) + 1)


_SAMPLES_PER_PERIOD = 64
"""Samples per period of the highest harmonic, from which amplitude and zero crossings of a multisine are computed."""


def _frequencies(frequencies_hz: tuple[float, float]) -> tuple[float, float]:
    if not isinstance(frequencies_hz, tuple | list) or len(frequencies_hz) != 2:
        raise ValueError(f"frequencies_hz: arrived {frequencies_hz!r}; expected a pair: (least, greatest)")
    low, high = (float(frequency) for frequency in frequencies_hz)
    if not 0.0 < low <= high < np.inf:
        raise ValueError(f"frequencies_hz: arrived {low:g} and {high:g}; expected two positive frequencies that rise")
    return low, high


def _require_numbers(**numbers: float) -> None:
    """Raise ValueError, with the argument's name, for a number that is not finite or a time that is out of range."""
    for name, value in numbers.items():
        low, kind = (0.0, "positive") if name in ("duration_s", "width_s") else (-np.inf, "finite")
        is_number = isinstance(value, int | float | np.number)
        if is_number and name == "start_s" and -np.inf < value < 0.0:
            raise ValueError(f"{name}: arrived {value!r}; expected 0 or later, the signal within the flight")
        if not is_number or not low < value < np.inf:
            raise ValueError(f"{name}: arrived {value!r}; expected a {kind} number")


def parse_signal(text: str) -> InputSignal:
    """Return the signal that a text SIGNAL:AMPLITUDE[:START_S[:WIDTH_S]] describes, such as `doublet:1:2`.

    SIGNAL is step (without WIDTH_S), doublet or 3211. Raises ValueError if the signal is unknown, or a number is
    missing or wrong.
    """
    signals: dict[str, tuple[Callable[..., InputSignal], int]]  # function and greatest number of arguments
    signals = {"step": (step_input, 2), "doublet": (doublet, 3), "3211": (three_two_one_one, 3)}
    name, *texts = text.split(":")
    function, count_max = signals.get(name, (step_input, 0))
    try:
        numbers = [float(number) for number in texts]
    except ValueError:
        numbers = []
    if not 1 <= len(numbers) == len(texts) <= count_max:
        pulses = "doublet:AMPLITUDE[:START_S[:WIDTH_S]] or 3211:AMPLITUDE[:START_S[:WIDTH_S]]"
        raise ValueError(f"arrived {text!r} as the signal; expected step:AMPLITUDE[:START_S], {pulses}")
    return function(*numbers)
