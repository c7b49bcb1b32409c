"""Flights of step tests from level trim, and flights of the climb-and-turn, a published test of path tracking."""

import dataclasses
import math
import tomllib
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
from anser.aircraft.motion import air_data_and_forces
from anser.aircraft_files.library import is_aircraft_path
from anser.aircraft_files.sources import VARIANTS
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
from anser.analysis.surveys import Survey, select_rows
from anser.analysis.trim_points import (
    ConditionError,
    Inversion,
    gains_for,
    require_inversion,
    resolve_airframe,
    steady_trim,
)
from anser.compiling.options import compiled
from anser.config.shipped_files import shipped_files
from anser.control.allocation import deflection_for_moment, surface_moments
from anser.control.gains import AutopilotGains
from anser.control.inversion_autopilot import Loop
from anser.control.limits import FlightLimits, default_limits
from anser.environment.environment import Environment, standard_environment
from anser.missions.runs import FlightResult, run
from anser.numerics.arrays import as_array
from anser.parts.perception import Instant
from anser.scenario.build_aircraft import DerivedDefaults, compute_defaults
from anser.scenario.schema import Scenario, validate
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
_RANGE_SHARE = 0.5
"""Greatest fraction of the remaining alpha, sideslip, airspeed or climb angle that a step may use."""
_PATH_TURN = 0.6
"""Greatest change of the path angle during a step of alpha, rad; without a limit, a slow aircraft could fly a loop."""
_SIDESLIP_SEEN = _ALPHA_SEEN = 1.0 * DEG_RAD


@dataclasses.dataclass(frozen=True)
class StepCase:
    """Steady level flight from which step tests start, with gains and limits of the autopilot."""

    airframe: AbstractAirframe
    trim: TrimPoint
    # autopilot: published values for the F-16, derived values for another aircraft
    gains: AutopilotGains
    limits: FlightLimits
    time_scale: LoopTimeScale  # time constants of the loops relative to the published loops of the F-16
    derived_defaults: DerivedDefaults | None  # derived limits of performance, bandwidths, gains; None for the F-16


def default_flight_point(airframe: AbstractAirframe) -> tuple[float, float]:
    """Return the airspeed (m/s) and altitude (m) at which an aircraft's step tests start by default.

    - Airspeed: 150 m/s for the F-16; for another aircraft the geometric mean of the slowest and the fastest level
      flight, or of the range of the data if no level flight exists.
    - Altitude: 1000 m, or the nearest altitude in the aircraft's data.
    """
    if isinstance(airframe, AbstractF16):
        return _F16_SPEED_M_S, _ALTITUDE_M
    low, high = getattr(getattr(airframe, "validity", None), "altitude", (-math.inf, math.inf))
    altitude = min(max(_ALTITUDE_M, float(low)), float(high))
    speed_range = valid_airspeed_range(airframe)
    middle_speed = math.sqrt(speed_range[0] * speed_range[1])
    capability = compute_defaults(airframe, altitude, middle_speed, speed_range, STEP_S).capability
    if math.isnan(capability.speed_min):
        return round(middle_speed), altitude
    return float(round(math.sqrt(capability.speed_min * capability.speed_max))), altitude


def step_case(
    airframe: AbstractAirframe, speed_m_s: float, altitude_m: float, inversion: Inversion, step_s: float = STEP_S
) -> StepCase:
    """Return the level trim of an aircraft, with the gains and limits of the autopilot at this point.

    An F-16 has the published gains and the default limits; for another aircraft, gains and limits are derived.
    `speed_m_s` is the true airspeed, `step_s` the sampling period of the autopilot. Raises ConditionError, with the
    reason, if the aircraft has no level flight at this point.
    """
    trim = steady_trim(airframe, standard_environment(), trim_target(speed_m_s, altitude_m))
    gains, limits, derived_defaults = derive_autopilot(airframe, speed_m_s, altitude_m, inversion, step_s)
    if derived_defaults is None:
        return StepCase(airframe, trim, gains, limits, PUBLISHED_TIME_SCALE, None)
    bandwidths = derived_defaults.bandwidths
    time_scale = LoopTimeScale(
        **{
            loop: float(published / np.min(getattr(bandwidths, loop)[:2]))
            for loop, published in _PUBLISHED_BANDWIDTHS.items()
        }
    )
    return StepCase(airframe, trim, gains, limits, time_scale, derived_defaults)


