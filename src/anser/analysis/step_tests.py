"""Step tests of the autopilot's loops.

Commands, durations and published tests; and the result of a flown test with its figures and requirements.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, NamedTuple, get_args

import numpy as np
import xarray as xr

from anser.control.inversion_autopilot import Loop
from anser.results.dataset import surface_names
from anser.results.documents import finite_or_none
from anser.simulation.response import StepMetrics
from anser.variables import CATALOGUE

STEP_S = 0.01
"""Sampling period of the autopilot."""

CHANNEL_KEYS: Mapping[Loop, Mapping[str, str]] = MappingProxyType(
    {
        "rates": MappingProxyType({"p": "roll_rate", "q": "pitch_rate", "r": "yaw_rate"}),
        "attitude": MappingProxyType({"mu": "bank", "alpha": "alpha", "beta": "beta"}),
        "velocity": MappingProxyType({"v": "airspeed", "gamma": "path_angle", "chi": "course"}),
    }
)
"""Each loop's three channels and their keys in `anser.variables.CATALOGUE`, from the innermost loop outwards."""

_DURATION_S: Mapping[Loop, float] = MappingProxyType({"rates": 3.0, "attitude": 6.0, "velocity": 60.0})
"""How long a step is flown. The velocity loop's K_I works off what it gathered with a time constant of 40 s."""

_READ_YAW_AT_S = 1.05
"""A held yaw rate builds sideslip until the rudder stands at its stop, from 1.27 s on: it is read before."""

_DURATION_MIN_S, _DURATION_MAX_S = 0.2, 600.0
_LARGEST = MappingProxyType({"deg/s": 120.0, "deg": 170.0, "m/s": 150.0})


class LoopTimeScale(NamedTuple):
    """How many times slower the loops of an aircraft are than the published ones of the F-16."""

    rates: float = 1.0
    attitude: float = 1.0
    velocity: float = 1.0


PUBLISHED_TIME_SCALE = LoopTimeScale()


@dataclass(frozen=True)
class StepTest:
    """A step commanded to one loop that holds a trim point.

    Attributes
    ----------
    key
        Name for files: `rates-p`, `attitude-together`.
    loop
        Which loop is commanded; those inside it are closed.
    size
        Step of its three channels, deg/s, deg or m/s; 0 for those that are to stay.
    duration_s
        How long it is flown.
    read_at_s
        Up to when its figures are taken.
    """

    key: str
    loop: Loop
    size: tuple[float, float, float]
    duration_s: float
    read_at_s: float

    @property
    def commanded(self) -> dict[str, float]:
        """Channels that step, and their sizes."""
        return {c: size for c, size in zip(CHANNEL_KEYS[self.loop], self.size, strict=True) if size != 0.0}


def unit_of_channel(channel: str) -> str:
    """Unit of a channel's step: deg/s, deg or m/s."""
    return "m/s" if channel == "v" else "deg/s" if channel in CHANNEL_KEYS["rates"] else "deg"


