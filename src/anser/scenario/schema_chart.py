"""Checks that the Earth's chart (local map) is accurate enough for a fleet's flight and large enough to contain it."""

import math
from typing import NamedTuple

from anser.config.errors import Problem, format_number
from anser.constants import WGS84_A_M, WGS84_F
from anser.scenario.schema_tables import ScenarioTables

SCALE_ERROR_MAX = 0.05
"""Greatest relative error of lengths in the chart (map) of the round Earth: half of the default `fleet.reserve`."""

TURN_MAX_DEG_S = 0.02
"""Greatest rate at which north turns below an aircraft that flies east, deg/s; plans assume that north is steady. In
the three-aircraft mission, the arrivals differ by 0.001 s up to 0.019 deg/s, and by 0.065 s at 0.026 deg/s."""

# The ellipsoid's smallest radius of curvature (meridian at the equator), so angles are overestimated, by up to 1 %.
_RADIUS_M = WGS84_A_M * (1.0 - WGS84_F) ** 2


class _Position(NamedTuple):
    path: str
    whom: str
    north_m: float
    east_m: float


def chart_problems(scenario: ScenarioTables) -> list[Problem]:
    """Return the problem of an origin whose chart (local map) is too inaccurate or too small for the fleet, if any.

    The result has at most one problem, which suggests a better latitude if there is one.
    """
    positions = _positions(scenario)
    defect = _map_problem(scenario, positions, scenario.earth.latitude_deg)
    if defect is None:
        return []
    arrived, remedy = defect
    sign = math.copysign(1.0, scenario.earth.latitude_deg)
    candidate_latitudes = (sign * tenth / 10.0 for tenth in range(int(10.0 * abs(scenario.earth.latitude_deg)), -1, -1))
    better_latitude = next(
        (latitude for latitude in candidate_latitudes if _map_problem(scenario, positions, latitude) is None), None
    )
    expected = (
        remedy
        if better_latitude is None
        else f"{format_number(better_latitude)} or nearer to the equator for this fleet, or {remedy}"
    )
    return [Problem("earth.latitude_deg", f"{format_number(scenario.earth.latitude_deg)}, {arrived}", expected)]


def _map_problem(scenario: ScenarioTables, positions: list[_Position], latitude_deg: float) -> tuple[str, str] | None:
    """Return defect and remedy of a local map at a latitude, None if it is fit; the remedy keeps the origin."""
    fastest, duration_s = max(scenario.aircraft, key=scenario.speed_for), scenario.timing.duration_s
    speed_m_s = scenario.speed_for(fastest)
    if scenario.earth.model == "wgs84":
        worst = max(positions, key=lambda position: scale_error(latitude_deg, position.north_m, position.east_m))
        error = scale_error(latitude_deg, worst.north_m, worst.east_m)
        if error > SCALE_ERROR_MAX:
            description = (
                "at or beyond the pole"
                if math.isinf(error)
                else f"where its lengths are wrong by {100.0 * error:.0f} %"
            )
            remedy = f"places nearer to the origin: plans need a chart that is true to {100.0 * SCALE_ERROR_MAX:g} %"
            return f"whose chart has {worst.path} ({worst.whom}) {description}", remedy
        turn_deg_s = math.degrees(speed_m_s * math.tan(math.radians(abs(latitude_deg))) / _RADIUS_M)
        if turn_deg_s > TURN_MAX_DEG_S:
            arrived = (
                f"where north turns by {turn_deg_s:.3f} deg/s under a flight east at {format_number(speed_m_s)} m/s"
            )
            whom = fastest.label if fastest.airspeed_forms else f"fleet (fleet.{scenario.fleet.airspeed_key})"
            return arrived, f"a slower {whom}: plans bear {TURN_MAX_DEG_S:g} deg/s"
    # an aircraft that leaves the area must return to arrive
    reach_m = 0.5 * (scenario.speed_limit_m_s + scenario.wind.speed_max_m_s) * duration_s
    if _is_inside_map(latitude_deg, positions, reach_m):
        return None
    arrived = (
        f"where a flight of {format_number(duration_s)} s (timing.duration_s) that turns back after "
        f"{reach_m / 1000.0:.0f} km can cross the pole or the meridian opposite to the origin, and a plan cannot"
    )
    return arrived, "a shorter flight, or nearer places"


def _positions(scenario: ScenarioTables) -> list[_Position]:
    """List the starts of the aircraft, and corners of squares around goals, rendezvous points and holds."""
    duration_s, radius_m = scenario.timing.duration_s, scenario.hold.radius_m
    positions = []
    for index, aircraft in enumerate(scenario.aircraft):
        north_m, east_m, _ = aircraft.start.position_m
        positions.append(_Position(f"aircraft[{index}].start", aircraft.label, north_m, east_m))
    for index, goal in enumerate(scenario.goal):
        offsets = [aircraft.rendezvous.stand_off_m[:2] for aircraft in scenario.aircraft if aircraft.goal == goal.name]
        margin_m = radius_m + max((math.hypot(*offset) for offset in offsets), default=0.0)
        times_s = {
            0.0,
            duration_s,
            *(waypoint.time_s for waypoint in goal.waypoints or () if waypoint.time_s < duration_s),
        }
        for time_s in sorted(times_s):
            north_m, east_m, _ = goal.position_m(time_s)
            identity = (f"goal[{index}] with its hold after {format_number(time_s)} s", goal.label)
            positions.extend(
                _Position(*identity, north_m + north * margin_m, east_m + east * margin_m)
                for north in (-1.0, 1.0)
                for east in (-1.0, 1.0)
            )
    return positions


def scale_error(latitude_deg: float, north_m: float, east_m: float) -> float:
    """Compute the relative error of lengths at a position in the chart of an origin; infinite at or beyond a pole.

    The position is north and east of the origin, m; the origin has the geodetic latitude `latitude_deg`.
    """
    origin = math.radians(latitude_deg)
    north, east = north_m / _RADIUS_M, east_m / (_RADIUS_M * math.cos(origin))
    latitude = origin + math.atan(north)
    if abs(latitude) >= 0.5 * math.pi:
        return math.inf
    scales = (1.0 + north * north, (1.0 + east * east) * math.cos(origin) / math.cos(latitude))
    return max(max(scale, 1.0 / scale) for scale in scales) - 1.0


def _is_inside_map(latitude_deg: float, positions: list[_Position], reach_m: float) -> bool:
    """Whether every point within `reach_m` (m) of the positions has a unique latitude and longitude in the chart."""
    origin = math.radians(latitude_deg)
    across_m = _RADIUS_M * math.cos(origin)
    north = max(math.atan(position.north_m / _RADIUS_M) for position in positions) + reach_m / _RADIUS_M
    south = min(math.atan(position.north_m / _RADIUS_M) for position in positions) - reach_m / _RADIUS_M
    # beyond an eighth of a turn the angle is half the chart's length, an upper bound
    east = max(abs(position.east_m) for position in positions) / across_m + reach_m / across_m
    longitude_change = math.atan(east) if east < 1.0 else 0.25 * math.pi + 0.5 * (east - 1.0)
    return origin + north < 0.5 * math.pi and origin + south > -0.5 * math.pi and longitude_change < math.pi