def derive_autopilot(
    airframe: AbstractAirframe,
    speed_m_s: float,
    altitude_m: float,
    inversion: Inversion,
    step_s: float,
    environment: Environment | None = None,
) -> tuple[AutopilotGains, FlightLimits, DerivedDefaults | None]:
    """Return gains and limits of an aircraft's autopilot at a true airspeed and altitude, and all derived values.

    An F-16 has the published gains, the default limits within its data, and None in place of derived values. Another
    aircraft has derived gains and limits. `step_s` is the sampling period of the autopilot; `environment` None:
    standard atmosphere.
    """
    if isinstance(airframe, AbstractF16):
        return gains_for(inversion), default_limits(airframe.alpha_range), None
    limits = default_limits()
    speeds_m_s = valid_airspeed_range(airframe)
    derived_defaults = compute_defaults(airframe, altitude_m, speed_m_s, speeds_m_s, step_s, environment)
    capability = derived_defaults.capability
    limits = dataclasses.replace(
        limits,
        # fmin and fmax ignore a NaN; an aircraft that has no level flight has NaN speeds
        speed_min=as_array(np.fmin(capability.speed_min, speed_m_s)),
        speed_max=as_array(np.fmax(capability.speed_max, speed_m_s)),
        bank_max=as_array(np.fmin(float(limits.bank_max), capability.bank_max)),
        alpha_min=airframe.alpha_range[0],
        alpha_max=airframe.alpha_range[1],
    )
    return gains_for(inversion, derived_defaults.gains), limits, derived_defaults


_PUBLISHED_BANDWIDTHS = {"rates": 5.0, "attitude": 2.0, "velocity": 1.0}
"""Bandwidths of the F-16's loops as published, 1/s."""


def select_step_tests(case: StepCase) -> tuple[StepTest, ...]:
    """Return the step tests of an aircraft: for each loop, a test of each channel, then of all channels together.

    An F-16 has the published tests. For another aircraft, durations are in proportion to its time constants.
    Steps are at most 75 % of the bank limit, or half of the distance to the alpha, sideslip, airspeed or climb limit.
    """
    if case.derived_defaults is None:
        return PUBLISHED_STEPS
    capability, speed = case.derived_defaults.capability, float(np.linalg.norm(np.asarray(case.trim.state.velocity_b)))
    alpha_left = float(case.airframe.alpha_range[1]) - float(case.trim.alpha) - ALPHA_RESERVE
    environment = standard_environment()
    beta_left = float(_remaining_sideslip(case.airframe, environment, case.trim))
    load_factor_per_turn = _PATH_TURN * speed / (float(environment.gravity) * 6.0 * case.time_scale.attitude)
    alpha_for_turn = load_factor_per_turn / max(float(_load_per_alpha(case.airframe, environment, case.trim)), 1e-6)
    speed_step = min(speed / 15.0, _RANGE_SHARE * (float(case.limits.speed_max) - speed))
    climb_angle = math.asin(min(capability.climb_rate_max / speed, 1.0))
    return scaled_step_tests(
        case.time_scale,
        attitude=(
            _round_down(min(30.0, 0.75 * RAD_DEG * float(case.limits.bank_max))),
            _round_down(min(5.0, _RANGE_SHARE * RAD_DEG * alpha_left, RAD_DEG * alpha_for_turn)),
            _round_down(min(5.0, _RANGE_SHARE * RAD_DEG * beta_left)),
        ),
        velocity=(_round_down(speed_step), _round_down(min(3.0, _RANGE_SHARE * RAD_DEG * climb_angle)), 20.0),
    )


def _round_down(value: float) -> float:
    """Round a positive number down to two significant digits; 0 for a number that is not positive."""
    if value <= 0.0:
        return 0.0
    digit = 10.0 ** (math.floor(math.log10(value)) - 1)
    return round(math.floor(value / digit + 1e-9) * digit, 6)


