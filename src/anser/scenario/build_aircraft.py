"""Construction of airframe, autopilot gains, flight limits and guidance of an aircraft from a table [[aircraft]].

Limits and gains that the scenario omits are derived from the nominal airframe before the flight, at the start altitude
(rounded to 500 m) and the preferred airspeed. Limits follow from a trim map; gains follow from actuators, engine and
control authority in the trim. Exception: the library's F-16 has the published gains and the schema's limits.
"""

import dataclasses
import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from anser.aircraft.airframe import AbstractAirframe
from anser.aircraft.motion import air_data_and_forces
from anser.aircraft_files.library import airframe_of_table
from anser.compiling.options import compiled_quickly, enable_compilation_cache
from anser.config.tables import content_hash
from anser.control.gains import (
    AutopilotGains,
    Bandwidths,
    LoopGains,
    automatic_gains,
    derived_bandwidths,
    design_gains,
    published_gains,
)
from anser.control.guidance import GuidanceSettings
from anser.control.limits import NORMAL_TURNING_G, FlightLimits
from anser.control.loop_separations import LoopSeparation, loop_separations
from anser.environment.environment import Environment, standard_environment
from anser.numerics.arrays import as_array
from anser.planning.limits import PathLimits
from anser.scenario.build_environment import build_atmosphere
from anser.scenario.schema import Scenario
from anser.scenario.schema_aircraft import Aircraft, AttitudeGains, Gains, RateGains, VelocityGains
from anser.scenario.schema_settings import Limits
from anser.shapes import Scalar
from anser.steady.performance import Capability, capability_from_points, capability_points
from anser.steady.trim import TrimMapPoint
from anser.units import DEG_RAD


def build_airframe_of(aircraft: Aircraft) -> AbstractAirframe:
    """Build the nominal airframe of one aircraft, as assumed by autopilot and planner."""
    return airframe_of_table(aircraft.type, aircraft.variant, aircraft.x_cg_over_c, aircraft.airframe)


_ALTITUDE_STEP_M = 500.0
"""Step to which start altitudes are rounded for trim maps, so that aircraft with similar starts share a map."""
_SPEED_SEARCH_RANGE = (0.3, 3.0)
"""Airspeeds searched for level flight, as factors of the preferred airspeed, if the data range is unknown."""
_BANK_MAX_DEG = 45.0
"""Greatest bank angle of plans and autopilot if the scenario sets none, deg; not for the library's F-16."""


class DerivedDefaults(NamedTuple):
    """Values derived from an airframe: performance limits, and the autopilot's bandwidths and gains."""

    capability: Capability
    bandwidths: Bandwidths
    gains: AutopilotGains


@dataclass(frozen=True)
class ResolvedAircraft:
    """One aircraft of a scenario, with limits and gains completed by derived values or defaults."""

    table: Aircraft
    airframe: AbstractAirframe  # nominal airframe, as assumed by autopilot and planner
    limits: Limits  # in the units of the file
    gains: AutopilotGains
    correction_max_m_s: float  # greatest velocity correction by position feedback, m/s
    plan_roll_rate: float  # mean roll rate that plans assume, rad/s
    capability: Capability | None  # performance limits derived from the trim map; None for the library's F-16


def resolve_fleet(scenario: Scenario) -> tuple[ResolvedAircraft, ...]:
    """Return every aircraft of a scenario with limits, gains and guidance values completed, in the file's order."""
    return _resolved(_ScenarioObject(id(scenario), scenario))


@dataclass(frozen=True)
class _ScenarioObject:
    """A scenario as a cache key, compared by the object's identity, because comparing all values takes too long."""

    identity: int
    scenario: Scenario = field(compare=False)


@functools.lru_cache(maxsize=4)
def _resolved(key: _ScenarioObject) -> tuple[ResolvedAircraft, ...]:
    return tuple(_resolve_aircraft(key.scenario, aircraft) for aircraft in key.scenario.aircraft)


