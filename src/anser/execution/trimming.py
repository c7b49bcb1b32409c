"""One trim point, for people: the numbers with their units, or what stops it."""

from dataclasses import dataclass

import jax.numpy as jnp

from anser.aircraft import AbstractAirframe, air_data
from anser.compiling import enable_compilation_cache
from anser.environment import standard_environment
from anser.execution.conditions import airframe_of, solve
from anser.simulation import TrimPoint, nearest_trims, trim_target, trim_violations
from anser.spatial import euler_from_quaternion
from anser.units import DEG_RAD, RAD_DEG

_ROUNDING = 1e-12
"""Values below this are rounding noise of a zero, such as the bank of straight flight."""


@dataclass(frozen=True, repr=False)
class FoundTrim:
    """A trim point; printed, it is its numbers, or what stops it.

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

    def __repr__(self) -> str:
        if self.diagnosis is not None:
            return f"no steady flight: {self.diagnosis}"
        widest = max(len(name) for name, _, _ in self.rows)
        lines = (f"  {name:<{widest}}  {value:12.6f} {unit}".rstrip() for name, value, unit in self.rows)
        return "\n".join(["steady flight", *lines])

    def _repr_html_(self) -> str:
        from anser.results import notebook_table

        if self.diagnosis is not None:
            return notebook_table("no steady flight", [], [self.diagnosis])
        cells = [{"quantity": name, "value": f"{value:.6f}", "unit": unit} for name, value, unit in self.rows]
        return notebook_table("steady flight", cells)


def trim(
    aircraft: str | AbstractAirframe,
    speed_m_s: float,
    altitude_m: float,
    path_angle_deg: float = 0.0,
    turn_rate_deg_s: float = 0.0,
    *,
    pitch_rate_deg_s: float = 0.0,
    variant: str = "textbook",
    x_cg_over_c: float | None = None,
) -> FoundTrim:
    """Trim an airframe in the standard atmosphere, in still air and standard gravity.

    Parameters
    ----------
    aircraft
        Name of an airframe of the library, or an airframe.
    speed_m_s, altitude_m
        True airspeed and geometric altitude.
    path_angle_deg, turn_rate_deg_s
        Climb angle and rate of the course, right positive.
    pitch_rate_deg_s
        Body pitch rate of a pull-up with wings level and no roll and yaw rate ([SL] section 3.6); not in a turn.
    variant, x_cg_over_c
        Of the library's airframe: see `load_airframe`.

    Raises
    ------
    ValueError
        No such airframe, a centre of gravity for one that is not the library's, or a pitch rate in a turn.
    """
    enable_compilation_cache()
    environment = standard_environment()
    airframe, _ = airframe_of(aircraft, variant, x_cg_over_c)
    turn_rate, pitch_rate = turn_rate_deg_s * DEG_RAD, pitch_rate_deg_s * DEG_RAD
    target = trim_target(speed_m_s, altitude_m, path_angle_deg * DEG_RAD, turn_rate=turn_rate, pitch_rate=pitch_rate)
    point = solve(airframe, environment, target)
    stopped = bool(trim_violations(airframe, environment, point))
    diagnosis = nearest_trims(airframe, environment, target).message() if stopped else None
    return FoundTrim(point, _rows(airframe, point, altitude_m, speed_m_s), diagnosis)


def _rows(
    airframe: AbstractAirframe, point: TrimPoint, altitude_m: float, speed_m_s: float
) -> tuple[tuple[str, float, str], ...]:
    roll, pitch, _ = euler_from_quaternion(point.state.quaternion)
    air = standard_environment().atmosphere.at(altitude_m)
    ca, sa, cb, sb = (f(x) for x in (point.alpha, point.beta) for f in (jnp.cos, jnp.sin))
    data = air_data(speed_m_s * jnp.stack([ca * cb, sb, sa * cb]), altitude_m, air)
    thrust = float(airframe.engine.propulsion(point.power, data).force_b[0])
    flow = {"angle of attack": point.alpha, "sideslip": point.beta, "roll": roll, "pitch": pitch}
    rates = zip(("roll rate", "pitch rate", "yaw rate"), point.state.rates_b, strict=True)
    surfaces = zip(airframe.actuators.names, point.state.surfaces, strict=True)
    rows = (
        *((name, float(angle) * RAD_DEG, "deg") for name, angle in flow.items()),
        *((name, float(rate) * RAD_DEG, "deg/s") for name, rate in rates),
        *((name, float(angle) * RAD_DEG, "deg") for name, angle in surfaces),
        ("throttle", float(point.controls.throttle), "0 to 1"),
        ("engine power", float(point.power), "percent"),
        ("thrust", thrust / 1000, "kN"),
        ("Mach number", float(data.mach), ""),
    )
    return tuple((name, 0.0 if abs(value) < _ROUNDING else value, unit) for name, value, unit in rows)
