"""Input signals of flight tests: step, doublet, 3-2-1-1, sine sweep and multisine, as functions of time."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

TimeHistory = Float[np.ndarray, " time"]


@dataclass(frozen=True)
class InputSignal:
    """Increment of one control input over time; signals can be added, and multiplied by a number.

    Attributes
    ----------
    values
        Function from times, s, to increments, in the unit of the input: degrees for a surface, 0..1 for the throttle.
    description
        Text for labels and provenance.
    """

    values: Callable[[TimeHistory], TimeHistory]
    description: str

    def __call__(self, time_s: Sequence[float] | TimeHistory) -> TimeHistory:
        """Return the increments at times, s."""
        return self.values(np.asarray(time_s, dtype=float))

    def __add__(self, other: "InputSignal") -> "InputSignal":
        if not isinstance(other, InputSignal):
            return NotImplemented
        return InputSignal(lambda t: self.values(t) + other.values(t), f"{self.description} + {other.description}")

    def __neg__(self) -> "InputSignal":
        return -1.0 * self

    def __sub__(self, other: "InputSignal") -> "InputSignal":
        return self + (-other)

    def __mul__(self, factor: float) -> "InputSignal":
        if not isinstance(factor, int | float | np.number):
            return NotImplemented
        return InputSignal(lambda t: factor * self.values(t), f"{factor:g} ({self.description})")

    __rmul__ = __mul__


def step_input(amplitude: float, start_s: float = 1.0) -> InputSignal:
    """Return a step by `amplitude` at `start_s`."""
    _require_finite("amplitude", amplitude)
    _require_finite("start_s", start_s)
    return _pulses((amplitude,), (np.inf,), start_s, f"step of {amplitude:g} at {start_s:g} s")


def doublet(amplitude: float, start_s: float = 1.0, width_s: float = 1.0) -> InputSignal:
    """Return a doublet: a pulse by `amplitude`, then by minus `amplitude`, each `width_s` long."""
    _require_pulse(amplitude, start_s, width_s)
    description = f"doublet of {amplitude:g} at {start_s:g} s, pulses of {width_s:g} s"
    return _pulses((amplitude, -amplitude), (width_s, width_s), start_s, description)


def three_two_one_one(amplitude: float, start_s: float = 1.0, width_s: float = 0.7) -> InputSignal:
    """Return a 3-2-1-1: pulses of alternating sign with lengths of 3, 2, 1 and 1 times `width_s`.

    Source: Klein and Morelli, Aircraft System Identification (2006), chapter 9.
    """
    _require_pulse(amplitude, start_s, width_s)
    description = f"3-2-1-1 of {amplitude:g} at {start_s:g} s, unit of {width_s:g} s"
    widths = (3.0 * width_s, 2.0 * width_s, width_s, width_s)
    return _pulses((amplitude, -amplitude, amplitude, -amplitude), widths, start_s, description)


def _require_pulse(amplitude: float, start_s: float, width_s: float) -> None:
    _require_finite("amplitude", amplitude)
    _require_finite("start_s", start_s)
    _require_positive("width_s", width_s)


def _pulses(amplitudes: Sequence[float], widths_s: Sequence[float], start_s: float, description: str) -> InputSignal:
    edges_s = start_s + np.concatenate([[0.0], np.cumsum(widths_s)])
    levels = np.array([0.0, *amplitudes, 0.0])
    # A time within rounding of an edge belongs to the pulse after the edge.
    return InputSignal(lambda t: levels[np.searchsorted(edges_s, t + 1e-9, side="right")], description)


def sine_sweep(
    amplitude: float,
    frequencies_hz: tuple[float, float],
    duration_s: float,
    start_s: float = 1.0,
) -> InputSignal:
    """Return a sine whose frequency rises exponentially from the first to the second of `frequencies_hz`.

    Equal time is spent in each octave. The signal is zero before `start_s` and after `duration_s` more.
    """
    low, high = _frequencies(frequencies_hz)
    _require_finite("amplitude", amplitude)
    _require_positive("duration_s", duration_s)
    rate = np.log(high / low) / duration_s

    def values(time_s: TimeHistory) -> TimeHistory:
        t = np.clip(time_s - start_s, 0.0, duration_s)
        phase = 2.0 * np.pi * low * (t if rate == 0.0 else np.expm1(rate * t) / rate)
        return np.where((time_s >= start_s) & (time_s <= start_s + duration_s), amplitude * np.sin(phase), 0.0)

    return InputSignal(values, f"sweep of {amplitude:g} from {low:g} to {high:g} Hz in {duration_s:g} s")


def multisine(
    amplitude: float,
    frequencies_hz: tuple[float, float],
    duration_s: float,
    start_s: float = 1.0,
    *,
    channel: int = 0,
    channels: int = 1,
) -> InputSignal:
    """Return a sum of harmonics of 1 / `duration_s` between two frequencies, with the phases of Schroeder (1970).

    The harmonics are dealt out in turn to `channels` inputs; signals of different `channel` with the same duration are
    orthogonal, so that several surfaces can move at once. The sum is scaled to a greatest magnitude of `amplitude` and
    shifted to a zero crossing, so that it starts near zero.

    Parameters
    ----------
    amplitude
        Greatest magnitude.
    frequencies_hz
        Least and greatest frequency.
    duration_s
        Period of the signal, after which it is zero.
    start_s
        Start of the signal.
    channel, channels
        Index of this input, from 0, and number of inputs that share the harmonics.
    """
    low, high = _frequencies(frequencies_hz)
    _require_finite("amplitude", amplitude)
    _require_positive("duration_s", duration_s)
    if not 0 <= channel < channels:
        raise ValueError(f"channel: arrived {channel} of {channels} channels; expected 0 to {channels - 1}")
    first, last = int(np.ceil(low * duration_s - 1e-9)), int(np.floor(high * duration_s + 1e-9))
    harmonics = np.arange(max(first, 1), last + 1)[channel::channels]
    if harmonics.size == 0:
        raise ValueError(
            f"frequencies_hz: arrived {low:g} to {high:g} Hz with a duration of {duration_s:g} s; expected a range "
            f"with a harmonic of {1.0 / duration_s:g} Hz for each of {channels} channels"
        )
    k = np.arange(1, harmonics.size + 1)
    phases = -np.pi * k * (k - 1) / harmonics.size

    def raw(t: TimeHistory) -> TimeHistory:
        angles = 2.0 * np.pi * harmonics[:, None] * np.atleast_1d(t)[None, :] / duration_s + phases[:, None]
        return np.sum(np.cos(angles), axis=0)

    grid = np.linspace(0.0, duration_s, 64 * int(harmonics[-1]) + 1)
    samples = raw(grid)
    rising = np.flatnonzero((samples[:-1] <= 0.0) & (samples[1:] > 0.0))[0]
    fraction = samples[rising] / (samples[rising] - samples[rising + 1])
    zero = grid[rising] + fraction * (grid[1] - grid[0])
    scale = amplitude / np.max(np.abs(samples))

    def values(time_s: TimeHistory) -> TimeHistory:
        is_active = (time_s >= start_s) & (time_s < start_s + duration_s)
        return np.where(is_active, scale * raw(time_s - start_s + zero), 0.0)

    lines = f"{harmonics[0] / duration_s:g} to {harmonics[-1] / duration_s:g} Hz"
    return InputSignal(values, f"multisine of {amplitude:g}, {harmonics.size} harmonics from {lines}")


def _frequencies(frequencies_hz: tuple[float, float]) -> tuple[float, float]:
    if not isinstance(frequencies_hz, tuple | list) or len(frequencies_hz) != 2:
        raise ValueError(f"frequencies_hz: arrived {frequencies_hz!r}; expected a pair: (least, greatest)")
    low, high = (float(frequency) for frequency in frequencies_hz)
    if not 0.0 < low <= high < np.inf:
        raise ValueError(f"frequencies_hz: arrived {low:g} and {high:g}; expected two positive frequencies that rise")
    return low, high


def _require_positive(name: str, value: float) -> None:
    if not isinstance(value, int | float | np.number) or not 0.0 < value < np.inf:
        raise ValueError(f"{name}: arrived {value!r}; expected a positive number")


def _require_finite(name: str, value: float) -> None:
    if not isinstance(value, int | float | np.number) or not np.isfinite(value):
        raise ValueError(f"{name}: arrived {value!r}; expected a finite number")


_SIGNALS: dict[str, Callable[..., InputSignal]] = {
    "step": step_input,
    "doublet": doublet,
    "3211": three_two_one_one,
}


def parse_signal(text: str) -> InputSignal:
    """Return the signal of a text SIGNAL:AMPLITUDE[:START_S[:WIDTH_S]], such as `doublet:1:2`.

    Raises
    ------
    ValueError
        The signal is unknown, or a number is missing or wrong.
    """
    name, *texts = text.split(":")
    try:
        numbers = [float(number) for number in texts]
    except ValueError:
        numbers = []
    count_max = 2 if name == "step" else 3
    if name not in _SIGNALS or not 1 <= len(numbers) <= count_max or len(numbers) != len(texts):
        expected = (
            "step:AMPLITUDE[:START_S], doublet:AMPLITUDE[:START_S[:WIDTH_S]] or 3211:AMPLITUDE[:START_S[:WIDTH_S]]"
        )
        raise ValueError(f"arrived {text!r} as the signal; expected {expected}")
    return _SIGNALS[name](*numbers)