def _resolve_aircraft(scenario: Scenario, aircraft: Aircraft) -> ResolvedAircraft:
    """Return one aircraft with its limits, gains and guidance values completed."""
    airframe, limits = build_airframe_of(aircraft), scenario.limits_for(aircraft)
    gains = _build_gains(aircraft.gains)  # pyright: ignore[reportArgumentType] - frozen tables are hashable
    roll_rate = _ROLL_RATE_DEG_S * DEG_RAD
    if aircraft.is_library_f16:
        return ResolvedAircraft(aircraft, airframe, limits, gains, _CORRECTION_MAX_M_S, roll_rate, None)
    defaults = _derive_defaults(scenario, aircraft, airframe)
    if scenario.limits.roll_rate_max_deg_s is None:
        # the bank loop must be able to follow the plan
        roll_rate = min(roll_rate, float(defaults.bandwidths.attitude[0]) * _BANK_LAG_MAX)
    return ResolvedAircraft(
        aircraft,
        airframe,
        _derived_limits(limits, defaults.capability),
        _with_derived_gains(gains, aircraft, defaults),
        min(_CORRECTION_MAX_M_S, _CORRECTION_SHARE * scenario.speed_for(aircraft)),
        roll_rate,
        defaults.capability,
    )


@dataclass(frozen=True)
class _FlightCase:
    """Arguments of `compute_defaults` as a cache key; `aircraft_content` and `air` replace airframe and environment."""

    aircraft_content: tuple[str, str, float | None, str]  # type, variant, x_cg_over_c, hash of the aircraft file
    airframe: AbstractAirframe = field(compare=False)
    altitude_m: float
    speed_m_s: float
    speeds_m_s: tuple[float, float]
    step_s: float
    air: str  # hash of the scenario's atmosphere; empty: the standard atmosphere
    environment: Environment = field(compare=False)


def _derive_defaults(scenario: Scenario, aircraft: Aircraft, airframe: AbstractAirframe) -> DerivedDefaults:
    """Return an aircraft's derived values at its start altitude (rounded) and preferred airspeed, computed once."""
    speed, data_range = scenario.speed_for(aircraft), aircraft.range.airspeed_m_s
    altitude = round(aircraft.start.altitude_m / _ALTITUDE_STEP_M) * _ALTITUDE_STEP_M
    speeds = (_SPEED_SEARCH_RANGE[0] * speed, _SPEED_SEARCH_RANGE[1] * speed) if data_range is None else data_range
    file = "" if aircraft.airframe is None else content_hash(aircraft.airframe)
    content = (aircraft.type, aircraft.variant, aircraft.x_cg_over_c, file)
    air, environment = "", standard_environment()
    if scenario.atmosphere is not None:
        air = content_hash(scenario.atmosphere)
        environment = dataclasses.replace(environment, atmosphere=build_atmosphere(scenario.atmosphere))
    return _defaults_of(
        _FlightCase(content, airframe, altitude, speed, speeds, scenario.timing.step_s, air, environment)
    )


@functools.lru_cache(maxsize=64)
def _defaults_of(case: _FlightCase) -> DerivedDefaults:
    numbers = case.altitude_m, case.speed_m_s, case.speeds_m_s, case.step_s
    return compute_defaults(case.airframe, *numbers, case.environment)


def compute_defaults(
    airframe: AbstractAirframe,
    altitude_m: float,
    speed_m_s: float,  # true airspeed of turns, climbs, bandwidths and gains
    speeds_m_s: tuple[float, float],  # range of airspeeds in which level flight is searched for
    step_s: float,  # sampling period of the autopilot
    environment: Environment | None = None,  # None: the standard atmosphere
) -> DerivedDefaults:
    """Compute performance limits, loop bandwidths and autopilot gains of an airframe at one altitude."""
    altitude, speed, step, slow, fast = map(as_array, (altitude_m, speed_m_s, step_s, *speeds_m_s))
    environment = standard_environment() if environment is None else environment
    points, bandwidths = _capability_and_bandwidths(airframe, environment, altitude, speed, step, (slow, fast))
    capability = capability_from_points(airframe, jax.tree.map(np.asarray, points), speed_m_s, speeds_m_s)
    bandwidths = jax.tree.map(np.asarray, bandwidths)
    return DerivedDefaults(capability, bandwidths, automatic_gains(bandwidths))


