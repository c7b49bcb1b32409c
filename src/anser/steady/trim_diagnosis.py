"""Reasons why a flight condition has no trim: the violated limits, and the nearest conditions with a trim."""

import dataclasses
import math
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool

from anser.aircraft.air_data import AirData, Validity
from anser.aircraft.air_data import is_outside as outside
from anser.aircraft.airframe import AbstractAirframe
from anser.aircraft.engines import NoEngine
from anser.aircraft.motion import air_data_and_forces
from anser.compiling.options import compiled
from anser.environment.environment import Environment
from anser.shapes import Flag, Vector3
from anser.steady.trim import LIMIT_TOLERANCE, TrimPoint, TrimTarget, solve_trim
from anser.units import RAD_DEG

Flags = Bool[Array, " targets"]

_CANDIDATES = 128
_SPEED_FACTOR = 8.0
_PATH_ANGLE_LIMIT = math.radians(80.0)
_TURN_RATE_LIMIT = math.radians(30.0)


@dataclasses.dataclass(frozen=True)
class NearestTrim:
    """Nearest flight condition with a trim, if one quantity of the target (speed, path angle or a rate) changes."""

    # changed field of the target: "speed", "path_angle", "turn_rate" or, in a pull-up by pitch rate, "pitch_rate"
    quantity: str
    # value of the target, and nearest trimmable value, SI (m/s, rad, rad/s)
    target_value: float
    value: float
    # dimensionless change: change of speed / target speed; change of path angle, rad; or change of turn or pitch rate
    # times target speed / gravity
    distance: float
    # the changed target and its trim
    target: TrimTarget
    point: TrimPoint
    is_in_gap: bool = False  # whether trimmable values lie on both sides of the target value

    def message(self) -> str:
        """Return a clause such as "the fastest turn is 3.2 deg/s", rounded to the side on which a trim exists."""
        clause = _gap_clause if self.is_in_gap else _CLAUSES[self.quantity]
        return clause(self.quantity, self.target_value, self.value)


@dataclasses.dataclass(frozen=True)
class TrimDiagnosis:
    """Result of `nearest_trims`: the target and its trim, the violated limits, and the nearest conditions with a trim.

    `violations` are the texts of `trim_violations`. `nearest` has at most one condition for each changed quantity,
    least `distance` first. Both are empty if the target has a trim.
    """

    target: TrimTarget
    point: TrimPoint
    violations: tuple[str, ...]
    nearest: tuple[NearestTrim, ...]
    is_glider: bool = False  # whether the aircraft has no engine

    def message(self) -> str:
        """Return lines of text: the condition, the violated limits, and the nearest conditions with a trim."""
        t = self.target
        condition = (
            f"{float(t.speed):.1f} m/s at {float(t.altitude):.0f} m, "
            f"path angle {float(t.path_angle) * RAD_DEG:.1f} deg, turn rate {float(t.turn_rate) * RAD_DEG:.1f} deg/s"
        )
        if float(t.path_rate) != 0.0:
            condition += f", path angle rate {float(t.path_rate) * RAD_DEG:.1f} deg/s"
        if float(t.pitch_rate) != 0.0:
            condition += f", pitch rate {float(t.pitch_rate) * RAD_DEG:.1f} deg/s"
        if not self.violations:
            return f"Steady flight exists: {condition}."
        lines = [f"No steady flight: {condition}.", *(f"- {violation}" for violation in self.violations)]
        if self.nearest:
            lines += ["All else unchanged:", *(f"- {trim.message()}" for trim in self.nearest)]
        elif self.is_glider:
            lines += [
                "Without an engine, steady flight at an airspeed exists at a single path angle, which this search does "
                "not find; the performance of the aircraft (performance()) tells its best glide."
            ]
        else:
            rate = _changed_rate(t).replace("_", " ")
            lines += [f"No change of speed, path angle or {rate} alone makes it possible."]
        return "\n".join(lines)


