"""Whether a fleet can be planned in the Earth's chart: how true it is where the fleet flies, and where it ends."""

import math
from typing import TYPE_CHECKING, NamedTuple

from anser.config.errors import Problem, format_number
from anser.constants import WGS84_A_M, WGS84_F
from anser.scenario.schema_checks import label

if TYPE_CHECKING:
    from anser.scenario.schema import Scenario


SCALE_ERROR_MAX = 0.05
"""By how much lengths of the chart may be wrong over the round Earth: half of the default `fleet.reserve`, so that a
plan that keeps its limits in the chart with this reserve keeps them over the ground with half of it."""

TURN_MAX_DEG_S = 0.02
"""How fast north may turn under an aircraft that flies east: plans take the chart's axes as steady. Measured with the
three-aircraft mission: up to 0.019 deg/s the arrivals are those of 20 deg of latitude (0.001 s apart), at 0.026 deg/s
the aircraft with the longest way changes late, and they are 0.065 s apart."""

# Of the meridian at the equator, the smallest radius of curvature of the ellipsoid: every angle errs upwards, by 1 %.
_RADIUS_M = WGS84_A_M * (1.0 - WGS84_F) ** 2


class _Position(NamedTuple):
    path: str
    whom: str
    north_m: float
    east_m: float


def chart_problems(scenario: "Scenario") -> list[Problem]:
    """Find an origin from which the chart is too wrong for the fleet's places, or which is too near to a pole.

    At most one problem, with an origin that would do. Over a flat Earth the chart is true by definition, but its places
    still need a longitude and a latitude.
    """
    places = _positions(scenario)
    wrong = _map_problem(scenario, places, scenario.earth.latitude_deg)
    if wrong is None:
        return []
    arrived, otherwise = wrong
    sign = math.copysign(1.0, scenario.earth.latitude_deg)
    nearer = (sign * tenth / 10.0 for tenth in range(int(10.0 * abs(scenario.earth.latitude_deg)), -1, -1))
    found = next((latitude for latitude in nearer if _map_problem(scenario, places, latitude) is None), None)
    words = (
        otherwise
        if found is None
        else f"{format_number(found)} or nearer to the equator for this fleet, or {otherwise}"
    )
    return [Problem("earth.latitude_deg", f"{format_number(scenario.earth.latitude_deg)}, {arrived}", words)]


def _map_problem(scenario: "Scenario", places: list[_Position], latitude_deg: float) -> tuple[str, str] | None:
    """Say what is wrong with an origin at a latitude, and what but another origin would help; None if nothing."""
    speed_m_s, duration_s = scenario.fleet.speed_m_s, scenario.timing.duration_s
    if scenario.earth.model == "wgs84":
        worst = max(places, key=lambda place: scale_error(latitude_deg, place.north_m, place.east_m))
        error = scale_error(latitude_deg, worst.north_m, worst.east_m)
        if error > SCALE_ERROR_MAX:
            so = (
                "at or beyond the pole"
                if math.isinf(error)
                else f"where its lengths are wrong by {100.0 * error:.0f} %"
            )
            wanted = f"places nearer to the origin: plans need a chart that is true to {100.0 * SCALE_ERROR_MAX:g} %"
            return f"whose chart has {worst.path} ({worst.whom}) {so}", wanted
        turn_deg_s = math.degrees(speed_m_s * math.tan(math.radians(abs(latitude_deg))) / _RADIUS_M)
        if turn_deg_s > TURN_MAX_DEG_S:
            arrived = (
                f"where north turns by {turn_deg_s:.3f} deg/s under a flight east at {format_number(speed_m_s)} m/s"
            )
            return arrived, f"a slower fleet (fleet.speed_m_s): plans bear {TURN_MAX_DEG_S:g} deg/s"
    # who flies out of the places and arrives has to come back
    reach_m = 0.5 * (scenario.limits.speed_max_m_s + scenario.wind.speed_max_m_s) * duration_s
    if _is_inside_map(latitude_deg, places, reach_m):
        return None
    arrived = (
        f"where a flight of {format_number(duration_s)} s (timing.duration_s) that turns back after "
        f"{reach_m / 1000.0:.0f} km "
        "can cross the pole or the meridian opposite to the origin, and a plan cannot"
    )
    return arrived, "a shorter flight, or nearer places"


def _positions(scenario: "Scenario") -> list[_Position]:
    """List where aircraft start, and the corners around what they fly to and circle there."""
    duration_s, radius_m = scenario.timing.duration_s, scenario.hold.radius_m
    found = []
    for index, one in enumerate(scenario.aircraft):
        north_m, east_m, _ = one.start.position_m
        found.append(_Position(f"aircraft[{index}].start", label("aircraft", one), north_m, east_m))
    for index, goal in enumerate(scenario.goal):
        offsets = [one.rendezvous.stand_off_m[:2] for one in scenario.aircraft if one.goal == goal.name]
        margin_m = radius_m + max((math.hypot(*offset) for offset in offsets), default=0.0)
        times_s = {0.0, duration_s, *(p.time_s for p in goal.waypoints or () if p.time_s < duration_s)}
        for time_s in sorted(times_s):
            north_m, east_m, _ = goal.position_m(time_s)
            where = (f"goal[{index}] with its hold after {format_number(time_s)} s", label("goal", goal))
            found.extend(
                _Position(*where, north_m + north * margin_m, east_m + east * margin_m)
                for north in (-1.0, 1.0)
                for east in (-1.0, 1.0)
            )
    return found


def scale_error(latitude_deg: float, north_m: float, east_m: float) -> float:
    """By which part lengths of the chart of an origin are too long or too short at a place; infinite over a pole."""
    origin = math.radians(latitude_deg)
    north, east = north_m / _RADIUS_M, east_m / (_RADIUS_M * math.cos(origin))
    latitude = origin + math.atan(north)
    if abs(latitude) >= 0.5 * math.pi:
        return math.inf
    scales = (1.0 + north * north, (1.0 + east * east) * math.cos(origin) / math.cos(latitude))
    return max(max(scale, 1.0 / scale) for scale in scales) - 1.0


def _is_inside_map(latitude_deg: float, places: list[_Position], reach_m: float) -> bool:
    """Whether what lies within `reach_m` of the places has a latitude and a longitude of its own in the chart."""
    origin = math.radians(latitude_deg)
    across_m = _RADIUS_M * math.cos(origin)
    north = max(math.atan(place.north_m / _RADIUS_M) for place in places) + reach_m / _RADIUS_M
    south = min(math.atan(place.north_m / _RADIUS_M) for place in places) - reach_m / _RADIUS_M
    # beyond an eighth of a turn the chart stretches no further: half its lengths are the angle
    east = max(abs(place.east_m) for place in places) / across_m + reach_m / across_m
    turned = math.atan(east) if east < 1.0 else 0.25 * math.pi + 0.5 * (east - 1.0)
    return origin + north < 0.5 * math.pi and origin + south > -0.5 * math.pi and turned < math.pi
