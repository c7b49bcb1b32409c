"""From a table [[aircraft]] to its airframe, autopilot gains, flight limits and guidance.

Defaults that follow from the aircraft's trim map.
"""

import copy
import functools
import math
from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from anser.aircraft.airframe import AbstractAirframe
from anser.aircraft.dave_ml_aircraft import DaveMlAircraft
from anser.aircraft.derivative_aircraft import DerivativeAircraft
from anser.aircraft.dispersions import F16Dispersion, dispersed_f16
from anser.aircraft.f16 import F16_COEFFICIENTS, AbstractF16
from anser.aircraft.motion import flight_condition
from anser.aircraft_files.build import disperse_file_airframe
from anser.aircraft_files.deviations import Deviation
from anser.aircraft_files.library import airframe_of_table
from anser.compiling.options import compiled, enable_compilation_cache
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
from anser.control.limits import FlightLimits
from anser.environment.environment import Environment, standard_environment
from anser.numerics.arrays import as_array
from anser.planning.limits import PathLimits
from anser.scenario.schema import Scenario
from anser.scenario.schema_aircraft import Aircraft, AttitudeGains, Gains, RateGains, VelocityGains
from anser.scenario.schema_settings import Limits
from anser.shapes import Scalar
from anser.steady.performance import Capability, capability_from_points, capability_points
from anser.steady.trim import TrimMapPoint, solve_trim, trim_target
from anser.units import DEG_RAD


def build_airframe_of(aircraft: Aircraft) -> AbstractAirframe:
    """Airframe of one aircraft as its autopilot and planner know it."""
    return airframe_of_table(aircraft.type, aircraft.variant, aircraft.x_cg_over_c, aircraft.airframe)


def disperse_airframe(known: AbstractAirframe, deviation: Deviation) -> AbstractAirframe:
    """Airframe that differs from the known one as a scenario says; TypeError where no coefficients are known."""
    if isinstance(known, AbstractF16):
        return dispersed_f16(known, _f16_dispersion(deviation))
    if isinstance(known, DerivativeAircraft | DaveMlAircraft):
        return disperse_file_airframe(known, deviation)
    raise TypeError(f"a deviation of {type(known).__name__}, of which no coefficients are known")


def _f16_dispersion(deviation: Deviation) -> F16Dispersion:
    d = deviation
    return F16Dispersion(
        coefficients=as_array([getattr(d.coefficients, name) for name in F16_COEFFICIENTS]),
        thrust=as_array(d.thrust),
        mass=as_array(d.mass),
        second_moments=as_array(d.second_moments),
        actuator_bandwidth=as_array(d.actuator_bandwidth),
        cg_shift=as_array(d.cg_shift),
    )


_ALTITUDE_STEP_M = 500.0
"""Steps of the altitude at which an aircraft is looked at: those that start near each other have one trim map."""
_SPEED_SEARCH_RANGE = (0.3, 3.0)
"""Range of airspeeds that is looked through where nothing is known, of the one preferred."""
_BANK_MAX_DEG = 45.0
"""Greatest bank that is planned with where a scenario gives none."""
_CACHE_SIZE = 64


class DerivedDefaults(NamedTuple):
    """What an aircraft can do, and the bandwidths that it bears."""

    capability: Capability
    bandwidths: Bandwidths


_defaults_cache: dict[
    tuple[int, float, float, float, tuple[float, float]], tuple[AbstractAirframe, DerivedDefaults]
] = {}


def has_derived_defaults(aircraft: Aircraft) -> bool:
    """Whether gains and limits of an aircraft follow from itself: of all but the library's F-16."""
    return aircraft.airframe is not None or aircraft.type != "f16"


def derive_defaults(scenario: Scenario, aircraft: Aircraft, airframe: AbstractAirframe) -> DerivedDefaults:
    """What one aircraft can do near its start at the airspeed that it prefers, in the standard atmosphere."""
    speed, known = scenario.speed_for(aircraft), aircraft.range.airspeed_m_s
    altitude = round(aircraft.start.altitude_m / _ALTITUDE_STEP_M) * _ALTITUDE_STEP_M
    speeds = (_SPEED_SEARCH_RANGE[0] * speed, _SPEED_SEARCH_RANGE[1] * speed) if known is None else known
    return compute_defaults(airframe, altitude, speed, speeds, scenario.timing.step_s)