@compiled_quickly
def _capability_and_bandwidths(
    airframe: AbstractAirframe,
    environment: Environment,
    altitude: Scalar,
    speed: Scalar,
    step: Scalar,
    speeds: tuple[Scalar, Scalar],
) -> tuple[TrimMapPoint, Bandwidths]:
    points = capability_points(airframe, environment, altitude, speed, speeds)
    trim = jax.tree.map(lambda leaf: leaf[-1], points.trim)
    condition = air_data_and_forces(airframe, environment, 0.0, trim.state)
    surfaces, power = airframe.actuators.limit_command(trim.state.surfaces), jnp.clip(trim.power, 0.0, 100.0)
    return points, derived_bandwidths(airframe, condition, surfaces, power, step)


def _with_derived_gains(
    scenario_gains: AutopilotGains, aircraft: Aircraft, defaults: DerivedDefaults
) -> AutopilotGains:
    """Return derived gains; loops with a table in the scenario, and the sensor filter, keep their `scenario_gains`."""
    gains = defaults.gains
    for loop in ("rates", "attitude", "velocity"):
        if loop in aircraft.gains.model_fields_set:
            gains = eqx.tree_at(lambda g, loop=loop: getattr(g, loop), gains, getattr(scenario_gains, loop))
    return eqx.tree_at(lambda g: g.sensor_bandwidth, gains, scenario_gains.sensor_bandwidth)


def _derived_limits(limits: Limits, capability: Capability) -> Limits:
    """Return the limits; keys that the file omits are tightened to the performance `capability`."""
    if math.isnan(capability.speed_min):
        return limits  # level flight is impossible: the refusal of the trim gives the reason
    bank_deg = min(limits.bank_max_deg, math.degrees(capability.bank_max), _BANK_MAX_DEG)
    if bank_deg > 0.0:
        limits = limits.with_defaults(bank_max_deg=bank_deg)
    bank_deg = min(limits.bank_max_deg, math.degrees(capability.bank_max))
    # least airspeed at which the aircraft can turn with the greatest bank
    slowest = capability.speed_min / math.sqrt(math.cos(math.radians(bank_deg)))
    fastest = min(capability.speed_max, limits.speed_max_m_s)
    if slowest < fastest:
        limits = limits.with_defaults(speed_min_m_s=max(slowest, limits.speed_min_m_s), speed_max_m_s=fastest)
    climb = min(capability.climb_rate_max, capability.sink_rate_max)
    if climb > 0.0:
        limits = limits.with_defaults(climb_rate_max_m_s=min(limits.climb_rate_max_m_s, climb))
    return limits


def _exceeds_capability(scenario: Scenario, limits: Limits, index: int, capability: Capability) -> tuple[str, ...]:
    """Return a sentence for each limit in the file that is more than 2 % beyond the performance of aircraft `index`."""
    aircraft = scenario.aircraft[index]
    subject, speed = f'aircraft[{index}] "{aircraft.name}"', scenario.speed_for(aircraft)
    if math.isnan(capability.speed_min):
        return (f"{subject}: no airspeed of level flight was found at {aircraft.start.altitude_m:g} m",)
    messages, keys = [], scenario.limits.model_fields_set
    climb, vertical = capability.climb_rate_max, "climbs"
    if capability.sink_rate_max < climb:
        climb, vertical = capability.sink_rate_max, "descends"
    for key, greatest, phrase, unit in (
        ("bank_max_deg", math.degrees(capability.bank_max), "banks in level turns at most", "deg"),
        ("speed_max_m_s", capability.speed_max, "flies level at most at", "m/s"),
        ("climb_rate_max_m_s", climb, f"{vertical} steadily at most at", "m/s"),
    ):
        required = getattr(limits, key)
        if key in keys and required > greatest * 1.02:
            messages.append(f"limits.{key} = {required:g}: {subject} {phrase} {greatest:.1f} {unit} (at {speed:g} m/s)")
    slowest, required = capability.speed_min, limits.speed_min_m_s
    if "speed_min_m_s" in keys and required < slowest / 1.02:
        messages.append(f"limits.speed_min_m_s = {required:g}: {subject} flies level from {slowest:.1f} m/s on")
    return tuple(messages)


