"""Performance of an aircraft in steady flight: accelerations along the path, and limits of flight with a reserve."""

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
_PUSH_OVER = 0.75  # load factor that, with load factor 1, gives the drag due to lift
_NEWTON_STEPS = 6  # enough for a piecewise linear lift curve
ACCELERATION_FLOOR = 0.1
"""Least acceleration and deceleration that plans assume for an aircraft, m/s^2, even if the aircraft reaches less."""


def performance_at(
    airframe: AbstractAirframe, environment: Environment, condition: AirDataAndForces, surfaces: Vector
) -> Performance:
    """Compute the acceleration with full thrust and the deceleration with idle thrust of a trimmed aircraft, m/s^2.

    `condition` and `surfaces` (rad) are the trimmed condition and its deflections. The result also has two tables of
    the idle deceleration over airspeed, for 0.55 to 1.25 times the trimmed airspeed: the value in level flight, and the
    part proportional to the square of the load factor. The tables have ratios to the trimmed idle deceleration (at
    least `ACCELERATION_FLOOR`). For the F-16, the error of the tables is within 5 % and 0.06 m/s^2 at load factors of
    0.5 to 1 and airspeeds of 0.6 to 1.25 times the trimmed airspeed.
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
    """Compute (thrust - drag) / mass, m/s^2, for the air data of `condition` and an engine power in percent."""
    data = condition.air_data
    propulsive = airframe.engine.propulsion(power, data)
    force_b = condition.aerodynamic.force_b + propulsive.force_b
    return jnp.sum(air_direction_b(data.alpha, data.beta) * force_b) / airframe.mass_properties.mass


def _idle_decelerations(
    airframe: AbstractAirframe, environment: Environment, condition: AirDataAndForces, surfaces: Vector
) -> Float[Array, "2 entries"]:
    """Compute (drag - idle thrust) / mass, m/s^2, at load factors 1 and `_PUSH_OVER` (rows) and `_SPEED_RATIOS`."""
    trimmed_flow = condition.air_data
    air = environment.atmosphere.at(trimmed_flow.altitude)
    low, high = airframe.alpha_range

    def deceleration_at(speed: Scalar, load_factor: Scalar) -> Scalar:
        def forces(alpha: Scalar) -> tuple[Scalar, Scalar]:
            """Return acceleration normal to the path (up) and deceleration along it, both without gravity, m/s^2."""
            velocity_b = speed * jnp.stack([jnp.cos(alpha), 0.0 * alpha, jnp.sin(alpha)])
            data = air_data(velocity_b, trimmed_flow.altitude, air)
            force_b = airframe.aerodynamics(data, jnp.zeros(3), surfaces).force_b
            force_b = (force_b + airframe.engine.propulsion(0.0, data).force_b) / airframe.mass_properties.mass
            across = force_b[0] * jnp.sin(alpha) - force_b[2] * jnp.cos(alpha)
            return across, -force_b[0] * jnp.cos(alpha) - force_b[2] * jnp.sin(alpha)

        def nearer(_: object, carry: tuple[Scalar, Scalar]) -> tuple[Scalar, Scalar]:
            """Return the angle of attack (rad) after a Newton step, and the deceleration (m/s^2) before the step."""
            # both in one loop body: the compiled program contains the forces once
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
"""Fraction of full power, and of every surface's travel from mid-range to its stop, that a limit leaves unused."""
ALPHA_RESERVE = np.radians(2.0)
"""Margin of the angle of attack to the greatest angle of attack of the aerodynamic data, rad."""


class Capability(NamedTuple):
    """Limits of steady flight at one altitude in still air.

    The airspeeds of level flight (m/s) are NaN if level flight is impossible. Greatest bank (rad) and load factor of a
    level turn, and greatest climb and sink rates (m/s, positive) hold at one chosen airspeed. If no turn, climb or
    descent keeps the reserves, the values are 0 and the load factor is 1.
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
    """Trim the aircraft at the flight conditions from which `capability_from_points` finds the performance limits.

    The leading axis of the result has level flights at 64 airspeeds within `speeds` (m/s), then, all at the airspeed
    `speed` (m/s), level turns, descents and climbs, and one level flight. `altitude` (m) is geometric.
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
    """Find the performance limits among the `points` of `capability_points`, with the same `speed` and `speeds` (m/s).

    A point counts if it is trimmable and the reserves `RESERVE` (power, surfaces) and `ALPHA_RESERVE` (angle of attack)
    remain. If level flight has several airspeed ranges, the range around `speed` counts or, if there is none, the
    longest.
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
    """Return for each point whether power, surfaces and angle of attack keep their reserves."""
    commanded = np.flatnonzero(airframe.actuators.is_commanded)
    surface_margin = np.asarray(points.surface_margin)[:, commanded].min(axis=1)
    alpha_margin = float(airframe.alpha_range[1]) - np.asarray(points.trim.alpha)
    return (np.asarray(points.power_margin) >= RESERVE) & (surface_margin >= RESERVE) & (alpha_margin >= ALPHA_RESERVE)


def _true_run(flags: np.ndarray, preferred: int) -> tuple[int, int] | None:
    """Return first and last index of the run of true flags at index `preferred`, else of the longest; None: no run."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(int), [0]])))
    runs = [(int(a), int(b) - 1) for a, b in zip(edges[::2], edges[1::2], strict=True)]
    matching_runs = [run for run in runs if run[0] <= preferred <= run[1]]
    return matching_runs[0] if matching_runs else max(runs, key=lambda run: run[1] - run[0], default=None)
