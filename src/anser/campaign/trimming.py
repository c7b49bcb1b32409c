"""One trim point, for people: the numbers with their units, or what stops it."""

from dataclasses import dataclass

import equinox as eqx

from anser.aircraft import AbstractAirframe
from anser.compilation_cache import enable_compilation_cache
from anser.environment import standard_environment
from anser.simulation import TrimPoint, nearest_trims, solve_trim, trim_target, trim_violations
from anser.spatial import euler_from_quaternion
from anser.units import DEG_RAD, RAD_DEG

_solve = eqx.filter_jit(solve_trim)


@dataclass(frozen=True)
class FoundTrim:
    """A trim point for display.

    Attributes
    ----------
    point
        The solution.
    rows
        Name, value and unit of what it holds.
    diagnosis
        None where it can be flown; otherwise which limit stops it and where the nearest trim points are.
    """

    point: TrimPoint
    rows: tuple[tuple[str, float, str], ...]
    diagnosis: str | None


def find_trim(
    airframe: AbstractAirframe,
    speed_m_s: float,
    altitude_m: float,
    path_angle_deg: float = 0.0,
    turn_rate_deg_s: float = 0.0,
) -> FoundTrim:
    """Trim an airframe in the standard atmosphere, in still air and standard gravity.

    Parameters
    ----------
    airframe
        What to trim.
    speed_m_s, altitude_m
        True airspeed and geometric altitude.
    path_angle_deg, turn_rate_deg_s
        Climb angle and rate of the course, right positive.
    """
    enable_compilation_cache()
    environment = standard_environment()
    target = trim_target(speed_m_s, altitude_m, path_angle_deg * DEG_RAD, turn_rate=turn_rate_deg_s * DEG_RAD)
    point = _solve(airframe, environment, target)
    stopped = bool(trim_violations(airframe, environment, point))
    diagnosis = nearest_trims(airframe, environment, target).message() if stopped else None
    return FoundTrim(point, _rows(airframe, point, altitude_m, speed_m_s), diagnosis)


def _rows(
    airframe: AbstractAirframe, point: TrimPoint, altitude_m: float, speed_m_s: float
) -> tuple[tuple[str, float, str], ...]:
    roll, pitch, _ = (float(angle) * RAD_DEG for angle in euler_from_quaternion(point.state.quaternion))
    mach = speed_m_s / float(standard_environment().atmosphere.at(altitude_m).speed_of_sound)
    thrust = float(airframe.propulsion(point.power, altitude_m, mach).force_b[0])
    elevator, aileron, rudder = (float(angle) * RAD_DEG for angle in point.state.surfaces)
    rates = tuple(float(rate) * RAD_DEG for rate in point.state.rates_b)
    return (
        ("angle of attack", float(point.alpha) * RAD_DEG, "deg"),
        ("sideslip", float(point.beta) * RAD_DEG, "deg"),
        ("roll", roll, "deg"),
        ("pitch", pitch, "deg"),
        ("roll rate", rates[0], "deg/s"),
        ("pitch rate", rates[1], "deg/s"),
        ("yaw rate", rates[2], "deg/s"),
        ("elevator", elevator, "deg"),
        ("aileron", aileron, "deg"),
        ("rudder", rudder, "deg"),
        ("throttle", float(point.controls.throttle), "0 to 1"),
        ("engine power", float(point.power), "percent"),
        ("thrust", thrust / 1000, "kN"),
        ("Mach number", mach, ""),
    )


__all__ = ["FoundTrim", "find_trim"]