def trim_violations(airframe: AbstractAirframe, environment: Environment, point: TrimPoint) -> tuple[str, ...]:
    """Return a sentence (deg, percent) for each limit that a trim point violates; empty if it can be flown.

    If forces and moments are not balanced, the result is one sentence to say so.
    """
    if math.isinf(float(point.residual)):
        return ("a pitch rate (P = R = 0) together with a turn rate or a rate of the path angle defines no flight",)
    if not bool(point.converged):
        return (
            "the forces and moments cannot be balanced: the best attempt leaves "
            f"{float(point.residual):.2g} (g, or rad/s^2 about an axis)",
        )
    actuators = airframe.actuators
    checks = [
        ("angle of attack", point.alpha, *airframe.alpha_range, RAD_DEG, "deg", "known from"),
        ("sideslip", point.beta, *airframe.beta_range, RAD_DEG, "deg", "known from"),
        ("engine power", float(point.power) / 100, 0.0, 1.0, 100.0, "percent", "available"),
    ]
    travels = (np.asarray(array) for array in (point.state.surfaces, actuators.lower, actuators.upper))
    for name, *travel in zip(actuators.names, *travels, strict=True):
        checks.append((name, *travel, RAD_DEG, "deg", "moves from"))
    messages = []
    for name, *numbers, factor, unit, verb in checks:
        value, lower, upper = map(float, numbers)
        if not lower - LIMIT_TOLERANCE <= value <= upper + LIMIT_TOLERANCE:
            low, high = (round(limit * factor, 6) for limit in (lower, upper))
            messages.append(f"{name}: {_beyond(value * factor, low, high)} {unit}; {verb} {low:g} to {high:g}")
    is_outside, data = _outside_data(airframe, environment, point)
    if bool(is_outside):
        range_messages = _beyond_validity(airframe, data)
        message = f"altitude {float(data.altitude):.0f} m, Mach {float(data.mach):.2f}: outside the aircraft's data"
        messages.extend(range_messages or [message])
    return tuple(messages)


def _beyond_validity(airframe: AbstractAirframe, data: AirData) -> list[str]:
    """Return a sentence for each violated validity range (airspeed, altitude, Mach) of the aircraft file, if any."""
    validity: Validity | None = getattr(airframe, "validity", None)
    if validity is None:
        return []
    checks = (
        ("airspeed", data.V, validity.airspeed, " m/s"),
        ("altitude", data.altitude, validity.altitude, " m"),
        ("Mach", data.mach, validity.mach, ""),
    )
    return [
        f"{name} {float(value):.4g}{unit}: outside the aircraft's data, which hold from {float(bounds[0]):g} to "
        f"{float(bounds[1]):g}{unit}"
        for name, value, bounds, unit in checks
        if bool(outside(value, bounds))
    ]


