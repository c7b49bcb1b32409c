"""Flights of step tests from level trim.

Flight point, gains, limits and step sizes that suit an aircraft, and one compiled batch for each loop.
"""

import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from jaxtyping import Array, Float

from anser.aircraft.air_data import air_data
from anser.aircraft.airframe import AbstractAirframe, AircraftState
from anser.aircraft.f16 import AbstractF16
from anser.aircraft.motion import flight_condition
from anser.analysis.airframes import valid_airspeed_range
from anser.analysis.step_tests import (
    CHANNEL_KEYS,
    PUBLISHED_STEPS,
    PUBLISHED_TIME_SCALE,
    STEP_S,
    LoopTimeScale,
    StepTest,
    StepTestResult,
    scaled_step_tests,
)
from anser.analysis.trim_points import ConditionError, Inversion, gains_for, resolve_airframe, steady_trim
from anser.compiling.options import compiled, enable_compilation_cache
from anser.control.allocation import deflection_for_moment, surface_moments
from anser.control.gains import AutopilotGains, automatic_gains
from anser.control.inversion_autopilot import Loop
from anser.control.limits import FlightLimits, default_limits
from anser.environment.environment import Environment, standard_environment
from anser.numerics.arrays import as_array
from anser.parts.perception import Instant
from anser.scenario.build_aircraft import DerivedDefaults, compute_defaults
from anser.shapes import Scalar
from anser.simulation.recorders import AbstractRecorder, AircraftSample
from anser.simulation.response import LoopCase, loop_flight, step_metrics
from anser.spatial.rotations import rotate, rotate_back, rotation_from_quaternion
from anser.spatial.wind_axes import bank_about_velocity, path_angles
from anser.steady.performance import ALPHA_RESERVE
from anser.steady.trim import TrimPoint, trim_target
from anser.units import DEG_RAD, RAD_DEG
from anser.variables import CATALOGUE, catalogue

_F16_SPEED_M_S, _ALTITUDE_M = 150.0, 1000.0
_PART = 0.5
"""Part of what an aircraft has left that a step takes at most."""
_PATH_TURN = 0.6
"""By how much a held step of the angle of attack may bend the path until it is read, rad: about what the published one
does. A slow aircraft would fly over the top."""
_SIDESLIP_SEEN = _ALPHA_SEEN = 1.0 * DEG_RAD


@dataclasses.dataclass(frozen=True)
class StepCase:
    """A steady level flight that step tests leave.

    Attributes
    ----------
    airframe, trim
        What flies, and how.
    gains, limits
        Of its autopilot: the published ones of the F-16, of another aircraft its own.
    pace
        How slow its loops are, beside the published ones.
    own
        What it can do; None of the F-16.
    """

    airframe: AbstractAirframe
    trim: TrimPoint
    gains: AutopilotGains
    limits: FlightLimits
    pace: LoopTimeScale
    derived_defaults: DerivedDefaults | None


def default_flight_point(airframe: AbstractAirframe) -> tuple[float, float]:
    """Airspeed (m/s) and altitude (m) of an aircraft's step tests: half way, as a ratio, between least and greatest.

    150 m/s of the F-16; 1000 m, or the nearest altitude of the aircraft's data.
    """
    if isinstance(airframe, AbstractF16):
        return _F16_SPEED_M_S, _ALTITUDE_M
    ends = getattr(getattr(airframe, "validity", None), "altitude", (-math.inf, math.inf))
    altitude = min(max(_ALTITUDE_M, float(ends[0])), float(ends[1]))
    known = valid_airspeed_range(airframe)
    able = compute_defaults(airframe, altitude, math.sqrt(known[0] * known[1]), known, STEP_S).capability
    if math.isnan(able.speed_min):
        return round(math.sqrt(known[0] * known[1])), altitude
    return float(round(math.sqrt(able.speed_min * able.speed_max))), altitude