@compiled
def _load_per_alpha(airframe: AbstractAirframe, environment: Environment, trim: TrimPoint) -> Scalar:
    """Return the derivative of the load factor (lift over weight) by the angle of attack at a trim point, 1/rad."""
    condition = air_data_and_forces(airframe, environment, 0.0, trim.state)
    surfaces, zero_rates = trim.state.surfaces, jnp.zeros(3)

    def lift(alpha: Scalar) -> Scalar:
        data = eqx.tree_at(lambda d: d.alpha, condition.air_data, alpha)
        force_b = airframe.aerodynamics(data, zero_rates, surfaces).force_b
        return force_b[0] * jnp.sin(alpha) - force_b[2] * jnp.cos(alpha)

    weight = airframe.mass_properties.mass * environment.gravity
    return (lift(trim.alpha + _ALPHA_SEEN) - lift(trim.alpha)) / (_ALPHA_SEEN * weight)


def gallery_steps(
    aircraft: str | AbstractAirframe, variant: str = "textbook", flight_point: tuple[float, float] | None = None
) -> tuple[tuple[StepTest, ...], tuple[float, float]]:
    """Return the step tests of an aircraft (`select_step_tests`), and airspeed (m/s) and altitude (m) of the trim.

    `flight_point` None: `default_flight_point`. Raises ConditionError if the level trim does not exist, ValueError if
    the aircraft is unknown.
    """
    airframe = resolve_airframe(aircraft, variant)[0]
    speed_m_s, altitude_m = default_flight_point(airframe) if flight_point is None else flight_point
    return select_step_tests(step_case(airframe, speed_m_s, altitude_m, "model")), (speed_m_s, altitude_m)


def step_time_scale(
    aircraft: str | AbstractAirframe, variant: str, speed_m_s: float, altitude_m: float
) -> LoopTimeScale:
    """Return the time constants of an aircraft's loops in level flight, relative to the published loops of the F-16.

    Raises ConditionError if the level flight does not exist, ValueError if the aircraft is unknown.
    """
    return step_case(resolve_airframe(aircraft, variant)[0], speed_m_s, altitude_m, "model").time_scale


@compiled
def _remaining_sideslip(airframe: AbstractAirframe, environment: Environment, trim: TrimPoint) -> Scalar:
    """Return the change of sideslip (rad) from a trim at which the first surface that balances it reaches a stop."""
    condition = air_data_and_forces(airframe, environment, 0.0, trim.state)
    data, surfaces = condition.air_data, trim.state.surfaces
    sideslipping = eqx.tree_at(lambda d: d.beta, data, data.beta + _SIDESLIP_SEEN)
    zero_rates = jnp.zeros(3)
    moment_b = airframe.aerodynamics(sideslipping, zero_rates, surfaces).moment_b
    moment_b = moment_b - airframe.aerodynamics(data, zero_rates, surfaces).moment_b
    actuators = airframe.actuators
    moments = surface_moments(airframe, condition, zero_rates, surfaces)
    deflection_used = jnp.abs(deflection_for_moment(actuators, moments.effectiveness) @ moment_b)
    travel_left = jnp.minimum(surfaces - actuators.lower, actuators.upper - surfaces)
    commanded = np.flatnonzero(actuators.is_commanded)
    return _SIDESLIP_SEEN * jnp.min(travel_left[commanded] / jnp.maximum(deflection_used[commanded], 1e-6))


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
    """Fly step tests from level trim in the standard atmosphere and still air; return a result for each of `tests`.

    The F-16 has the published gains; another aircraft has derived gains and limits.

    Raises ConditionError, with the reason, if level trim does not exist or a step leads beyond the autopilot's speed
    limits; ValueError if the aircraft is unknown or an argument is not valid.

    Parameters
    ----------
    aircraft, variant
        Name of an airframe, path of an aircraft file, or an airframe; variant of the F-16.
    speed_m_s, altitude_m
        True airspeed and geometric altitude of the trim point.
    inversion
        "model": dynamic inversion of the onboard model; "incremental": inversion from measured accelerations.
    progress
        Called with the name of the loop that is flown next.
    """
    require_inversion(inversion)
    survey = Survey(aircraft, variant, lambda loop, _: progress(loop))
    case = step_case(survey.airframe, speed_m_s, altitude_m, inversion)
    for test in tests:
        _check_speed(test, speed_m_s, case.limits)
    fixed = (survey.airframe, survey.environment, case.gains, case.limits, case.trim)
    attributes = survey.attributes | {"speed_m_s": speed_m_s, "altitude_m": altitude_m, "inversion": inversion}
    results: dict[StepTest, StepTestResult] = {}
    batches: dict[tuple[Loop, float], list[StepTest]] = {}
    for test in tests:
        batches.setdefault((test.loop, test.duration_s), []).append(test)
    for (loop, duration), batch in batches.items():
        sizes, count = np.array([_sizes_si(test) for test in batch]), round(duration / STEP_S) + 1
        records = survey.evaluate(loop, _fly, fixed, sizes, count, loop, batch_size=len(batch))
        for k, test in enumerate(batch):
            results[test] = _flight(test, select_rows(records, k), survey.airframe, attributes)
    return tuple(results[test] for test in tests)


