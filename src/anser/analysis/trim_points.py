"""Trim points for users, with units or a diagnosis, and the common start of every analysis.

Airframe, autopilot gains, steady flight.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import equinox as eqx
import jax
import jax.numpy as jnp

from anser.aircraft.air_data import air_data
from anser.aircraft.airframe import AbstractAirframe, refuse_impossible_body
from anser.aircraft.f16 import AbstractF16
from anser.aircraft.motion import flight_condition
from anser.aircraft_files.library import load_airframe
from anser.aircraft_files.sources import VARIANTS
from anser.compiling.options import compiled, enable_compilation_cache
from anser.control.gains import AutopilotGains, Bandwidths, automatic_gains, derived_bandwidths, published_gains
from anser.environment.environment import Environment, standard_environment
from anser.scenario.schema_aircraft import Gains
from anser.shapes import Scalar
from anser.spatial.rotations import euler_from_quaternion
from anser.steady.trim import TrimMapPoint, TrimPoint, TrimTarget, solve_trim, trim_map_point, trim_target
from anser.steady.trim_diagnosis import nearest_trims, trim_violations
from anser.units import DEG_RAD, RAD_DEG
from anser.variables import surface_label

Inversion = Literal["model", "incremental"]

compiled_trim = compiled(solve_trim)


class ConditionError(ValueError):
    """A condition that cannot be flown steadily, held by the loop or described by Euler angles; the text is final."""


def resolve_airframe(
    aircraft: str | AbstractAirframe, variant: str = "textbook", x_cg_over_c: float | None = None
) -> tuple[AbstractAirframe, dict[str, str | int | float]]:
    """Airframe by its name or file, or the caller's own as it is; and attributes that say which.

    Parameters
    ----------
    aircraft
        Name of an airframe of the library or of an entry point, path of an aircraft file, or an airframe.
    variant, x_cg_over_c
        Of the library's F-16: see `load_f16`.

    Raises
    ------
    ValueError
        No such airframe; a centre of gravity for an airframe that is not the library's F-16; or an airframe of
        an impossible body.
    ScenarioError
        No valid aircraft file.
    """
    if isinstance(aircraft, str):
        of: dict[str, str | int | float] = {"aircraft": aircraft}
        return load_airframe(aircraft, variant, x_cg_over_c), of | (
            {"variant": variant} if aircraft in VARIANTS else {}
        )
    if x_cg_over_c is not None:
        raise ValueError(
            f"x_cg_over_c: arrived {x_cg_over_c} with an airframe of your own; expected None, "
            "and the airframe built with the centre of gravity that it is to have"
        )
    refuse_impossible_body(aircraft, type(aircraft).__name__)
    return aircraft, {"aircraft": "custom"}


def airframe_label(attributes: Mapping[str, Any]) -> str:
    """Airframe as attributes of `resolve_airframe` name it, with its variant where it has one."""
    return " ".join(
        [str(attributes["aircraft"]), *(f"({attributes[key]})" for key in ("variant",) if key in attributes)]
    )


def gains_for(inversion: Inversion, gains: AutopilotGains | None = None) -> AutopilotGains:
    """Gains of the autopilot, the published ones if none are given, with the bandwidth of the sensors' filter set."""
    bandwidth = Gains().sensor_bandwidth_rad_s if inversion == "incremental" else 0.0
    wanted = published_gains() if gains is None else gains
    return eqx.tree_at(lambda g: g.sensor_bandwidth, wanted, jnp.asarray(bandwidth, dtype=float))


def default_gains(
    airframe: AbstractAirframe, environment: Environment, trim: TrimPoint, step_s: float, inversion: Inversion
) -> AutopilotGains:
    """Gains where none are given: the published ones of an F-16, those of the aircraft itself of any other."""
    if isinstance(airframe, AbstractF16):
        return gains_for(inversion)
    bandwidths = _bandwidths(airframe, environment, trim, jnp.asarray(step_s, dtype=float))
    return gains_for(inversion, automatic_gains(bandwidths))


@compiled
def _bandwidths(airframe: AbstractAirframe, environment: Environment, trim: TrimPoint, step: Scalar) -> Bandwidths:
    now = flight_condition(airframe, environment, 0.0, trim.state)
    return derived_bandwidths(airframe, now, trim.state.surfaces, trim.power, step)