def nearest_trims(
    airframe: AbstractAirframe, environment: Environment, target: TrimTarget, position_n: Vector3 | None = None
) -> TrimDiagnosis:
    """Diagnose a trim target: find the nearest trimmable conditions by changing speed, path angle or turn rate alone.

    In a pull-up by pitch rate, the pitch rate is changed instead of the turn rate. The resolution is 0.03 percent of
    the speed, 0.01 deg and 0.004 deg/s (coarser for a target above 20 deg/s). `position_n`: see `solve_trim`. Raises
    ValueError if the airspeed of the target is not above 0.
    """
    rate = _changed_rate(target)
    target_values = {name: float(getattr(target, name)) for name in ("speed", "path_angle", rate)}
    if not target_values["speed"] > 0.0:
        raise ValueError(f"target.speed: arrived {target_values['speed']:g} m/s; expected an airspeed above 0 m/s")
    gravity = float(environment.gravity)
    scale = {"speed": 1 / target_values["speed"], "path_angle": 1.0, rate: target_values["speed"] / gravity}
    rate_limit = max(_TURN_RATE_LIMIT, 1.5 * abs(target_values[rate]))
    grids = {
        "speed": target_values["speed"] * np.geomspace(1 / _SPEED_FACTOR, _SPEED_FACTOR, _CANDIDATES),
        "path_angle": np.linspace(-_PATH_ANGLE_LIMIT, _PATH_ANGLE_LIMIT, _CANDIDATES),
        rate: np.linspace(-rate_limit, rate_limit, _CANDIDATES),
    }
    position_n = jnp.zeros(3) if position_n is None else position_n
    points, usable = _solve_grids(airframe, environment, target, position_n, grids)
    target_trim = jax.tree.map(lambda leaf: leaf[-1], points)
    violations = trim_violations(airframe, environment, target_trim)
    if not violations:
        return TrimDiagnosis(target, target_trim, (), ())
    finer = {name: _refined_grid(grids[name], usable[name], target_values[name]) for name in grids}
    is_in_gap = {name: _is_in_gap(name, grids[name][usable[name]], target_values[name]) for name in grids}
    points, usable = _solve_grids(airframe, environment, target, position_n, finer)
    nearest = []
    for quantity_index, name in enumerate(grids):
        if not usable[name].any():
            continue
        distances = np.where(usable[name], np.abs(finer[name] - target_values[name]), np.inf)
        k = int(np.argmin(distances))
        nearest.append(
            NearestTrim(
                quantity=name,
                target_value=target_values[name],
                value=float(finer[name][k]),
                distance=float(distances[k]) * scale[name],
                target=dataclasses.replace(target, **{name: jnp.asarray(finer[name][k])}),
                point=jax.tree.map(lambda leaf, at=quantity_index * _CANDIDATES + k: leaf[at], points),
                is_in_gap=is_in_gap[name],
            )
        )
    nearest.sort(key=lambda trim: trim.distance)
    is_glider = isinstance(getattr(airframe, "engine", None), NoEngine)
    return TrimDiagnosis(target, target_trim, violations, tuple(nearest), is_glider)


def _changed_rate(target: TrimTarget) -> str:
    """Return the name of the rate that the diagnosis changes: "pitch_rate" if not 0, "turn_rate" otherwise."""
    return "turn_rate" if float(target.pitch_rate) == 0.0 else "pitch_rate"


@compiled
def _outside_data(airframe: AbstractAirframe, environment: Environment, point: TrimPoint) -> tuple[Flag, AirData]:
    """Return whether airspeed, altitude or Mach number is outside the data, and the point's air data."""
    data = air_data_and_forces(airframe, environment, 0.0, point.state).air_data
    alpha, beta = jnp.clip(data.alpha, *airframe.alpha_range), jnp.clip(data.beta, *airframe.beta_range)
    within = dataclasses.replace(data, alpha=alpha, beta=beta)
    return airframe.outside_tables(within), data


@compiled
def _solve_all(
    airframe: AbstractAirframe, environment: Environment, targets: TrimTarget, position_n: Vector3
) -> tuple[TrimPoint, Flags]:
    def trim_and_check(target: TrimTarget) -> tuple[TrimPoint, Flag]:
        point = solve_trim(airframe, environment, target, position_n)
        data = air_data_and_forces(airframe, environment, 0.0, point.state).air_data
        return point, point.converged & (point.excess <= LIMIT_TOLERANCE) & ~airframe.outside_tables(data)

    return jax.vmap(trim_and_check)(targets)


def _solve_grids(
    airframe: AbstractAirframe,
    environment: Environment,
    target: TrimTarget,
    position_n: Vector3,
    grids: dict[str, np.ndarray],
) -> tuple[TrimPoint, dict[str, np.ndarray]]:
    """Solve the trim for every value of every grid, which replaces one quantity of the target, and for the target.

    Return the trim points in this order, and for each quantity one flag per grid value: True if a trim exists.
    """
    count = len(grids) * _CANDIDATES
    fields = {f.name: np.full(count + 1, float(getattr(target, f.name))) for f in dataclasses.fields(target)}
    for quantity_index, (name, grid) in enumerate(grids.items()):
        fields[name][quantity_index * _CANDIDATES : (quantity_index + 1) * _CANDIDATES] = grid
    targets = TrimTarget(**{k: jnp.asarray(v) for k, v in fields.items()})
    points, usable = _solve_all(airframe, environment, targets, position_n)
    return points, dict(zip(grids, np.split(np.asarray(usable)[:count], len(grids)), strict=True))


