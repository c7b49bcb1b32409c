"""Start of a flight of one aircraft, from a trim or from named variables; names of start variables and inputs."""

from collections.abc import Mapping
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from anser.aircraft.air_data import air_data
from anser.aircraft.airframe import AbstractAirframe, AircraftState, Controls
from anser.analysis.trim_points import ConditionError, TrimResult, airframe_hash, flight_point
from anser.compiling.options import compiled_quickly
from anser.environment.atmosphere import AbstractAtmosphere
from anser.environment.environment import Environment
from anser.numerics.arrays import as_array
from anser.parts.paths import polar
from anser.shapes import Vector
from anser.simulation.open_loop import dataset_variables, start_point
from anser.spatial.rotations import quaternion_from_euler, rotate, rotate_back, rotation_from_quaternion
from anser.spatial.wind_axes import air_direction_b
from anser.steady.trim import TrimPoint
from anser.units import DEG_RAD, RAD_DEG

_REQUIRED = ("airspeed_m_s", "altitude_m")
_OTHER_AIRSPEEDS = ("airspeed_calibrated_m_s", "airspeed_equivalent_m_s", "mach")
_OPTIONAL = (
    *("north_m", "east_m", "alpha_deg", "beta_deg", "roll_deg", "pitch_deg", "yaw_deg"),
    *("roll_rate_deg_s", "pitch_rate_deg_s", "yaw_rate_deg_s"),
)


def start_names(airframe: AbstractAirframe) -> tuple[str, ...]:
    """Return the names, with units, of the variables that define the start of a flight, such as `airspeed_m_s`.

    `airspeed_m_s` (true) and `altitude_m` are required; all further variables, throttle and deflections included, are 0
    if absent. `airspeed_calibrated_m_s`, `airspeed_equivalent_m_s` or `mach` may replace the true airspeed.
    """
    return (*_REQUIRED, *_OPTIONAL, *(f"{name}_deg" for name in airframe.actuators.names), "throttle")


def input_names(airframe: AbstractAirframe) -> tuple[str, ...]:
    """Return the names of the inputs: the surfaces (deg), then `throttle` (0 to 1)."""
    return (*airframe.actuators.names, "throttle")


def resolve_start(airframe: AbstractAirframe, environment: Environment, start: Any) -> TrimPoint:
    """Return the start of a flight, state and controls, as a trim point (steady or not).

    `start` is the result of a trim, a `TrimPoint` in still air, or a mapping with the names of `start_names`. The
    environment's wind is added to the velocity over ground; the airspeed is unchanged.

    Raises ConditionError if the trim has no steady flight. Raises ValueError if the trim is of a different aircraft or
    atmosphere, if a name is unknown or missing, or if a value is out of range.
    """
    if isinstance(start, TrimResult):
        if start.diagnosis is not None:
            raise ConditionError(f"start: no steady flight: {start.diagnosis}")
        require_trim_of(airframe, start, "start")
        if not _same_air(start.atmosphere, environment.atmosphere):
            raise ValueError(
                "start: arrived a trim in another atmosphere than the flight's; expected one with the same, such as "
                "aircraft.trim(..., atmosphere=...)"
            )
        start = _without_wind(start)
    if isinstance(start, TrimPoint):
        return _in_wind(environment, start)
    if not isinstance(start, Mapping):
        raise ValueError(
            f"start: arrived {type(start).__name__}; expected a trim, such as aircraft.trim(speed_m_s=150, "
            f"altitude_m=1000), or a mapping of {', '.join(start_names(airframe))}"
        )
    start = _with_true_airspeed(environment, start)
    names = start_names(airframe)
    unknown = [name for name in start if name not in names]
    if unknown:
        raise ValueError(f"start: arrived {unknown[0]!r}; expected names among {', '.join(names)}")
    missing = [name for name in _REQUIRED if name not in start]
    if missing:
        raise ValueError(f"start: {missing[0]} is missing; expected at least {' and '.join(_REQUIRED)}")
    values = np.array([_number(name, start.get(name, 0.0)) for name in names])
    if values[0] <= 0.0:
        raise ValueError(f"start: arrived airspeed_m_s {values[0]:g}; expected a positive airspeed")
    lower, upper = (np.degrees(np.asarray(ends)) for ends in (airframe.actuators.lower, airframe.actuators.upper))
    for name, value, low, high in zip(airframe.actuators.names, values[12:-1], lower, upper, strict=True):
        if not low - 1e-6 <= value <= high + 1e-6:
            raise ValueError(f"start: arrived {name}_deg {value:g}; expected {low:g} to {high:g}, the stops")
    if not 0.0 <= values[-1] <= 1.0:
        raise ValueError(f"start: arrived throttle {values[-1]:g}; expected 0 to 1 (not percent)")
    return _named_start(airframe, environment, as_array(values))


def _without_wind(trim: TrimResult) -> TrimPoint:
    """Return the trim point with its velocity over the ground in still air."""
    if "speed_m_s" not in trim.condition:
        return trim.point
    velocity_b = trim.condition["speed_m_s"] * air_direction_b(trim.point.alpha, trim.point.beta)
    return eqx.tree_at(lambda point: point.state.velocity_b, trim.point, velocity_b)