def compute_defaults(
    airframe: AbstractAirframe, altitude_m: float, speed_m_s: float, speeds_m_s: tuple[float, float], step_s: float
) -> DerivedDefaults:
    """What an aircraft can do at an altitude, and the bandwidths that it bears there, in the standard atmosphere.

    Parameters
    ----------
    airframe
        Looked at once; the same object again is remembered.
    speed_m_s
        Airspeed of turns, climbs and bandwidths.
    speeds_m_s
        Between which airspeeds level flight is looked for.
    step_s
        Of the autopilot's samples.
    """
    key = (id(airframe), speed_m_s, altitude_m, step_s, speeds_m_s)
    if key not in _defaults_cache:
        if len(_defaults_cache) >= _CACHE_SIZE:
            _defaults_cache.clear()
        environment = standard_environment()
        ends = (as_array(speeds_m_s[0]), as_array(speeds_m_s[1]))
        points, bandwidths = _capability_and_bandwidths(
            airframe, environment, as_array(altitude_m), as_array(speed_m_s), as_array(step_s), ends
        )
        able = capability_from_points(airframe, jax.tree.map(np.asarray, points), speed_m_s, speeds_m_s)
        # the airframe stands beside it, so that its identity is that of no other
        _defaults_cache[key] = airframe, DerivedDefaults(able, jax.tree.map(np.asarray, bandwidths))
    return _defaults_cache[key][1]


@compiled
def _capability_and_bandwidths(
    airframe: AbstractAirframe,
    environment: Environment,
    altitude: Scalar,
    speed: Scalar,
    step: Scalar,
    speeds: tuple[Scalar, Scalar],
) -> tuple[TrimMapPoint, Bandwidths]:
    trim = solve_trim(airframe, environment, trim_target(speed, altitude))
    now = flight_condition(airframe, environment, 0.0, trim.state)
    power = jnp.clip(trim.power, 0.0, 100.0)
    return (
        capability_points(airframe, environment, altitude, speed, speeds),
        derived_bandwidths(airframe, now, airframe.actuators.limit_command(trim.state.surfaces), power, step),
    )


def with_derived_gains(given: AutopilotGains, aircraft: Aircraft, defaults: DerivedDefaults) -> AutopilotGains:
    """Gains of the aircraft itself, but for the loops whose gains the scenario gives."""
    found = automatic_gains(defaults.bandwidths)
    for loop in ("rates", "attitude", "velocity"):
        if loop in aircraft.gains.model_fields_set:
            found = eqx.tree_at(lambda g, loop=loop: getattr(g, loop), found, getattr(given, loop))
    return eqx.tree_at(lambda g: g.sensor_bandwidth, found, given.sensor_bandwidth)


def derived_limits(limits: Limits, capability: Capability) -> Limits:
    """Limits as the scenario gives them, or as the aircraft's trim map has them where it does not.

    The least airspeed is one at which the aircraft still banks as far as it may: of level flight, times the root of the
    load factor of that turn.
    """
    given = limits.model_fields_set
    if math.isnan(capability.speed_min):
        return limits  # it does not fly level anywhere: what stands in its way is told by its trim
    meant = copy.copy(limits)

    def instead(key: str, value: float) -> None:
        if key not in given:
            object.__setattr__(meant, key, value)

    bank_deg = min(limits.bank_max_deg, math.degrees(capability.bank_max), _BANK_MAX_DEG)
    if bank_deg > 0.0:
        instead("bank_max_deg", bank_deg)
    bank_deg = min(meant.bank_max_deg, math.degrees(capability.bank_max))
    slowest = capability.speed_min / math.sqrt(math.cos(math.radians(bank_deg)))
    fastest = min(capability.speed_max, limits.speed_max_m_s)
    if slowest < fastest:
        instead("speed_min_m_s", max(slowest, limits.speed_min_m_s))
        instead("speed_max_m_s", fastest)
    climb = min(capability.climb_rate_max, capability.sink_rate_max)
    if climb > 0.0:
        instead("climb_rate_max_m_s", min(limits.climb_rate_max_m_s, climb))
    return meant


