"""Step tests of the autopilot's loops: commands, durations, published tests, and results with requirements."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, get_args

import numpy as np
import xarray as xr

from anser.control.inversion_autopilot import Loop
from anser.results.dataset import surface_names
from anser.results.documents import finite_or_none
from anser.simulation.response import StepMetrics
from anser.variables import CATALOGUE

STEP_S = 0.01
"""Sampling period of the autopilot, s."""

CHANNEL_KEYS: Mapping[Loop, Mapping[str, str]] = {
    "rates": {"p": "roll_rate", "q": "pitch_rate", "r": "yaw_rate"},
    "attitude": {"mu": "bank", "alpha": "alpha", "beta": "beta"},
    "velocity": {"v": "airspeed", "gamma": "path_angle", "chi": "course"},
}
"""For each loop, innermost first, its three channels, each with the key of the variable in the catalogue."""

_DURATION_S: Mapping[Loop, float] = {"rates": 3.0, "attitude": 6.0, "velocity": 60.0}
"""Durations of the published tests of each loop, s; the velocity loop's integrator has a time constant of 40 s."""

_READ_YAW_AT_S = 1.05
"""End of the interval from which the metrics of a yaw-rate step are computed, s.

A constant yaw rate builds up sideslip until the rudder reaches its stop at 1.27 s; the interval ends before."""

_DURATION_MIN_S, _DURATION_MAX_S = 0.2, 600.0
_SIZE_MAX = {"deg/s": 120.0, "deg": 170.0, "m/s": 150.0}


class LoopTimeScale(NamedTuple):
    """Time constants of an aircraft's loops relative to the published loops of the F-16; above 1: slower."""

    rates: float = 1.0
    attitude: float = 1.0
    velocity: float = 1.0


PUBLISHED_TIME_SCALE = LoopTimeScale()


@dataclass(frozen=True)
class StepTest:
    """Step of the command to one loop of the autopilot, starting in trimmed flight."""

    key: str  #: Name of the test, for files: `rates-p`, `attitude-together`.
    loop: Loop  #: Commanded loop; the inner loops are closed.
    size: tuple[float, float, float]  #: Steps of the loop's three channels, deg/s, deg or m/s; 0: no step.
    duration_s: float  #: Duration of the flight, s.
    read_at_s: float  #: End of the interval from which rise time, overshoot and so on are computed, s.

    @property
    def commanded(self) -> dict[str, float]:
        """Step sizes (deg/s, deg or m/s) of the stepped channels, by channel."""
        return {c: size for c, size in zip(CHANNEL_KEYS[self.loop], self.size, strict=True) if size != 0.0}


def _unit_of_channel(channel: str) -> str:
    return "m/s" if channel == "v" else "deg/s" if channel in CHANNEL_KEYS["rates"] else "deg"


def step_test(
    loop: str,
    sizes: Mapping[str, float],
    duration_s: float | None = None,
    time_scale: LoopTimeScale = PUBLISHED_TIME_SCALE,
) -> StepTest:
    """Build a test with steps of one or more channels of a loop.

    Raises ValueError if an argument is not valid; the message begins with the name of the invalid input: loop, channel,
    size or duration-s.

    Parameters
    ----------
    loop
        "rates", "attitude" or "velocity".
    sizes
        Step by channel: p, q, r (deg/s), mu, alpha, beta (deg), or v (m/s), gamma, chi (deg).
    duration_s
        Duration, s, 0.2 to 600. None: 3 s for rates (1.05 s with a step of r, before the rudder reaches its stop), 6 s
        for attitude, 60 s for velocity, each times the time scale of the loop.
    time_scale
        Time constants of the aircraft's loops relative to the published loops of the F-16.
    """
    known_loop = next((name for name in get_args(Loop) if name == loop), None)
    if known_loop is None:
        raise ValueError(f"loop: arrived {loop!r}; expected one of {', '.join(CHANNEL_KEYS)}")
    channels = CHANNEL_KEYS[known_loop]
    if not sizes:
        raise ValueError(f"channel: arrived none; expected one or more of {', '.join(channels)} for --loop {loop}")
    for channel, size in sizes.items():
        if channel not in channels:
            raise ValueError(f"channel: arrived {channel!r}; expected one of {', '.join(channels)} for --loop {loop}")
        unit = _unit_of_channel(channel)
        largest = _SIZE_MAX[unit]
        if not 0.0 < abs(size) <= largest:
            raise ValueError(
                f"size: arrived {size:g} for {channel}; expected {-largest:g} to {largest:g} {unit}, and not 0"
            )
    if duration_s is None:
        published_duration_s = _READ_YAW_AT_S if "r" in sizes else _DURATION_S[known_loop]
        duration_s = _scaled_duration(published_duration_s, known_loop, time_scale)
    if not _DURATION_MIN_S <= duration_s <= _DURATION_MAX_S:
        raise ValueError(
            f"duration-s: arrived {duration_s:g}; expected a number from {_DURATION_MIN_S:g} to {_DURATION_MAX_S:g}"
        )
    size_1, size_2, size_3 = (float(sizes.get(channel, 0.0)) for channel in channels)
    stepped_channels = "-".join(channel for channel in channels if channel in sizes)
    return StepTest(f"{loop}-{stepped_channels}", known_loop, (size_1, size_2, size_3), duration_s, duration_s)