def _check_speed(test: StepTest, speed_m_s: float, limits: FlightLimits) -> None:
    commanded_speed, low, high = speed_m_s + test.size[0], float(limits.speed_min), float(limits.speed_max)
    if test.loop == "velocity" and not low <= commanded_speed <= high:
        raise ConditionError(
            f"The velocity loop does not fly the {commanded_speed:g} m/s that the step asks for: "
            f"{low:g} to {high:g} m/s only."
        )


def _sizes_si(test: StepTest) -> list[float]:
    keys = CHANNEL_KEYS[test.loop].values()
    return [size / _VARIABLES[key].factor for size, key in zip(test.size, keys, strict=True)]


class _StepRecorder(AbstractRecorder):
    """Recorder of every sample of a step test: outputs of the three loops, deflections, engine power and throttle."""

    stride: int = eqx.field(static=True, default=1)

    def output(self, sample: AircraftSample, instant: Instant) -> dict[str, Array]:
        """Return loop outputs, deflections, engine power and throttle of one sample by variable key; SI units, rad."""
        outputs = _outputs(sample.truth.airframe, instant.environment, sample.truth.state)
        return {**outputs, "throttle": jnp.asarray(sample.controls.throttle)}


@compiled
def _fly(
    fixed: tuple[AbstractAirframe, Environment, AutopilotGains, FlightLimits, TrimPoint],
    sizes: Float[Array, "tests 3"],
    count: int,
    loop: Loop,
) -> dict[str, Float[Array, "tests steps"]]:
    """Fly a batch of steps, and return time histories (tests, steps) by variable key; SI units and rad.

    `sizes` are the steps of the loop's three channels in each test; `count` is the number of samples.
    """
    case = LoopCase(*fixed, STEP_S)
    trim_outputs = _outputs(case.airframe, case.environment, case.trim.state)
    trim_values = jnp.stack([trim_outputs[key] for key in CHANNEL_KEYS[loop].values()])

    def fly_step(size: Float[Array, "3"]) -> dict[str, Array]:
        commanded_values = trim_values + size
        record = loop_flight(case, commanded_values, count, loop, _StepRecorder())
        commanded = zip(CHANNEL_KEYS[loop].values(), commanded_values, strict=True)
        commands = {f"{key}_command": jnp.full(count, value) for key, value in commanded}
        return {**record, **{key: jnp.unwrap(record[key]) for key in _ANGLES_THAT_WRAP}, **commands}

    return jax.vmap(fly_step)(sizes)


def _outputs(airframe: AbstractAirframe, environment: Environment, state: AircraftState) -> dict[str, Array]:
    """Return outputs of the three loops, surface deflections and engine power (percent) by variable key; SI units, rad.

    Path angle and course are relative to the air. The entry `outside_tables` is 1 outside the airframe's data, else 0.
    """
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
    """Return the result of one step test from its time histories by variable key; `attributes` are for the dataset."""
    time = STEP_S * np.arange(len(record["power"]))
    read_count = round(test.read_at_s / STEP_S) + 1
    measured = np.stack([record[key][:read_count] for key in CHANNEL_KEYS[test.loop].values()], axis=1)
    surfaces = np.stack([record[name][:read_count] for name in airframe.actuators.names], axis=1)
    stops = (airframe.actuators.lower, airframe.actuators.upper)
    size = jnp.asarray(_sizes_si(test))
    figures = _measure(jnp.asarray(time[:read_count]), jnp.asarray(measured), size, jnp.asarray(surfaces), stops)
    metrics = jax.tree.map(np.asarray, figures)
    labelled = {variable.key: variable for variable in catalogue(airframe.actuators.names)}
    variables = {}
    for key, values in record.items():
        variable = labelled[key]
        labels = {
            "units": variable.unit,
            "symbol": variable.symbol,
            "long_name": variable.long_name,
            "frame": variable.frame,
        }
        variables[variable.name] = ("time", (variable.factor * values).astype(variable.dtype), labels)
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