def exceeds_capability(scenario: Scenario, limits: Limits, index: int, capability: Capability) -> tuple[str, ...]:
    """What the scenario asks of an aircraft that it cannot do, one sentence each."""
    one = scenario.aircraft[index]
    whom, speed = f'aircraft[{index}] "{one.name}"', scenario.speed_for(one)
    if math.isnan(capability.speed_min):
        return (f"{whom}: no airspeed of level flight was found at {one.start.altitude_m:g} m",)
    found = []
    for key, asked, most, what, unit in (
        ("bank_max_deg", limits.bank_max_deg, math.degrees(capability.bank_max), "banks in level turns at most", "deg"),
        ("speed_max_m_s", limits.speed_max_m_s, capability.speed_max, "flies level at most at", "m/s"),
        (
            "climb_rate_max_m_s",
            limits.climb_rate_max_m_s,
            capability.climb_rate_max,
            "climbs steadily at most at",
            "m/s",
        ),
    ):
        if key in scenario.limits.model_fields_set and asked > most * 1.02:
            found.append(f"limits.{key} = {asked:g}: {whom} {what} {most:.1f} {unit} (at {speed:g} m/s)")
    if "speed_min_m_s" in scenario.limits.model_fields_set and limits.speed_min_m_s < capability.speed_min / 1.02:
        found.append(
            f"limits.speed_min_m_s = {limits.speed_min_m_s:g}: {whom} flies level from "
            f"{capability.speed_min:.1f} m/s on"
        )
    return tuple(found)


def resolve_gains(scenario: Scenario, aircraft: Aircraft) -> AutopilotGains:
    """Gains of one aircraft's autopilot: given, published (of the F-16), or the aircraft's own."""
    given = build_gains(aircraft)
    if not has_derived_defaults(aircraft):
        return given
    return with_derived_gains(given, aircraft, derive_defaults(scenario, aircraft, build_airframe_of(aircraft)))


def build_gains(aircraft: Aircraft) -> AutopilotGains:
    """Gains of one aircraft's autopilot."""
    return _built_gains(aircraft.gains)  # pyright: ignore[reportArgumentType] - frozen, so it has a hash


@functools.lru_cache(maxsize=256)
def _built_gains(gains: Gains) -> AutopilotGains:
    bandwidth = gains.sensor_bandwidth_rad_s if gains.inversion == "incremental" else 0.0
    return eqx.tree_at(
        lambda g: (g.rates, g.attitude, g.velocity, g.sensor_bandwidth),
        published_gains(),
        (_loop(gains.rates), _loop(gains.attitude), _loop(gains.velocity), as_array(bandwidth)),
    )


def _loop(gains: RateGains | AttitudeGains | VelocityGains) -> LoopGains:
    def channels(values: Sequence[float]) -> Array:
        return as_array(values)

    others = channels(gains.derivative), channels(gains.feed_forward)
    if gains.bandwidth_rad_s is not None:
        damping = (math.inf,) * 3 if gains.damping is None else gains.damping
        return design_gains(channels(gains.bandwidth_rad_s), channels(damping), *others)
    return LoopGains(channels(gains.proportional), channels(gains.integral), *others)


_CORRECTION_MAX_M_S = 20.0  # what position feedback may add to the planned velocity
_CORRECTION_SHARE = 0.13  # the same, part of the airspeed that an aircraft prefers, where it is not the library's F-16
_HOLD_CLIMB_MAX_M_S = 20.0  # vertical speed in the hold, within the scenario's own limit
_RATES_MAX_DEG_S = (120.0, 60.0, 60.0)  # body rates that the autopilot may ask for
_ROLL_RATE_DEG_S = 20.0  # of plans, on the mean, where no limit is given
_BANK_LAG_MAX = math.radians(10.0)  # how far the bank may lag behind a plan that rolls


def resolve_limits(scenario: Scenario, aircraft: Aircraft) -> Limits:
    """Limits of one aircraft: what the scenario leaves out follows from its file and its trim map."""
    limits = scenario.limits_for(aircraft)
    if not has_derived_defaults(aircraft):
        return limits
    return derived_limits(limits, derive_defaults(scenario, aircraft, build_airframe_of(aircraft)).capability)


def capability_cautions(scenario: Scenario) -> tuple[str, ...]:
    """What the scenario asks of its aircraft that they cannot do by their trim maps, one sentence each."""
    enable_compilation_cache()
    found = []
    for index, one in enumerate(scenario.aircraft):
        if has_derived_defaults(one):
            able = derive_defaults(scenario, one, build_airframe_of(one)).capability
            found += exceeds_capability(scenario, scenario.limits_for(one), index, able)
    return tuple(found)