def _scaled_duration(duration_s: float, loop: Loop, time_scale: LoopTimeScale) -> float:
    """Return a duration (s) times the time scale of a loop, rounded to a multiple of `STEP_S`."""
    return round(duration_s * getattr(time_scale, loop) / STEP_S) * STEP_S


def _each_and_all(loop: Loop, sizes: tuple[float, float, float], time_scale: LoopTimeScale) -> tuple[StepTest, ...]:
    """Return the tests of a loop: each channel with a nonzero step alone, then all channels together."""
    duration = _scaled_duration(_DURATION_S[loop], loop, time_scale)
    tests = []
    for k, channel in enumerate((*CHANNEL_KEYS[loop], "together")):
        size_1, size_2, size_3 = (size if k in (j, 3) else 0.0 for j, size in enumerate(sizes))
        if size_1 == size_2 == size_3 == 0.0:
            continue
        read = _scaled_duration(_READ_YAW_AT_S, loop, time_scale) if loop == "rates" and size_3 else duration
        tests.append(StepTest(f"{loop}-{channel}", loop, (size_1, size_2, size_3), duration, read))
    return tuple(tests)


def scaled_step_tests(
    time_scale: LoopTimeScale, attitude: tuple[float, float, float], velocity: tuple[float, float, float]
) -> tuple[StepTest, ...]:
    """Return the published step tests, scaled to an aircraft: each channel of each loop alone, then together.

    Durations are multiplied by the time scales of the loops. Steps of the body rates (10 deg/s) are divided by the time
    scale, which keeps the angle. `attitude`: steps of mu, alpha, beta (deg); `velocity`: steps of airspeed (m/s), path
    angle and course (deg). A channel of size 0 has no test.
    """
    rate = round(10.0 / time_scale.rates, 2)
    return (
        *_each_and_all("rates", (rate, rate, rate), time_scale),
        *_each_and_all("attitude", attitude, time_scale),
        *_each_and_all("velocity", velocity, time_scale),
    )


PUBLISHED_STEPS = scaled_step_tests(PUBLISHED_TIME_SCALE, attitude=(30.0, 5.0, 5.0), velocity=(10.0, 3.0, 20.0))
"""Published step tests of the F-16's three loops (theory section 5), each channel alone and all together."""


STEP_FORMAT_VERSION = 1
"""Version of the format of `step_document`; increases when a field is removed or changes meaning."""

_OVERSHOOT_MAX = 0.10
_FINAL_ERROR_MAX = 0.01
_SIDESLIP_MAX_DEG = 1.0
"""Requirements on the responses: overshoot and final error as fractions of the step, sideslip for the velocity loop."""

_FACTORS = {variable.key: variable.factor for variable in CATALOGUE}