def step_case(airframe: AbstractAirframe, speed_m_s: float, altitude_m: float, inversion: Inversion) -> StepCase:
    """Trim an aircraft, and find gains and limits of its own.

    Raises
    ------
    ConditionError
        It does not fly level there; the message says why.
    """
    environment, limits = standard_environment(), default_limits()
    trim = steady_trim(airframe, environment, trim_target(speed_m_s, altitude_m))
    if isinstance(airframe, AbstractF16):
        return StepCase(airframe, trim, gains_for(inversion), limits, PUBLISHED_TIME_SCALE, None)
    own = compute_defaults(airframe, altitude_m, speed_m_s, valid_airspeed_range(airframe), STEP_S)
    able, bandwidths = own
    slowest, fastest = min(able.speed_min, speed_m_s), max(able.speed_max, speed_m_s)
    limits = eqx.tree_at(
        lambda one: (one.speed_min, one.speed_max, one.bank_max, one.alpha_min, one.alpha_max),
        limits,
        (
            as_array(slowest),
            as_array(fastest),
            as_array(min(float(limits.bank_max), able.bank_max)),
            *airframe.alpha_range,
        ),
    )
    pace = LoopTimeScale(*(float(slow / np.min(fast[:2])) for slow, fast in zip(_PUBLISHED, _loops(own), strict=True)))
    gains = gains_for(inversion, automatic_gains(bandwidths))
    return StepCase(airframe, trim, gains, limits, pace, own)


_PUBLISHED = (5.0, 2.0, 1.0)
"""Bandwidths of the published loops, 1/s: rates, attitude, velocity."""


def _loops(derived_defaults: DerivedDefaults) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return derived_defaults.bandwidths.rates, derived_defaults.bandwidths.attitude, derived_defaults.bandwidths.velocity  # pyright: ignore[reportReturnType]


def select_step_tests(case: StepCase) -> tuple[StepTest, ...]:
    """Each channel of each loop alone, then all together: the published sizes, or less where the aircraft has less."""
    if case.derived_defaults is None:
        return PUBLISHED_STEPS
    able, speed = case.derived_defaults.capability, float(np.linalg.norm(np.asarray(case.trim.state.velocity_b)))
    alpha_left = float(case.airframe.alpha_range[1]) - float(case.trim.alpha) - ALPHA_RESERVE
    environment = standard_environment()
    beta_left = float(_sideslip_left(case.airframe, environment, case.trim))
    curving = _PATH_TURN * speed / (float(environment.gravity) * 6.0 * case.pace.attitude)
    alpha_curving = curving / max(float(_load_per_alpha(case.airframe, environment, case.trim)), 1e-6)
    faster = min(speed / 15.0, _PART * (float(case.limits.speed_max) - speed))
    climb = math.asin(min(able.climb_rate_max / speed, 1.0))
    return scaled_step_tests(
        case.pace,
        attitude=(
            _short(min(30.0, 0.75 * RAD_DEG * float(case.limits.bank_max))),
            _short(min(5.0, _PART * RAD_DEG * alpha_left, RAD_DEG * alpha_curving)),
            _short(min(5.0, _PART * RAD_DEG * beta_left)),
        ),
        velocity=(_short(faster), _short(min(3.0, _PART * RAD_DEG * climb)), 20.0),
    )


def _short(value: float) -> float:
    """A number of two digits, not above the value."""
    if value <= 0.0:
        return 0.0
    digit = 10.0 ** (math.floor(math.log10(value)) - 1)
    return round(math.floor(value / digit + 1e-9) * digit, 6)


@compiled
def _load_per_alpha(airframe: AbstractAirframe, environment: Environment, trim: TrimPoint) -> Scalar:
    """Load factor by angle of attack, 1/rad."""
    now = flight_condition(airframe, environment, 0.0, trim.state)
    surfaces, still = trim.state.surfaces, jnp.zeros(3)

    def lift(alpha: Scalar) -> Scalar:
        force_b = airframe.aerodynamics(eqx.tree_at(lambda d: d.alpha, now.air_data, alpha), still, surfaces).force_b
        return force_b[0] * jnp.sin(alpha) - force_b[2] * jnp.cos(alpha)

    weight = airframe.mass_properties.mass * environment.gravity
    return (lift(trim.alpha + _ALPHA_SEEN) - lift(trim.alpha)) / (_ALPHA_SEEN * weight)


def gallery_steps(
    aircraft: str | AbstractAirframe, variant: str = "textbook", at: tuple[float, float] | None = None
) -> tuple[tuple[StepTest, ...], tuple[float, float]]:
    """Tests of an aircraft, and the airspeed (m/s) and altitude (m) that they leave: `at`, or `default_flight_point`.

    Raises
    ------
    ConditionError
        It does not fly level there.
    ValueError
        No such airframe.
    """
    airframe = resolve_airframe(aircraft, variant)[0]
    speed_m_s, altitude_m = default_flight_point(airframe) if at is None else at
    return select_step_tests(step_case(airframe, speed_m_s, altitude_m, "model")), (speed_m_s, altitude_m)