def steady_trim(airframe: AbstractAirframe, environment: Environment, target: TrimTarget) -> TrimPoint:
    """Trim point of a steady flight; ConditionError with the nearest trim points where there is none."""
    trim = compiled_trim(airframe, environment, target)
    if trim_violations(airframe, environment, trim):
        raise ConditionError(nearest_trims(airframe, environment, target).message())
    return trim


@compiled
def map_points(airframe: AbstractAirframe, environment: Environment, targets: TrimTarget) -> TrimMapPoint:
    """Points of the trim map at stacked targets."""
    return jax.vmap(lambda target: trim_map_point(airframe, environment, target))(targets)


_HEAVY_KG = 1000.0
"""Thrust of aircraft of more mass is told in kN."""
_ROUNDING = 1e-12
"""Values below this are rounding noise of a zero, such as the bank of straight flight."""


@dataclass(frozen=True, repr=False)
class TrimResult:
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
    quantities: tuple[tuple[str, float, str], ...]
    diagnosis: str | None

    def __repr__(self) -> str:
        if self.diagnosis is not None:
            return f"no steady flight: {self.diagnosis}"
        widest = max(len(name) for name, _, _ in self.quantities)
        lines = (f"  {name:<{widest}}  {value:12.6f} {unit}".rstrip() for name, value, unit in self.quantities)
        return "\n".join(["steady flight", *lines])

    def _repr_html_(self) -> str:
        from anser.results.documents import notebook_table

        if self.diagnosis is not None:
            return notebook_table("no steady flight", [], [self.diagnosis])
        cells = [{"quantity": name, "value": f"{value:.6f}", "unit": unit} for name, value, unit in self.quantities]
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
) -> TrimResult:
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
    airframe, _ = resolve_airframe(aircraft, variant, x_cg_over_c)
    turn_rate, pitch_rate = turn_rate_deg_s * DEG_RAD, pitch_rate_deg_s * DEG_RAD
    target = trim_target(speed_m_s, altitude_m, path_angle_deg * DEG_RAD, turn_rate=turn_rate, pitch_rate=pitch_rate)
    point = compiled_trim(airframe, environment, target)
    stopped = bool(trim_violations(airframe, environment, point))
    diagnosis = nearest_trims(airframe, environment, target).message() if stopped else None
    return TrimResult(point, _rows(airframe, point, altitude_m, speed_m_s), diagnosis)


def _rows(
    airframe: AbstractAirframe, point: TrimPoint, altitude_m: float, speed_m_s: float
) -> tuple[tuple[str, float, str], ...]:
    roll, pitch, _ = euler_from_quaternion(point.state.quaternion)
    air = standard_environment().atmosphere.at(altitude_m)
    ca, sa, cb, sb = (f(x) for x in (point.alpha, point.beta) for f in (jnp.cos, jnp.sin))
    data = air_data(speed_m_s * jnp.stack([ca * cb, sb, sa * cb]), altitude_m, air)
    thrust = float(airframe.engine.propulsion(point.power, data).force_b[0])
    heavy = float(airframe.mass_properties.mass) > _HEAVY_KG
    flow = {"angle of attack": point.alpha, "sideslip": point.beta, "roll": roll, "pitch": pitch}
    rates = zip(("roll rate", "pitch rate", "yaw rate"), point.state.rates_b, strict=True)
    surfaces = zip(airframe.actuators.names, point.state.surfaces, strict=True)
    rows = (
        *((name, float(angle) * RAD_DEG, "deg") for name, angle in flow.items()),
        *((name, float(rate) * RAD_DEG, "deg/s") for name, rate in rates),
        *((surface_label(name), float(angle) * RAD_DEG, "deg") for name, angle in surfaces),
        ("throttle", float(point.controls.throttle), "0 to 1"),
        ("engine power", float(point.power), "percent"),
        ("thrust", thrust / 1000, "kN") if heavy else ("thrust", thrust, "N"),
        ("Mach number", float(data.mach), ""),
    )
    return tuple((name, 0.0 if abs(value) < _ROUNDING else value, unit) for name, value, unit in rows)
