"""Limits that flight and plan keep, and how an aircraft follows its plan within them."""

import math

import equinox as eqx

from anser.compiling import enable_compilation_cache
from anser.control import FlightLimits, GuidanceSettings
from anser.numerics import as_array
from anser.planning import PathLimits
from anser.scenario.build_aircraft import build_airframe_of
from anser.scenario.build_own import beyond_own, has_own, own_limits, own_of
from anser.scenario.schema import Scenario
from anser.scenario.schema_aircraft import Aircraft
from anser.scenario.schema_settings import Limits
from anser.shapes import Scalar
from anser.units import DEG_RAD

_CORRECTION_MAX_M_S = 20.0  # what position feedback may add to the planned velocity
_CORRECTION_PART = 0.13  # the same, part of the airspeed that an aircraft prefers, where it is not the library's F-16
_HOLD_CLIMB_MAX_M_S = 20.0  # vertical speed in the hold, within the scenario's own limit
_RATES_MAX_DEG_S = (120.0, 60.0, 60.0)  # body rates that the autopilot may ask for
_ROLL_RATE_DEG_S = 20.0  # of plans, on the mean, where no limit is given
_BANK_LAG_MOST = math.radians(10.0)  # how far the bank may lag behind a plan that rolls


def limits_of(scenario: Scenario, aircraft: Aircraft) -> Limits:
    """Limits of one aircraft: what the scenario leaves out follows from its file and its trim map."""
    limits = scenario.limits_for(aircraft)
    if not has_own(aircraft):
        return limits
    return own_limits(limits, own_of(scenario, aircraft, build_airframe_of(aircraft)).able)


def asked_beyond(scenario: Scenario) -> tuple[str, ...]:
    """What the scenario asks of its aircraft that they cannot do by their trim maps, one sentence each."""
    enable_compilation_cache()
    found = []
    for index, one in enumerate(scenario.aircraft):
        if has_own(one):
            able = own_of(scenario, one, build_airframe_of(one)).able
            found += beyond_own(scenario, scenario.limits_for(one), index, able)
    return tuple(found)


def build_guidance(scenario: Scenario, aircraft: Aircraft | None = None) -> GuidanceSettings:
    """How one aircraft follows its plan; of the whole fleet, for its holds, where None."""
    guidance, hold = scenario.guidance, scenario.hold
    of = scenario.aircraft if aircraft is None else (aircraft,)
    climb_rates = [limits_of(scenario, one).climb_rate_max_m_s for one in of]
    corrections = [_CORRECTION_PART * scenario.speed_for(one) for one in of if has_own(one)]
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
    each = [limits_of(scenario, one) for one in scenario.aircraft]
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
    limits, speed, reserve = limits_of(scenario, aircraft), scenario.speed_for(aircraft), scenario.fleet.reserve
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
    if not has_own(aircraft) or scenario.limits.roll_rate_max_deg_s is not None:
        return usual
    bandwidth = float(own_of(scenario, aircraft, build_airframe_of(aircraft)).bandwidths.attitude[0])
    return min(usual, bandwidth * _BANK_LAG_MOST)