def step_time_scale(
    aircraft: str | AbstractAirframe, variant: str, speed_m_s: float, altitude_m: float
) -> LoopTimeScale:
    """How slow the loops of an aircraft are; raises as `gallery_steps`."""
    return step_case(resolve_airframe(aircraft, variant)[0], speed_m_s, altitude_m, "model").pace


@compiled
def _sideslip_left(airframe: AbstractAirframe, environment: Environment, trim: TrimPoint) -> Scalar:
    """Sideslip whose moments take all that is left of the surfaces, rad."""
    now = flight_condition(airframe, environment, 0.0, trim.state)
    data, surfaces = now.air_data, trim.state.surfaces
    aside = eqx.tree_at(lambda d: d.beta, data, data.beta + _SIDESLIP_SEEN)
    still = jnp.zeros(3)
    moment_b = airframe.aerodynamics(aside, still, surfaces).moment_b
    moment_b = moment_b - airframe.aerodynamics(data, still, surfaces).moment_b
    actuators = airframe.actuators
    moments = surface_moments(airframe, now, still, surfaces)
    needed = jnp.abs(deflection_for_moment(actuators, moments.slope) @ moment_b)
    left = jnp.minimum(surfaces - actuators.lower, actuators.upper - surfaces)
    commanded = np.flatnonzero(actuators.is_commanded)
    return _SIDESLIP_SEEN * jnp.min(left[commanded] / jnp.maximum(needed[commanded], 1e-6))


_VARIABLES = {variable.key: variable for variable in CATALOGUE}
_ANGLES_THAT_WRAP = ("bank", "course")

_measure = compiled(step_metrics)


def fly_steps(
    tests: Sequence[StepTest],
    *,
    aircraft: str | AbstractAirframe = "f16",
    variant: str = "textbook",
    speed_m_s: float = 150.0,
    altitude_m: float = 1000.0,
    inversion: Inversion = "model",
    progress: Callable[[str], None] = lambda _: None,
) -> tuple[StepTestResult, ...]:
    """Fly step tests from level trim in the standard atmosphere and still air.

    With the published gains of the F-16; another aircraft has gains and limits of its own.

    Tests of one loop and duration are one batch, compiled once.

    Parameters
    ----------
    tests
        What to command.
    aircraft, variant
        Of the library, or an airframe.
    speed_m_s, altitude_m
        True airspeed and geometric altitude of the trim point.
    inversion
        Of the model, or of the change from what the sensors measure.
    progress
        Called with the loop that is flown next.

    Raises
    ------
    ConditionError
        No level trim there, or a speed beyond those that the autopilot flies; the message says which and why.
    ValueError
        No such airframe.
    """
    enable_compilation_cache()
    airframe, of = resolve_airframe(aircraft, variant)
    environment, case = standard_environment(), step_case(airframe, speed_m_s, altitude_m, inversion)
    for test in tests:
        _must_be_flown(test, speed_m_s, case.limits)
    attributes = {**of, "speed_m_s": speed_m_s, "altitude_m": altitude_m, "inversion": inversion}
    found: dict[StepTest, StepTestResult] = {}
    batches: dict[tuple[Loop, float], list[StepTest]] = {}
    for test in tests:
        batches.setdefault((test.loop, test.duration_s), []).append(test)
    for (loop, duration), batch in batches.items():
        progress(loop)
        sizes = jnp.asarray([_si(test) for test in batch])
        record = _fly(
            airframe, environment, case.gains, case.limits, case.trim, sizes, round(duration / STEP_S) + 1, loop
        )
        rows = {key: np.asarray(values) for key, values in record.items()}
        for k, test in enumerate(batch):
            one = {key: values[k] for key, values in rows.items()}
            found[test] = _flight(test, one, airframe, attributes)
    return tuple(found[test] for test in tests)


def _must_be_flown(test: StepTest, speed_m_s: float, limits: FlightLimits) -> None:
    wanted, low, high = speed_m_s + test.size[0], float(limits.speed_min), float(limits.speed_max)
    if test.loop == "velocity" and not low <= wanted <= high:
        raise ConditionError(
            f"The velocity loop does not fly the {wanted:g} m/s that the step asks for: {low:g} to {high:g} m/s only."
        )


def _si(test: StepTest) -> list[float]:
    keys = CHANNEL_KEYS[test.loop].values()
    return [size / _VARIABLES[key].factor for size, key in zip(test.size, keys, strict=True)]


