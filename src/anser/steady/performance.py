"""Performance of an aircraft in steady flight.

Acceleration and deceleration along the path, airspeed range of level flight, greatest bank angle, load factor, climb
and sink rates with a reserve.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from anser.aircraft.air_data import air_data
from anser.aircraft.airframe import AbstractAirframe
from anser.aircraft.motion import AirDataAndForces
from anser.environment.environment import Environment
from anser.numerics.arrays import namespace
from anser.parts.planners import IdleDeceleration, Performance
from anser.shapes import Scalar, ScalarLike, Vector
from anser.spatial.wind_axes import air_direction_b
from anser.steady.trim import TrimMapPoint, trim_map_point, trim_target

_SPEED_RATIOS = np.array([0.55, 0.65, 0.75, 0.85, 1.0, 1.25])  # relative to the airspeed at the start
_PUSH_OVER = 0.75  # second load factor for the drag due to lift, besides 1
_NEWTON_STEPS = 6  # the lift curve is piecewise linear
ACCELERATION_FLOOR = 0.1
"""Acceleration and deceleration assumed for an aircraft that can reach less, m/s^2."""


def performance_at(
    airframe: AbstractAirframe, environment: Environment, condition: AirDataAndForces, surfaces: Vector
) -> Performance:
    """Compute the acceleration with full thrust and the deceleration with idle thrust from steady level flight, m/s^2.

    `condition` is the trimmed condition, `surfaces` (rad) are the control surfaces of the trim. The idle deceleration
    at other airspeeds and load factors, relative to the trim, is tabulated for the same surfaces: for the F-16 the
    error of drag less idle thrust is within 5 % and 0.06 m/s^2 (at load factors 0.5 to 1, from 0.6 to 1.25 times the
    airspeed of the trim; beyond, the last value holds).
    """
    data = condition.air_data
    level, pushed_over = _idle_decelerations(airframe, environment, condition, surfaces)
    deceleration = -path_acceleration(airframe, condition, 0.0)
    share = jnp.maximum(deceleration, ACCELERATION_FLOOR)
    by_lift = jnp.maximum(level - pushed_over, 0.0) / (1.0 - _PUSH_OVER**2)
    return Performance(
        deceleration=deceleration,
        acceleration=path_acceleration(airframe, condition, 100.0),
        idle=IdleDeceleration(speeds=jnp.asarray(_SPEED_RATIOS) * data.V, level=level / share, by_lift=by_lift / share),
    )


def path_acceleration(airframe: AbstractAirframe, condition: AirDataAndForces, power: ScalarLike) -> Scalar:
    """Compute (thrust - drag) / mass in the trimmed condition at a power (percent), m/s^2."""
    data = condition.air_data
    propulsive = airframe.engine.propulsion(power, data)
    force_b = condition.aerodynamic.force_b + propulsive.force_b
    return jnp.sum(air_direction_b(data.alpha, data.beta) * force_b) / airframe.mass_properties.mass


def _idle_decelerations(
    airframe: AbstractAirframe, environment: Environment, condition: AirDataAndForces, surfaces: Vector
) -> Float[Array, "2 entries"]:
    """Compute (drag - idle thrust) / mass, m/s^2, for load factors 1 and `_PUSH_OVER` (rows).

    The columns are the airspeeds `_SPEED_RATIOS` times the trimmed airspeed.
    """
    trimmed_flow = condition.air_data
    air = environment.atmosphere.at(trimmed_flow.altitude)
    low, high = airframe.alpha_range

    def deceleration_at(speed: Scalar, load_factor: Scalar) -> Scalar:
        def forces(alpha: Scalar) -> tuple[Scalar, Scalar]:
            """Return the force normal to the path (upwards) and along the path (backwards), both per mass, m/s^2."""
            velocity_b = speed * jnp.stack([jnp.cos(alpha), 0.0 * alpha, jnp.sin(alpha)])
            data = air_data(velocity_b, trimmed_flow.altitude, air)
            force_b = airframe.aerodynamics(data, jnp.zeros(3), surfaces).force_b
            force_b = (force_b + airframe.engine.propulsion(0.0, data).force_b) / airframe.mass_properties.mass
            across = force_b[0] * jnp.sin(alpha) - force_b[2] * jnp.cos(alpha)
            return across, -force_b[0] * jnp.cos(alpha) - force_b[2] * jnp.sin(alpha)

        def nearer(_: object, carry: tuple[Scalar, Scalar]) -> tuple[Scalar, Scalar]:
            """Return the next angle of attack, and the deceleration at the present one: one copy of the forces."""
            alpha = carry[0]
            (across, along), (slope, _) = jax.jvp(forces, (alpha,), (jnp.ones(()),))
            step = (across - load_factor * environment.gravity) / jnp.where(slope == 0.0, 1.0, slope)
            return jnp.clip(alpha - step, low, high), along

        return jax.lax.fori_loop(0, _NEWTON_STEPS + 1, nearer, (trimmed_flow.alpha, jnp.zeros(())))[1]

    load_factors, ratios = np.meshgrid([1.0, _PUSH_OVER], _SPEED_RATIOS, indexing="ij")
    speeds = jnp.asarray(ratios.ravel()) * trimmed_flow.V
    conditions = speeds, jnp.asarray(load_factors.ravel())
    return jax.lax.map(lambda row: deceleration_at(*row), conditions).reshape(load_factors.shape)


_SPEEDS = 64
_BANKS = np.radians(np.arange(5.0, 76.0, 5.0))
_SLOPES = np.radians(np.concatenate([np.arange(-20.0, 0.0, 2.0), np.arange(1.0, 41.0, 1.5)]))
RESERVE = 0.1
"""Fraction of the power, and of the travel of every surface to its stop, kept in reserve."""
ALPHA_RESERVE = np.radians(2.0)
"""Margin of the angle of attack to the end of the data, rad."""


class Capability(NamedTuple):
    """Limits of steady flight at one altitude in still air.

    The airspeeds (m/s) of level flight are NaN if level flight is impossible. Bank (rad) and load factor are the
    greatest of a level turn, climb and sink rates (m/s) the greatest at the chosen airspeed.
    """

    speed_min: float
    speed_max: float
    bank_max: float
    load_factor_max: float
    climb_rate_max: float
    sink_rate_max: float


def capability_points(
    airframe: AbstractAirframe,
    environment: Environment,
    altitude: ScalarLike,
    speed: ScalarLike,
    speeds: tuple[ScalarLike, ScalarLike],
) -> TrimMapPoint:
    """Trim the aircraft at the points from which `capability_from_points` finds its limits.

    The points are level flight at several airspeeds, then level turns, then climbs and descents; the last point is
    level flight at the airspeed `speed`.

    Turns and climbs have the airspeed `speed`, the level flights 64 airspeeds in equal logarithmic steps over the range
    `speeds` (m/s).
    """
    turn_rates = environment.gravity * jnp.tan(jnp.asarray(_BANKS)) / speed
    slopes = jnp.append(jnp.asarray(_SLOPES), 0.0)
    constant_speeds = jnp.full(_BANKS.size + slopes.size, speed)
    zeros = (jnp.zeros(_SPEEDS), jnp.zeros(_BANKS.size), jnp.zeros(slopes.size))
    targets = jax.vmap(trim_target, in_axes=(0, None, 0, None, 0))(
        jnp.concatenate([_speed_grid(*speeds), constant_speeds]),
        altitude,
        jnp.concatenate([*zeros[:2], slopes]),
        0.0,
        jnp.concatenate([zeros[0], turn_rates, zeros[2]]),
    )
    return jax.lax.map(lambda target: trim_map_point(airframe, environment, target), targets)


def capability_from_points(
    airframe: AbstractAirframe, points: TrimMapPoint, speed: float, speeds: tuple[float, float]
) -> Capability:
    """Find the performance limits among the points of `capability_points`.

    At a limit, the reserves `RESERVE` (power, surfaces) and `ALPHA_RESERVE` (angle of attack) remain. If level
    flight is possible in several airspeed ranges, the range around `speed` counts, or else the longest.
    """
    usable = np.asarray(points.trimmable) & _has_reserve(airframe, points)
    level, banked, sloped, _ = np.split(usable, np.cumsum([_SPEEDS, _BANKS.size, _SLOPES.size]))
    grid = np.asarray(_speed_grid(*speeds))
    bounds = _true_run(level, int(np.argmin(np.abs(np.log(grid / speed)))))
    turning = int(np.argmin([*banked, False]))
    climbs = np.where(sloped, speed * np.sin(_SLOPES), 0.0)
    factors = np.asarray(points.load_factor)[_SPEEDS : _SPEEDS + turning]
    return Capability(
        speed_min=np.nan if bounds is None else float(grid[bounds[0]]),
        speed_max=np.nan if bounds is None else float(grid[bounds[1]]),
        bank_max=float(_BANKS[turning - 1]) if turning else 0.0,
        load_factor_max=float(factors.max(initial=1.0)),
        climb_rate_max=float(climbs.max()),
        sink_rate_max=float(-climbs.min()),
    )


def _speed_grid(low: ScalarLike, high: ScalarLike) -> jax.Array:
    xp = namespace(low, high)
    return xp.exp(xp.linspace(xp.log(low), xp.log(high), _SPEEDS))


def _has_reserve(airframe: AbstractAirframe, points: TrimMapPoint) -> np.ndarray:
    """Flag the points at which power, surfaces and angle of attack have the required reserve."""
    commanded = np.flatnonzero(airframe.actuators.is_commanded)
    surface_margin = np.asarray(points.surface_margin)[:, commanded].min(axis=1)
    alpha_margin = float(airframe.alpha_range[1]) - np.asarray(points.trim.alpha)
    return (np.asarray(points.power_margin) >= RESERVE) & (surface_margin >= RESERVE) & (alpha_margin >= ALPHA_RESERVE)


def _true_run(flags: np.ndarray, preferred: int) -> tuple[int, int] | None:
    """Return first and last index of the run of true flags around index `preferred`, or else of the longest, if any."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(int), [0]])))
    runs = [(int(a), int(b) - 1) for a, b in zip(edges[::2], edges[1::2], strict=True)]
    matching_runs = [run for run in runs if run[0] <= preferred <= run[1]]
    return matching_runs[0] if matching_runs else max(runs, key=lambda run: run[1] - run[0], default=None)