@dataclass(frozen=True)
class StepTestResult:
    """Result of a flown step test: time histories, and metrics of the response."""

    test: StepTest
    # outputs of the three loops, commands of the stepped loop, surfaces, throttle and power over time, named and
    # labelled as in `anser.variables.catalogue`; aircraft and condition are attributes
    dataset: xr.Dataset
    metrics: StepMetrics  # metrics of the response up to `read_at_s`, SI units and radians

    @property
    def sideslip_max_deg(self) -> float:
        """Greatest magnitude of the sideslip up to `read_at_s`, deg."""
        return float(np.abs(self._read("beta_deg")).max())

    @property
    def left_tables(self) -> bool:
        """Whether the flight left the range of the aircraft's data by `read_at_s`."""
        return bool(self._read("outside_tables").any())

    @property
    def shortfalls(self) -> tuple[str, ...]:
        """Sentences on violated requirements: overshoot, final error, sideslip, range of the data; empty if none."""
        shortfalls, metrics = [], self.metrics
        for k, channel in enumerate(CHANNEL_KEYS[self.test.loop]):
            overshoot, error = float(metrics.overshoot[k]), float(metrics.final_error[k])
            # "not <=": a response that ends in NaN violates the requirement too.
            if not overshoot <= _OVERSHOOT_MAX:
                excess = f"{100 * overshoot:.1f} %, more than {100 * _OVERSHOOT_MAX:g} %"
                shortfalls.append(f"{channel} overshoots by {excess}")
            if not abs(error) <= _FINAL_ERROR_MAX:
                shortfalls.append(f"{channel} ends {100 * error:.2f} % off, more than {100 * _FINAL_ERROR_MAX:g} %")
        if self.test.loop == "velocity" and not self.sideslip_max_deg <= _SIDESLIP_MAX_DEG:
            shortfalls.append(f"sideslip reaches {self.sideslip_max_deg:.2f} deg, more than {_SIDESLIP_MAX_DEG:g} deg")
        if self.left_tables:
            shortfalls.append("it leaves the aerodynamic tables")
        return tuple(shortfalls)

    def _read(self, name: str) -> np.ndarray:
        return self.dataset[name].values[: round(self.test.read_at_s / STEP_S) + 1]

    def document(self) -> dict[str, Any]:
        """Return test and metrics as plain data for JSON, units in the names; a time that is never reached is None."""
        metrics, channels = self.metrics, list(CHANNEL_KEYS[self.test.loop])
        stepped = {
            channel: {
                "unit": _unit_of_channel(channel),
                "size": self.test.size[k],
                "rise_time_s": finite_or_none(metrics.rise_time[k]),
                "settling_time_s": finite_or_none(metrics.settling_time[k]),
                "overshoot_percent": finite_or_none(100 * metrics.overshoot[k]),
                "final_error_percent": finite_or_none(100 * metrics.final_error[k]),
            }
            for k, channel in enumerate(channels)
            if self.test.size[k] != 0.0
        }
        factors = [_FACTORS[key] for key in CHANNEL_KEYS[self.test.loop].values()]
        coupling = {
            channel: {"unit": _unit_of_channel(channel), "greatest": finite_or_none(factors[k] * metrics.coupling[k])}
            for k, channel in enumerate(channels)
            if channel not in stepped
        }
        surface_use = [finite_or_none(100 * use) for use in metrics.surface_utilization]
        return {
            "key": self.test.key,
            "loop": self.test.loop,
            "duration_s": self.test.duration_s,
            "read_at_s": self.test.read_at_s,
            "channels": stepped,
            "coupling": coupling,
            "sideslip_max_deg": finite_or_none(self.sideslip_max_deg),
            "surface_use_percent": dict(zip(surface_names(self.dataset), surface_use, strict=True)),
            "shortfalls": list(self.shortfalls),
        }


def step_document(flights: Sequence[StepTestResult]) -> dict[str, Any]:
    """Return the metrics of several step tests from one trim point, and the requirements, as plain data for JSON."""
    attribute_names = ("aircraft", "variant", "speed_m_s", "altitude_m", "inversion")
    return {
        "format_version": STEP_FORMAT_VERSION,
        **{name: flights[0].dataset.attrs[name] for name in attribute_names if name in flights[0].dataset.attrs},
        "limits": {
            "overshoot_percent": 100 * _OVERSHOOT_MAX,
            "final_error_percent": 100 * _FINAL_ERROR_MAX,
            "sideslip_in_velocity_steps_deg": _SIDESLIP_MAX_DEG,
        },
        "steps": [flight.document() for flight in flights],
    }