@functools.lru_cache(maxsize=256)
@jax.ensure_compile_time_eval()  # cached, so the arrays must not belong to the trace of the first caller
def _build_gains(gains: Gains) -> AutopilotGains:
    """Build autopilot gains from a table [aircraft.gains], with published values for omitted keys."""
    # `resolve_fleet` replaces omitted loops of aircraft other than the library's F-16
    bandwidth = 0.0 if gains.inversion == "model" else gains.sensor_bandwidth_rad_s
    return eqx.tree_at(
        lambda g: (g.rates, g.attitude, g.velocity, g.sensor_bandwidth),
        published_gains(),
        (_loop_gains(gains.rates), _loop_gains(gains.attitude), _loop_gains(gains.velocity), as_array(bandwidth)),
    )


def _loop_gains(gains: RateGains | AttitudeGains | VelocityGains) -> LoopGains:
    remaining_gains = as_array(gains.derivative), as_array(gains.feed_forward)
    if gains.bandwidth_rad_s is not None:
        damping = (math.inf,) * 3 if gains.damping is None else gains.damping
        return design_gains(as_array(gains.bandwidth_rad_s), as_array(damping), *remaining_gains)
    return LoopGains(as_array(gains.proportional), as_array(gains.integral), *remaining_gains)


_CORRECTION_MAX_M_S = 20.0  # greatest velocity correction by position feedback
_CORRECTION_SHARE = 0.13  # greatest velocity correction over preferred airspeed, not for the library's F-16
_HOLD_CLIMB_MAX_M_S = 20.0  # greatest vertical speed in the hold, unless the scenario's limit is lower
_RATES_MAX_DEG_S = (120.0, 60.0, 60.0)  # greatest commanded body rates
_ROLL_RATE_DEG_S = 20.0  # default mean roll rate of plans
_BANK_LAG_MAX = math.radians(10.0)  # greatest lag of the bank angle behind a plan that rolls


def capability_cautions(scenario: Scenario) -> tuple[str, ...]:
    """Return a sentence for each limit written in the file that an aircraft of the scenario cannot reach.

    The performance of the library's F-16 is not checked.
    """
    enable_compilation_cache()
    return tuple(
        message
        for index, aircraft in enumerate(resolve_fleet(scenario))
        if aircraft.capability is not None
        for message in _exceeds_capability(scenario, scenario.limits_for(aircraft.table), index, aircraft.capability)
    )


def resolved_loop_separations(scenario: Scenario, index: int) -> tuple[LoopSeparation, ...]:
    """Return the pairs of nested loops of aircraft number `index`, with the bandwidths used in the flight."""
    enable_compilation_cache()
    gains = resolve_fleet(scenario)[index].gains
    rates, attitude, velocity = (
        np.asarray(loop.proportional / (1.0 + loop.derivative)).tolist()
        for loop in (gains.rates, gains.attitude, gains.velocity)
    )
    actuators, engine = float(gains.actuator_bandwidth), float(gains.engine_bandwidth)
    return loop_separations(rates, attitude, velocity, actuators, engine)


def build_guidance(scenario: Scenario, aircraft: Sequence[ResolvedAircraft]) -> GuidanceSettings:
    """Build the guidance settings of a group of one or more aircraft.

    Velocity correction and climb rate have the smallest limit in the group.
    """
    guidance, hold = scenario.guidance, scenario.hold
    return GuidanceSettings(
        position_gain=as_array(guidance.position_gain_per_s),
        correction_max=as_array(min(member.correction_max_m_s for member in aircraft)),
        hold_radius=as_array(hold.radius_m),
        hold_turn=as_array(1.0 if hold.direction == "right" else -1.0),
        climb_rate_max=as_array(min([_HOLD_CLIMB_MAX_M_S, *(member.limits.climb_rate_max_m_s for member in aircraft)])),
    )


def build_flight_limits(limits: Limits) -> FlightLimits:
    """Convert limits in the units of the file to the autopilot's limits in SI units and rad."""
    return FlightLimits(
        speed_min=as_array(limits.speed_min_m_s),
        speed_max=as_array(limits.speed_max_m_s),
        bank_max=as_array(math.radians(limits.bank_max_deg)),
        alpha_min=as_array(math.radians(limits.alpha_min_deg)),
        alpha_max=as_array(math.radians(limits.alpha_max_deg)),
        load_factor_min=as_array(limits.load_factor_min),
        load_factor_max=as_array(limits.load_factor_max),
        rates_max=as_array([math.radians(x) for x in _RATES_MAX_DEG_S]),
        altitude_min=as_array(limits.altitude_min_m),
        bank_rate_max=_bank_rate(limits),
    )