CLIMB_AND_TURN = "climb-and-turn"
"""Name of the climb-and-turn among the shipped scenarios."""
_CLIMB_SHARE = 0.4
"""Greatest mean climb rate of the climb-and-turn, as a fraction of the greatest; the peak is 1.9 times the mean."""


def climb_and_turn(
    variant: str = "textbook",
    inversion: Inversion = "model",
    aircraft: str = "f16",
    start_point: tuple[float, float] | None = None,
) -> Scenario:
    """Return the scenario of the climb-and-turn, a test of path tracking (theory section 5).

    For an aircraft other than the F-16, lengths and the allowed error scale with airspeed times the time constant of
    the velocity loop, and the climb is limited to the aircraft's capability.

    Raises ValueError or ScenarioError if aircraft, variant or inversion is unknown, ConditionError if the aircraft has
    no level flight at the start.

    Parameters
    ----------
    aircraft
        Name of an airframe, or the path of an aircraft file.
    start_point
        Airspeed (m/s) and altitude (m) of the start of an aircraft other than the F-16; None: `default_flight_point`.
    """
    values = tomllib.loads(shipped_files()[CLIMB_AND_TURN].read_text(encoding="utf-8"))
    aircraft_table = values["aircraft"][0]
    aircraft_table["gains"] = {"inversion": inversion}
    if aircraft in VARIANTS:
        aircraft_table["variant"] = variant
    else:
        aircraft_table["airframe" if is_aircraft_path(aircraft) else "type"] = aircraft
        airframe = resolve_airframe(aircraft, variant)[0]
        speed_m_s, altitude_m = default_flight_point(airframe) if start_point is None else start_point
        _scale_case(values, step_case(airframe, speed_m_s, altitude_m, inversion), speed_m_s, altitude_m)
    return validate(values, f"{CLIMB_AND_TURN}.toml")


def _scale_case(values: dict[str, Any], case: StepCase, speed_m_s: float, altitude_m: float) -> None:
    """Scale the scenario `values`, in place, to an aircraft other than the F-16 at `speed_m_s` and `altitude_m`."""
    if case.derived_defaults is None:
        raise TypeError("an F-16 flies the case as published")
    aircraft_table, goal = values["aircraft"][0], values["goal"][0]
    time_scale = case.time_scale.velocity
    scale = speed_m_s / values["fleet"]["speed_m_s"] * time_scale
    stand_off_up = aircraft_table["rendezvous"]["stand_off_up_m"]
    climb = scale * (goal["altitude_m"] + stand_off_up - aircraft_table["start"]["altitude_m"])
    approach_time_s = scale * (goal["north_m"] ** 2 + goal["east_m"] ** 2) ** 0.5 / speed_m_s
    climb = min(climb, _CLIMB_SHARE * case.derived_defaults.capability.climb_rate_max * approach_time_s)
    values["timing"]["duration_s"] = round(round(values["timing"]["duration_s"] * time_scale / STEP_S) * STEP_S, 9)
    values["fleet"]["speed_m_s"] = speed_m_s
    aircraft_table["start"] |= {"speed_m_s": speed_m_s, "altitude_m": altitude_m}
    goal |= {"north_m": scale * goal["north_m"], "east_m": scale * goal["east_m"]}
    goal["altitude_m"] = altitude_m + climb - stand_off_up
    values["requirements"] = {key: scale * value for key, value in values["requirements"].items()}


def fly_climb_and_turn(variant: str = "textbook", inversion: Inversion = "model") -> FlightResult:
    """Fly the F-16 through the scenario of `climb_and_turn`, and return the flight."""
    return run(climb_and_turn(variant, inversion))
