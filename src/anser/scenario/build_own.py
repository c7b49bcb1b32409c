"""What follows from the aircraft itself where a scenario says nothing: gains, and limits by its trim map.

The library's F-16 has the published gains, and limits that the defaults of a scenario were made for.
"""

import copy
import math
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from anser.aircraft import AbstractAirframe, condition
from anser.compiling import compiled
from anser.control import AutopilotGains, Bandwidths, automatic_gains, own_bandwidths
from anser.environment import Environment, standard_environment
from anser.numerics import as_array
from anser.scenario.schema import Scenario
from anser.scenario.schema_aircraft import Aircraft
from anser.scenario.schema_settings import Limits
from anser.shapes import Scalar
from anser.simulation import Capability, MapPoint, capability_of, capability_points, solve_trim, trim_target

_ALTITUDES_M = 500.0
"""Steps of the altitude at which an aircraft is looked at: those that start near each other have one trim map."""
_SPEEDS = (0.3, 3.0)
"""Range of airspeeds that is looked through where nothing is known, of the one preferred."""
_BANK_MOST_DEG = 45.0
"""Greatest bank that is planned with where a scenario gives none."""
_CACHED = 64


class Own(NamedTuple):
    """What an aircraft can do, and the bandwidths that it bears."""

    able: Capability
    bandwidths: Bandwidths


_found: dict[tuple[int, float, float, float, tuple[float, float]], tuple[AbstractAirframe, Own]] = {}


def has_own(aircraft: Aircraft) -> bool:
    """Whether gains and limits of an aircraft follow from itself: of all but the library's F-16."""
    return aircraft.airframe is not None or aircraft.type != "f16"


def own_of(scenario: Scenario, aircraft: Aircraft, airframe: AbstractAirframe) -> Own:
    """What one aircraft can do near its start at the airspeed that it prefers, in the standard atmosphere."""
    speed, known = scenario.speed_for(aircraft), aircraft.range.airspeed_m_s
    altitude = round(aircraft.start.altitude_m / _ALTITUDES_M) * _ALTITUDES_M
    speeds = (_SPEEDS[0] * speed, _SPEEDS[1] * speed) if known is None else known
    return look_at(airframe, altitude, speed, speeds, scenario.timing.step_s)


def look_at(
    airframe: AbstractAirframe, altitude_m: float, speed_m_s: float, speeds_m_s: tuple[float, float], step_s: float
) -> Own:
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
    if key not in _found:
        if len(_found) >= _CACHED:
            _found.clear()
        environment = standard_environment()
        ends = (as_array(speeds_m_s[0]), as_array(speeds_m_s[1]))
        points, bandwidths = _looked_at(
            airframe, environment, as_array(altitude_m), as_array(speed_m_s), as_array(step_s), ends
        )
        able = capability_of(airframe, jax.tree.map(np.asarray, points), speed_m_s, speeds_m_s)
        # the airframe stands beside it, so that its identity is that of no other
        _found[key] = airframe, Own(able, jax.tree.map(np.asarray, bandwidths))
    return _found[key][1]


@compiled
def _looked_at(
    airframe: AbstractAirframe,
    environment: Environment,
    altitude: Scalar,
    speed: Scalar,
    step: Scalar,
    speeds: tuple[Scalar, Scalar],
) -> tuple[MapPoint, Bandwidths]:
    trim = solve_trim(airframe, environment, trim_target(speed, altitude))
    now = condition(airframe, environment, 0.0, trim.state)
    power = jnp.clip(trim.power, 0.0, 100.0)
    return (
        capability_points(airframe, environment, altitude, speed, speeds),
        own_bandwidths(airframe, now, airframe.actuators.limited(trim.state.surfaces), power, step),
    )


def with_own_gains(given: AutopilotGains, aircraft: Aircraft, own: Own) -> AutopilotGains:
    """Gains of the aircraft itself, but for the loops whose gains the scenario gives."""
    found = automatic_gains(own.bandwidths)
    for loop in ("rates", "attitude", "velocity"):
        if loop in aircraft.gains.model_fields_set:
            found = eqx.tree_at(lambda g, loop=loop: getattr(g, loop), found, getattr(given, loop))
    return eqx.tree_at(lambda g: g.sensor_bandwidth, found, given.sensor_bandwidth)


def own_limits(limits: Limits, able: Capability) -> Limits:
    """Limits as the scenario gives them, or as the aircraft's trim map has them where it does not.

    The least airspeed is one at which the aircraft still banks as far as it may: of level flight, times the root of the
    load factor of that turn.
    """
    given = limits.model_fields_set
    if math.isnan(able.speed_min):
        return limits  # it does not fly level anywhere: what stands in its way is told by its trim
    meant = copy.copy(limits)

    def instead(key: str, value: float) -> None:
        if key not in given:
            object.__setattr__(meant, key, value)

    bank_deg = min(limits.bank_max_deg, math.degrees(able.bank_max), _BANK_MOST_DEG)
    if bank_deg > 0.0:
        instead("bank_max_deg", bank_deg)
    bank_deg = min(meant.bank_max_deg, math.degrees(able.bank_max))
    slowest = able.speed_min / math.sqrt(math.cos(math.radians(bank_deg)))
    fastest = min(able.speed_max, limits.speed_max_m_s)
    if slowest < fastest:
        instead("speed_min_m_s", max(slowest, limits.speed_min_m_s))
        instead("speed_max_m_s", fastest)
    climb = min(able.climb_rate_max, able.sink_rate_max)
    if climb > 0.0:
        instead("climb_rate_max_m_s", min(limits.climb_rate_max_m_s, climb))
    return meant


def beyond_own(scenario: Scenario, limits: Limits, index: int, able: Capability) -> tuple[str, ...]:
    """What the scenario asks of an aircraft that it cannot do, one sentence each."""
    one = scenario.aircraft[index]
    whom, speed = f'aircraft[{index}] "{one.name}"', scenario.speed_for(one)
    if math.isnan(able.speed_min):
        return (f"{whom}: no airspeed of level flight was found at {one.start.altitude_m:g} m",)
    found = []
    for key, asked, most, what, unit in (
        ("bank_max_deg", limits.bank_max_deg, math.degrees(able.bank_max), "banks in level turns at most", "deg"),
        ("speed_max_m_s", limits.speed_max_m_s, able.speed_max, "flies level at most at", "m/s"),
        ("climb_rate_max_m_s", limits.climb_rate_max_m_s, able.climb_rate_max, "climbs steadily at most at", "m/s"),
    ):
        if key in scenario.limits.model_fields_set and asked > most * 1.02:
            found.append(f"limits.{key} = {asked:g}: {whom} {what} {most:.1f} {unit} (at {speed:g} m/s)")
    if "speed_min_m_s" in scenario.limits.model_fields_set and limits.speed_min_m_s < able.speed_min / 1.02:
        found.append(
            f"limits.speed_min_m_s = {limits.speed_min_m_s:g}: {whom} flies level from {able.speed_min:.1f} m/s on"
        )
    return tuple(found)