def build_path_limits(scenario: Scenario) -> PathLimits:
    """Build path limits that every aircraft of the scenario can keep: the tightest in the fleet.

    The reserve that plans leave to the autopilot (`planned_limits`) is not subtracted.
    """
    fleet_limits = [aircraft.limits for aircraft in resolve_fleet(scenario)]
    slowest = max(limits.speed_min_m_s for limits in fleet_limits)
    fastest = min(limits.speed_max_m_s for limits in fleet_limits)
    path_limits = [_path_limits(limits, slowest, fastest, 1.0) for limits in fleet_limits]

    def turn_and_climb(limits: PathLimits) -> tuple[Scalar, Scalar, Scalar]:
        return limits.bank_max, limits.climb_rate_max, limits.load_factor_max

    smallest = tuple(min(values) for values in zip(*map(turn_and_climb, path_limits), strict=True))
    greatest_push_over = max(limits.load_factor_min for limits in path_limits)
    return eqx.tree_at(
        lambda limits: (*turn_and_climb(limits), limits.load_factor_min),
        path_limits[0],
        (*smallest, greatest_push_over),
    )


def _path_limits(limits: Limits, speed_min_m_s: float, speed_max_m_s: float, fraction: float) -> PathLimits:
    """Build path limits; `fraction` reduces bank, bank rate, climb rate, and the differences of load factors from 1."""
    return PathLimits(
        speed_min=as_array(speed_min_m_s),
        speed_max=as_array(speed_max_m_s),
        bank_max=as_array(fraction * limits.bank_max_deg * DEG_RAD),
        climb_rate_max=as_array(fraction * limits.climb_rate_max_m_s),
        altitude_min=as_array(limits.altitude_min_m),
        altitude_max=as_array(limits.altitude_max_m),
        load_factor_max=as_array(1.0 + fraction * (limits.load_factor_max - 1.0)),
        load_factor_min=as_array(1.0 - fraction * (1.0 - push_over_limit(limits))),
        bank_rate_max=_bank_rate(limits, fraction),
    )


def push_over_limit(limits: Limits) -> float:
    """Return the least load factor of a path: the scenario's, but not below 0.5 (`NORMAL_TURNING_G`)."""
    return max(limits.load_factor_min, NORMAL_TURNING_G)


def _bank_rate(limits: Limits, fraction: float = 1.0) -> Scalar | None:
    """Return `fraction` times the limit of the bank rate, rad/s; None if the scenario sets no limit."""
    limit_deg_s = limits.roll_rate_max_deg_s
    return None if limit_deg_s is None else as_array(fraction * limit_deg_s * DEG_RAD)


def planned_limits(scenario: Scenario, aircraft: ResolvedAircraft) -> PathLimits:
    """Build one aircraft's path limits, reduced by the reserve (`fleet.reserve`) that plans leave to the autopilot.

    If necessary, the airspeed range is widened to contain the start airspeed. If the scenario omits the limits of
    acceleration and deceleration along the path, these limits are infinite.
    """
    limits, speed, reserve = aircraft.limits, scenario.speed_for(aircraft.table), scenario.fleet.reserve
    slowest = limits.speed_min_m_s + reserve * (speed - limits.speed_min_m_s)
    fastest = limits.speed_max_m_s - reserve * (limits.speed_max_m_s - speed)
    start_speed = aircraft.table.start.airspeed_m_s
    slowest = max(min(slowest, start_speed - 1.0), limits.speed_min_m_s)
    fastest = min(max(fastest, start_speed + 1.0), limits.speed_max_m_s)
    return eqx.tree_at(
        lambda planned: (planned.acceleration_max, planned.deceleration_max),
        _path_limits(limits, slowest, fastest, 1.0 - reserve),
        tuple(
            as_array(math.inf if value is None else value)
            for value in (limits.acceleration_max_m_s2, limits.deceleration_max_m_s2)
        ),
    )