def step_test(
    loop: str, sizes: Mapping[str, float], duration_s: float | None = None, pace: LoopTimeScale = PUBLISHED_TIME_SCALE
) -> StepTest:
    """Build a test of one or more channels of a loop.

    Parameters
    ----------
    loop
        One of `CHANNEL_KEYS`.
    sizes
        Channel -> size of its step, deg/s, deg or m/s.
    duration_s
        How long it is flown and read; None: as the published tests, longer by `pace`; a yaw rate up to the
        reading only.
    pace
        Of the aircraft.

    Raises
    ------
    ValueError
        The text begins with what is wrong: loop, channel, size or duration-s.
    """
    known = next((name for name in get_args(Loop) if name == loop), None)
    if known is None:
        raise ValueError(f"loop: arrived {loop!r}; expected one of {', '.join(CHANNEL_KEYS)}")
    channels = CHANNEL_KEYS[known]
    if not sizes:
        raise ValueError(f"channel: arrived none; expected one or more of {', '.join(channels)} for --loop {loop}")
    for channel, size in sizes.items():
        if channel not in channels:
            raise ValueError(f"channel: arrived {channel!r}; expected one of {', '.join(channels)} for --loop {loop}")
        largest = _LARGEST[unit_of_channel(channel)]
        if not 0.0 < abs(size) <= largest:
            unit = unit_of_channel(channel)
            raise ValueError(
                f"size: arrived {size:g} for {channel}; expected {-largest:g} to {largest:g} {unit}, and not 0"
            )
    if duration_s is None:
        duration_s = _paced(_READ_YAW_AT_S if "r" in sizes else _DURATION_S[known], known, pace)
    if not _DURATION_MIN_S <= duration_s <= _DURATION_MAX_S:
        raise ValueError(
            f"duration-s: arrived {duration_s:g}; expected a number from {_DURATION_MIN_S:g} to {_DURATION_MAX_S:g}"
        )
    first, second, third = (float(sizes.get(channel, 0.0)) for channel in channels)
    which = "-".join(channel for channel in channels if channel in sizes)
    return StepTest(f"{loop}-{which}", known, (first, second, third), duration_s, duration_s)


def _paced(duration_s: float, loop: Loop, pace: LoopTimeScale) -> float:
    """A duration in whole samples, by how slow a loop is."""
    return round(duration_s * getattr(pace, loop) / STEP_S) * STEP_S


def _each_and_all(
    loop: Loop, sizes: tuple[float, float, float], pace: LoopTimeScale = PUBLISHED_TIME_SCALE
) -> tuple[StepTest, ...]:
    """Each channel of a loop alone, then all together; channels of size 0 are left out."""
    duration = _paced(_DURATION_S[loop], loop, pace)
    tests = []
    for k, channel in enumerate((*CHANNEL_KEYS[loop], "together")):
        first, second, third = (size if k in (j, 3) else 0.0 for j, size in enumerate(sizes))
        if first == second == third == 0.0:
            continue
        read = _paced(_READ_YAW_AT_S, loop, pace) if loop == "rates" and third else duration
        tests.append(StepTest(f"{loop}-{channel}", loop, (first, second, third), duration, read))
    return tuple(tests)


def scaled_step_tests(
    pace: LoopTimeScale, attitude: tuple[float, float, float], velocity: tuple[float, float, float]
) -> tuple[StepTest, ...]:
    """The published tests with other sizes of steps, as much longer as the loops are slower.

    Steps of the rates become as much smaller, so that they turn an aircraft by the same angle.
    """
    rate = round(10.0 / pace.rates, 2)
    return (
        *_each_and_all("rates", (rate, rate, rate), pace),
        *_each_and_all("attitude", attitude, pace),
        *_each_and_all("velocity", velocity, pace),
    )


PUBLISHED_STEPS: tuple[StepTest, ...] = (
    *_each_and_all("rates", (10.0, 10.0, 10.0)),
    *_each_and_all("attitude", (30.0, 5.0, 5.0)),
    *_each_and_all("velocity", (10.0, 3.0, 20.0)),
)
"""The published step tests of the three loops (theory section 5), each channel alone and all together."""


STEP_FORMAT_VERSION = 1
"""Version of the document that `step_document` makes; it changes when a field changes its meaning or goes."""

_OVERSHOOT_MAX = 0.10
_FINAL_ERROR_MAX = 0.01
_SIDESLIP_MAX_DEG = 1.0
"""What the published responses must keep to; the last in steps of the velocity loop."""

_FACTORS = {variable.key: variable.factor for variable in CATALOGUE}