def _refined_grid(grid: np.ndarray, usable: np.ndarray, target_value: float) -> np.ndarray:
    """Return a finer grid from the value with a trim nearest to the target to the next grid value towards the target.

    `usable` has the flags of the values with a trim; if none exists, the grid is returned unchanged.
    """
    if not usable.any():
        return grid
    nearest_usable = float(grid[int(np.argmin(np.where(usable, np.abs(grid - target_value), np.inf)))])
    between = grid[(grid - nearest_usable) * (target_value - nearest_usable) > 0]
    toward = float(between[np.argmin(np.abs(between - nearest_usable))]) if between.size else target_value
    end = toward if abs(toward - nearest_usable) < abs(target_value - nearest_usable) else target_value
    return np.linspace(nearest_usable, end, _CANDIDATES)


def _is_in_gap(quantity: str, usable_values: np.ndarray, target_value: float) -> bool:
    """Return whether trimmable values lie on both sides of the target value; rates count by magnitude."""
    if quantity == "pitch_rate":  # a push-over is no pull-up
        usable_values = usable_values[usable_values * target_value >= 0.0]
    if quantity in ("turn_rate", "pitch_rate"):
        usable_values, target_value = np.abs(usable_values), abs(target_value)
    return bool(np.any(usable_values < target_value) and np.any(usable_values > target_value))


def _beyond(value: float, lower: float, upper: float) -> str:
    """Format a value outside `lower` to `upper` with the fewest decimals (one or more) that read as outside."""
    for decimals in range(1, 9):
        text = f"{value:.{decimals}f}"
        if not lower <= float(text) <= upper:
            return text
    return f"{value!r}"


def _at_least(value: float) -> str:
    return f"{math.ceil(value * 10) / 10:.1f}"


def _at_most(value: float) -> str:
    return f"{math.floor(value * 10) / 10:.1f}"


def _speed_clause(_quantity: str, target_value: float, value: float) -> str:
    if value > target_value:
        return f"the slowest trimmable speed is {_at_least(value)} m/s"
    return f"the fastest trimmable speed is {_at_most(value)} m/s"


def _path_angle_clause(_quantity: str, target_value: float, value: float) -> str:
    angle = value * RAD_DEG
    if value < target_value:
        if value >= 0:
            return f"the steepest climb is {_at_most(angle)} deg"
        return f"it must descend at {_at_least(-angle)} deg or more"
    if value <= 0:
        return f"the steepest descent is {_at_most(-angle)} deg"
    return f"it must climb at {_at_least(angle)} deg or more"


def _turn_rate_clause(_quantity: str, target_value: float, value: float) -> str:
    rate = abs(value) * RAD_DEG
    if abs(value) < abs(target_value):
        return f"the fastest turn is {_at_most(rate)} deg/s"
    return f"it must turn at {_at_least(rate)} deg/s or more"


def _pitch_rate_clause(_quantity: str, target_value: float, value: float) -> str:
    rate, up = abs(value) * RAD_DEG, value > 0
    if abs(value) < abs(target_value) and value * target_value >= 0:
        return f"the fastest {'pull-up' if target_value > 0 else 'push-over'} is {_at_most(rate)} deg/s"
    return f"it must {'pull up' if up else 'push over'} at {_at_least(rate)} deg/s or more"


def _gap_clause(quantity: str, target_value: float, value: float) -> str:
    unit = {"speed": "m/s", "path_angle": "deg"}.get(quantity, "deg/s")
    value_in_unit = value if quantity == "speed" else value * RAD_DEG
    text = _at_least(value_in_unit) if value > target_value else _at_most(value_in_unit)
    return f"the nearest trimmable {quantity.replace('_', ' ')} is {text} {unit}"


_CLAUSES: dict[str, Callable[[str, float, float], str]] = {
    "speed": _speed_clause,
    "path_angle": _path_angle_clause,
    "turn_rate": _turn_rate_clause,
    "pitch_rate": _pitch_rate_clause,
}