def build_guidance(scenario: Scenario, aircraft: Aircraft | None = None) -> GuidanceSettings:
    """How one aircraft follows its plan; of the whole fleet, for its holds, where None."""
    guidance, hold = scenario.guidance, scenario.hold
    of = scenario.aircraft if aircraft is None else (aircraft,)
    climb_rates = [resolve_limits(scenario, one).climb_rate_max_m_s for one in of]
    corrections = [_CORRECTION_SHARE * scenario.speed_for(one) for one in of if has_derived_defaults(one)]
    return GuidanceSettings(
        position_gain=as_array(guidance.position_gain_per_s),
        correction_max=as_array(min([_CORRECTION_MAX_M_S, *corrections])),
        hold_radius=as_array(hold.radius_m),
        hold_turn=as_array(1.0 if hold.direction == "right" else -1.0),
        climb_rate_max=as_array(min([_HOLD_CLIMB_MAX_M_S, *climb_rates])),
    )


def build_flight_limits(limits: Limits) -> FlightLimits:
    """Limits that the autopilot keeps."""
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
    """What a trajectory may ask of every aircraft of this scenario."""
    each = [resolve_limits(scenario, one) for one in scenario.aircraft]
    slowest, fastest = max(one.speed_min_m_s for one in each), min(one.speed_max_m_s for one in each)
    least = [_path_limits(one, slowest, fastest, 1.0) for one in each]
    return eqx.tree_at(
        lambda own: (own.bank_max, own.climb_rate_max, own.load_factor_max),
        least[0],
        tuple(
            min(values)
            for values in zip(*((o.bank_max, o.climb_rate_max, o.load_factor_max) for o in least), strict=True)
        ),
    )


def _path_limits(limits: Limits, speed_min_m_s: float, speed_max_m_s: float, part: float) -> PathLimits:
    """Part of the limits of bank, climb rate and load factor beyond 1; all of the altitudes."""
    return PathLimits(
        speed_min=as_array(speed_min_m_s),
        speed_max=as_array(speed_max_m_s),
        bank_max=as_array(part * limits.bank_max_deg * DEG_RAD),
        climb_rate_max=as_array(part * limits.climb_rate_max_m_s),
        altitude_min=as_array(limits.altitude_min_m),
        altitude_max=as_array(limits.altitude_max_m),
        load_factor_max=as_array(1.0 + part * (limits.load_factor_max - 1.0)),
        bank_rate_max=_bank_rate(limits, part),
    )


def _bank_rate(limits: Limits, part: float = 1.0) -> Scalar | None:
    """Part of the limit of the bank angle's rate, rad/s; None where none is asked."""
    asked = limits.roll_rate_max_deg_s
    return None if asked is None else as_array(part * asked * DEG_RAD)


def planned_limits(scenario: Scenario, aircraft: Aircraft) -> PathLimits:
    """The scenario's limits less the reserve; the speed window contains the aircraft's first airspeed all the same."""
    limits, speed, reserve = resolve_limits(scenario, aircraft), scenario.speed_for(aircraft), scenario.fleet.reserve
    slowest = limits.speed_min_m_s + reserve * (speed - limits.speed_min_m_s)
    fastest = limits.speed_max_m_s - reserve * (limits.speed_max_m_s - speed)
    own = aircraft.start.speed_m_s
    slowest = max(min(slowest, own - 1.0), limits.speed_min_m_s)
    fastest = min(max(fastest, own + 1.0), limits.speed_max_m_s)
    return eqx.tree_at(
        lambda planned: (planned.acceleration_max, planned.deceleration_max),
        _path_limits(limits, slowest, fastest, 1.0 - reserve),
        tuple(
            as_array(math.inf if value is None else value)
            for value in (limits.acceleration_max_m_s2, limits.deceleration_max_m_s2)
        ),
    )


def planned_roll_rate(scenario: Scenario, aircraft: Aircraft) -> float:
    """How fast a plan rolls one aircraft on the mean, rad/s: as usual, or as its bank loop can follow."""
    usual = _ROLL_RATE_DEG_S * DEG_RAD
    if not has_derived_defaults(aircraft) or scenario.limits.roll_rate_max_deg_s is not None:
        return usual
    bandwidth = float(derive_defaults(scenario, aircraft, build_airframe_of(aircraft)).bandwidths.attitude[0])
    return min(usual, bandwidth * _BANK_LAG_MAX)