class _StepRecorder(AbstractRecorder):
    """Outputs of all loops and what they take, at each sample."""

    stride: int = eqx.field(static=True, default=1)

    def init(self, aircraft: int) -> None:
        """Nothing is kept."""

    def update(self, recorder_state: None, sample: AircraftSample, instant: Instant) -> None:
        """Nothing is kept."""

    def output(self, sample: AircraftSample, instant: Instant) -> dict[str, Array]:
        """By the keys of the catalogue."""
        outputs = _outputs(sample.truth.airframe, instant.environment, sample.truth.state)
        return {**outputs, "throttle": jnp.asarray(sample.controls.throttle)}


@compiled
def _fly(
    airframe: AbstractAirframe,
    environment: Environment,
    gains: AutopilotGains,
    limits: FlightLimits,
    trim: TrimPoint,
    sizes: Float[Array, "tests 3"],
    count: int,
    loop: Loop,
) -> dict[str, Float[Array, "tests steps"]]:
    """Fly a batch of steps: history by the keys of the catalogue, SI units and radians."""
    held = _outputs(airframe, environment, trim.state)
    case = LoopCase(airframe, environment, gains, limits, trim, STEP_S)
    before = jnp.stack([held[key] for key in CHANNEL_KEYS[loop].values()])

    def one(size: Float[Array, "3"]) -> dict[str, Array]:
        value = before + size
        record = loop_flight(case, value, count, loop, _StepRecorder())
        wanted = dict(zip(CHANNEL_KEYS[loop].values(), value, strict=True))
        commands = {f"{key}_command": jnp.full(count, value) for key, value in wanted.items()}
        return {**record, **{key: jnp.unwrap(record[key]) for key in _ANGLES_THAT_WRAP}, **commands}

    return jax.vmap(one)(sizes)


def _outputs(airframe: AbstractAirframe, environment: Environment, state: AircraftState) -> dict[str, Array]:
    """What all three loops control, and the controls, of one aircraft at one instant in steady wind."""
    R_bn = rotation_from_quaternion(state.quaternion)
    wind_n = environment.wind.at(state.position_n, 0.0)
    velocity_air_b = state.velocity_b - rotate(R_bn, wind_n)
    altitude = -state.position_n[2]
    data = air_data(velocity_air_b, altitude, environment.atmosphere.at(altitude))
    gamma, chi = path_angles(rotate_back(R_bn, velocity_air_b))
    return {
        **dict(zip(CHANNEL_KEYS["rates"].values(), state.rates_b, strict=True)),
        "bank": bank_about_velocity(R_bn, data.alpha, data.beta),
        "alpha": data.alpha,
        "beta": data.beta,
        "airspeed": data.V,
        "path_angle": gamma,
        "course": chi,
        **dict(zip(airframe.actuators.names, state.surfaces, strict=True)),
        "power": state.power,
        "outside_tables": jnp.where(airframe.outside_tables(data), 1.0, 0.0),
    }


def _flight(
    test: StepTest, record: dict[str, np.ndarray], airframe: AbstractAirframe, attributes: dict[str, Any]
) -> StepTestResult:
    """Figures and labelled record of one flight of a batch."""
    time = STEP_S * np.arange(len(record["power"]))
    until = round(test.read_at_s / STEP_S) + 1
    measured = np.stack([record[key][:until] for key in CHANNEL_KEYS[test.loop].values()], axis=1)
    surfaces = np.stack([record[name][:until] for name in airframe.actuators.names], axis=1)
    stops = (airframe.actuators.lower, airframe.actuators.upper)
    size = jnp.asarray(_si(test))
    figures = _measure(jnp.asarray(time[:until]), jnp.asarray(measured), size, jnp.asarray(surfaces), stops)
    metrics = jax.tree.map(np.asarray, figures)
    labelled = {v.key: v for v in catalogue(airframe.actuators.names)}
    variables = {}
    for key, values in record.items():
        v = labelled[key]
        labels = {"units": v.unit, "symbol": v.symbol, "long_name": v.long_name, "frame": v.frame}
        variables[v.name] = ("time", (v.factor * values).astype(v.dtype), labels)
    dataset = xr.Dataset(
        variables,
        coords={"time": ("time", time, {"units": "s", "long_name": "Time", "symbol": "t"})},
        attrs={
            **attributes,
            "surfaces": " ".join(airframe.actuators.names),
            "key": test.key,
            "loop": test.loop,
            "commanded": [_VARIABLES[CHANNEL_KEYS[test.loop][channel]].name for channel in test.commanded],
            "read_at_s": test.read_at_s,
        },
    )
    return StepTestResult(test, dataset, metrics)