@dataclass(frozen=True)
class StepTestResult:
    """A step test that was flown.

    Attributes
    ----------
    test
        What was commanded.
    dataset
        Outputs of all three loops, commands of the stepped one, surfaces, throttle and power over time, named and
        labelled as in `anser.variables.catalogue`; the attributes say what flew where.
    metrics
        Figures up to the reading, SI units and radians.
    """

    test: StepTest
    dataset: xr.Dataset
    metrics: StepMetrics

    @property
    def sideslip_max_deg(self) -> float:
        """Greatest sideslip up to the reading."""
        return float(np.abs(self._read("beta_deg")).max())

    @property
    def left_tables(self) -> bool:
        """Whether it left the aerodynamic tables before the reading."""
        return bool(self._read("outside_tables").any())

    @property
    def shortfalls(self) -> tuple[str, ...]:
        """What the published responses must keep to and this one does not; empty where it keeps to all."""
        found, m = [], self.metrics
        for k, channel in enumerate(CHANNEL_KEYS[self.test.loop]):
            overshoot, error = float(m.overshoot[k]), float(m.final_error[k])
            # "not <=": a response that ends in no number at all falls short too.
            if not overshoot <= _OVERSHOOT_MAX:
                found.append(f"{channel} overshoots by {100 * overshoot:.1f} %, more than {100 * _OVERSHOOT_MAX:g} %")
            if not abs(error) <= _FINAL_ERROR_MAX:
                found.append(f"{channel} ends {100 * error:.2f} % off, more than {100 * _FINAL_ERROR_MAX:g} %")
        if self.test.loop == "velocity" and not self.sideslip_max_deg <= _SIDESLIP_MAX_DEG:
            found.append(f"sideslip reaches {self.sideslip_max_deg:.2f} deg, more than {_SIDESLIP_MAX_DEG:g} deg")
        if self.left_tables:
            found.append("it leaves the aerodynamic tables")
        return tuple(found)

    def _read(self, name: str) -> np.ndarray:
        return self.dataset[name].values[: round(self.test.read_at_s / STEP_S) + 1]

    def document(self) -> dict[str, Any]:
        """Figures in plain data, with units in the names; None for a time that never came."""
        m, channels = self.metrics, list(CHANNEL_KEYS[self.test.loop])
        stepped = {
            channel: {
                "unit": unit_of_channel(channel),
                "size": self.test.size[k],
                "rise_time_s": finite_or_none(m.rise_time[k]),
                "settling_time_s": finite_or_none(m.settling_time[k]),
                "overshoot_percent": finite_or_none(100 * m.overshoot[k]),
                "final_error_percent": finite_or_none(100 * m.final_error[k]),
            }
            for k, channel in enumerate(channels)
            if self.test.size[k] != 0.0
        }
        factors = [_FACTORS[key] for key in CHANNEL_KEYS[self.test.loop].values()]
        coupling = {
            channel: {"unit": unit_of_channel(channel), "greatest": finite_or_none(factors[k] * m.coupling[k])}
            for k, channel in enumerate(channels)
            if channel not in stepped
        }
        return {
            "key": self.test.key,
            "loop": self.test.loop,
            "duration_s": self.test.duration_s,
            "read_at_s": self.test.read_at_s,
            "channels": stepped,
            "coupling": coupling,
            "sideslip_max_deg": finite_or_none(self.sideslip_max_deg),
            "surface_use_percent": {
                name: finite_or_none(100 * m.surface_utilization[k])
                for k, name in enumerate(surface_names(self.dataset))
            },
            "shortfalls": list(self.shortfalls),
        }


def step_document(flights: Sequence[StepTestResult]) -> dict[str, Any]:
    """Figures of several flights from one trim point in plain data, for JSON."""
    about = ("aircraft", "variant", "speed_m_s", "altitude_m", "inversion")
    return {
        "format_version": STEP_FORMAT_VERSION,
        **{name: flights[0].dataset.attrs[name] for name in about if name in flights[0].dataset.attrs},
        "limits": {
            "overshoot_percent": 100 * _OVERSHOOT_MAX,
            "final_error_percent": 100 * _FINAL_ERROR_MAX,
            "sideslip_in_velocity_steps_deg": _SIDESLIP_MAX_DEG,
        },
        "steps": [flight.document() for flight in flights],
    }