def require_trim_of(airframe: AbstractAirframe, trim: TrimResult, argument: str) -> None:
    """Raise ValueError if the aircraft of `trim` has another mass or hash; `argument` names `trim` in the message."""
    mass_kg = float(airframe.mass_properties.mass)
    if trim.mass_kg != mass_kg:
        raise ValueError(
            f"{argument}: arrived a trim of an aircraft of {trim.mass_kg:g} kg; expected one of this aircraft, of "
            f"{mass_kg:g} kg"
        )
    if trim.airframe_hash not in ("", airframe_hash(airframe)):
        raise ValueError(
            f"{argument}: arrived a trim of another aircraft of the same mass; expected one of this aircraft, with its "
            "variant and centre of gravity"
        )


def _same_air(trimmed: AbstractAtmosphere, flown: AbstractAtmosphere) -> bool:
    if type(trimmed) is not type(flown):
        return False
    leaves = (jax.tree.leaves(atmosphere) for atmosphere in (trimmed, flown))
    return all(np.array_equal(a, b) for a, b in zip(*leaves, strict=True))


def _with_true_airspeed(environment: Environment, start: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return a start with the true airspeed in place of another form; raise ValueError if two airspeeds are given."""
    others = [name for name in _OTHER_AIRSPEEDS if name in start]
    if not others or "altitude_m" not in start:
        return start
    if len(others) > 1 or "airspeed_m_s" in start:
        arrived = " and ".join(name for name in ("airspeed_m_s", *_OTHER_AIRSPEEDS) if name in start)
        raise ValueError(f"start: arrived {arrived}; expected one of airspeed_m_s, {', '.join(_OTHER_AIRSPEEDS)}")
    airspeeds = [_number(name, start[name]) if name in start else None for name in _OTHER_AIRSPEEDS]
    airspeed_m_s, _ = flight_point(environment, _number("altitude_m", start["altitude_m"]), None, *airspeeds)
    return {"airspeed_m_s": airspeed_m_s} | {name: value for name, value in start.items() if name != others[0]}


def _number(name: str, value: Any) -> float:
    if np.ndim(value) or isinstance(value, str) or value is None or not np.isfinite(float(value)):
        raise ValueError(f"start: arrived {value!r:.40} as {name}; expected a finite number")
    return float(value)


@compiled_quickly
def _named_start(airframe: AbstractAirframe, environment: Environment, values: Vector) -> TrimPoint:
    V, altitude, north, east = values[:4]
    alpha, beta, *euler = values[4:9] * DEG_RAD
    rates_b = values[9:12] * DEG_RAD
    surfaces, throttle = values[12:-1] * DEG_RAD, values[-1]
    quaternion = quaternion_from_euler(*euler)
    velocity_air_b = V * air_direction_b(alpha, beta)
    position_n = jnp.stack([north, east, -altitude])
    wind_b = rotate(rotation_from_quaternion(quaternion), environment.wind.at(position_n, 0.0))
    flow = air_data(velocity_air_b, altitude, environment.atmosphere.at(altitude))
    actuators = airframe.actuators.steady_state_in_flow(surfaces, flow)
    engine = airframe.engine.steady_state(airframe.engine.steady_power(throttle))
    state = AircraftState(position_n, velocity_air_b + wind_b, quaternion, rates_b, actuators, engine)
    return start_point(airframe, environment, state, Controls(surfaces, throttle))


@compiled_quickly
def _in_wind(environment: Environment, trim: TrimPoint) -> TrimPoint:
    """Return a trim in still air as a trim in the environment's wind, with the same airspeed."""
    state = trim.state
    wind_n = environment.wind.at(state.position_n, 0.0)
    velocity_b = state.velocity_b + rotate(rotation_from_quaternion(state.quaternion), wind_n)
    return eqx.tree_at(lambda point: point.state.velocity_b, trim, velocity_b)


def reference_inputs(airframe: AbstractAirframe, controls: Controls) -> dict[str, float]:
    """Return the values of controls by the names of the inputs: surfaces in deg, throttle 0 to 1."""
    deflections = np.asarray(controls.surfaces) * RAD_DEG
    return dict(zip(input_names(airframe), [*map(float, deflections), float(controls.throttle)], strict=True))


@compiled_quickly
def _variables(airframe: AbstractAirframe, environment: Environment, point: TrimPoint) -> dict[str, Any]:
    return dataset_variables(airframe, environment, 0.0, point.state, point.controls)


def named_state(airframe: AbstractAirframe, environment: Environment, point: TrimPoint) -> dict[str, float]:
    """Return a start `point` by the names of `start_names`; `resolve_start` converts the result to the same start."""
    variables = {name: float(value) for name, value in _variables(airframe, environment, point).items()}
    return {name: variables[name] for name in start_names(airframe)}


def air_path(environment: Environment, point: TrimPoint) -> dict[str, float]:
    """Return `airspeed_m_s`, `path_angle_deg` and `course_deg` of a start, relative to the air."""
    V, gamma, chi = (float(value) for value in _air_path(environment, point.state))
    return {"airspeed_m_s": V, "path_angle_deg": gamma * RAD_DEG, "course_deg": chi * RAD_DEG}


@compiled_quickly
def _air_path(environment: Environment, state: AircraftState) -> tuple[Any, Any, Any]:
    velocity_n = rotate_back(rotation_from_quaternion(state.quaternion), state.velocity_b)
    path = polar(velocity_n - environment.wind.at(state.position_n, 0.0), jnp.zeros(3))
    return path.V, path.gamma, path.chi
