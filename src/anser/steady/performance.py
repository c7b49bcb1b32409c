"""Performance of an aircraft.

Acceleration and deceleration along its path, speed range of level flight, greatest bank, load factor, climb and sink
with a reserve.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from anser.aircraft.air_data import air_data
from anser.aircraft.airframe import AbstractAirframe
from anser.aircraft.motion import FlightCondition
from anser.environment.environment import Environment
from anser.parts.planners import IdleDeceleration, Performance
from anser.shapes import Scalar, ScalarLike, Vector
from anser.steady.trim import TrimMapPoint, trim_map_point, trim_target

_SPEED_RATIOS = np.array([0.55, 0.65, 0.75, 0.85, 1.0, 1.25])  # of that at the start
_PUSH_OVER = 0.75  # load factor at which the drag due to lift is looked at besides 1
_NEWTON_STEPS = 6  # the lift curve is piecewise linear
ACCELERATION_FLOOR = 0.1
"""Acceleration or deceleration that every aircraft is taken to have, m/s^2."""


def performance_at(
    airframe: AbstractAirframe, environment: Environment, now: FlightCondition, surfaces: Vector
) -> Performance:
    """What an aircraft can do from steady level flight, of which the condition and the surfaces (rad) are given.

    At other airspeeds and load factors the surfaces are left where they are: of the F-16, the drag less the idle
    thrust is within 3 % and 0.06 m/s^2 of that trimmed there (95 to 200 m/s, load factors 0.5 to 1).
    """
    data = now.air_data
    level, pushed_over = (
        _idle_decelerations(airframe, environment, now, surfaces, load_factor) for load_factor in (1.0, _PUSH_OVER)
    )
    deceleration = -_along_path(airframe, now, 0.0)
    share = jnp.maximum(deceleration, ACCELERATION_FLOOR)
    by_lift = jnp.maximum(level - pushed_over, 0.0) / (1.0 - _PUSH_OVER**2)
    return Performance(
        deceleration=deceleration,
        acceleration=_along_path(airframe, now, 100.0),
        idle=IdleDeceleration(speeds=jnp.asarray(_SPEED_RATIOS) * data.V, level=level / share, by_lift=by_lift / share),
    )


def _along_path(airframe: AbstractAirframe, now: FlightCondition, power: ScalarLike) -> Scalar:
    """Thrust at a power (percent) less drag, over mass, in the trimmed condition, m/s^2."""
    data = now.air_data
    pushed = airframe.engine.propulsion(power, data)
    direction_b = jnp.stack(
        [jnp.cos(data.alpha) * jnp.cos(data.beta), jnp.sin(data.beta), jnp.sin(data.alpha) * jnp.cos(data.beta)]
    )
    return jnp.sum(direction_b * (now.aerodynamic.force_b + pushed.force_b)) / airframe.mass_properties.mass


def _idle_decelerations(
    airframe: AbstractAirframe, environment: Environment, now: FlightCondition, surfaces: Vector, load_factor: float
) -> Float[Array, " entries"]:
    """Drag less idle thrust at each airspeed and at a load factor, over mass, m/s^2."""
    here = now.air_data
    air = environment.atmosphere.at(here.altitude)
    low, high = airframe.alpha_range

    def at_speed(speed: Scalar) -> Scalar:
        def forces(alpha: Scalar) -> tuple[Scalar, Scalar]:
            """Across the path, up, and against it, over mass, m/s^2."""
            data = air_data(speed * jnp.stack([jnp.cos(alpha), 0.0 * alpha, jnp.sin(alpha)]), here.altitude, air)
            force_b = airframe.aerodynamics(data, jnp.zeros(3), surfaces).force_b
            force_b = (force_b + airframe.engine.propulsion(0.0, data).force_b) / (airframe.mass_properties.mass)
            across = force_b[0] * jnp.sin(alpha) - force_b[2] * jnp.cos(alpha)
            return across, -force_b[0] * jnp.cos(alpha) - force_b[2] * jnp.sin(alpha)

        def nearer(_: object, alpha: Scalar) -> Scalar:
            (across, _), (slope, _) = jax.jvp(forces, (alpha,), (jnp.ones(()),))
            step = (across - load_factor * environment.gravity) / jnp.where(slope == 0.0, 1.0, slope)
            return jnp.clip(alpha - step, low, high)

        return forces(jax.lax.fori_loop(0, _NEWTON_STEPS, nearer, here.alpha))[1]

    return jax.vmap(at_speed)(jnp.asarray(_SPEED_RATIOS) * here.V)


_SPEEDS = 64
_BANKS = np.radians(np.arange(5.0, 76.0, 5.0))
_SLOPES = np.radians(np.concatenate([np.arange(-20.0, 0.0, 2.0), np.arange(1.0, 41.0, 1.5)]))
RESERVE = 0.1
"""Part of the power, and of the way of every surface to its stop, that must be left."""
ALPHA_RESERVE = np.radians(2.0)
"""Angle of attack that must be left to the end of the data, rad."""


class Capability(NamedTuple):
    """What an aircraft can fly steadily at an altitude, in still air, in SI units and rad.

    Attributes
    ----------
    speed_min, speed_max
        Of level flight, m/s; NaN where there is none.
    bank_max, load_factor_max
        Of a level turn at the airspeed asked about, rad.
    climb_rate_max, sink_rate_max
        At that airspeed, m/s.
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
    """Trim map from which `capability_from_points` reads: level flight, then level turns, then climbs and descents.

    Parameters
    ----------
    airframe, environment
        What, and in which air.
    altitude, speed
        Where (m), and at which airspeed turns and climbs are looked at (m/s).
    speeds
        Between which airspeeds level flight is looked for, m/s: 64 of them, equal steps of the logarithm.
    """
    turn_rates = environment.gravity * jnp.tan(jnp.asarray(_BANKS)) / speed
    same = jnp.full(_BANKS.size + _SLOPES.size, speed)
    nothing = (jnp.zeros(_SPEEDS), jnp.zeros(_BANKS.size), jnp.zeros(_SLOPES.size))
    targets = jax.vmap(trim_target, in_axes=(0, None, 0, None, 0))(
        jnp.concatenate([_speed_grid(*speeds), same]),
        altitude,
        jnp.concatenate([*nothing[:2], jnp.asarray(_SLOPES)]),
        0.0,
        jnp.concatenate([nothing[0], turn_rates, nothing[2]]),
    )
    return jax.vmap(lambda target: trim_map_point(airframe, environment, target))(targets)


def capability_from_points(
    airframe: AbstractAirframe, points: TrimMapPoint, speed: float, speeds: tuple[float, float]
) -> Capability:
    """What the points of `capability_points` come to, with a tenth of power and surfaces and 2 deg of alpha left.

    Of several ranges of airspeeds of level flight the one around `speed` counts, or the longest.
    """
    usable = np.asarray(points.trimmable) & _with_reserve(airframe, points)
    level, banked, sloped = np.split(usable, np.cumsum([_SPEEDS, _BANKS.size]))
    grid = np.asarray(_speed_grid(*speeds))
    ends = _range(level, int(np.argmin(np.abs(np.log(grid / speed)))))
    turning = int(np.argmin([*banked, False]))
    climbs = np.where(sloped, speed * np.sin(_SLOPES), 0.0)
    factors = np.asarray(points.load_factor)[_SPEEDS : _SPEEDS + turning]
    return Capability(
        speed_min=np.nan if ends is None else float(grid[ends[0]]),
        speed_max=np.nan if ends is None else float(grid[ends[1]]),
        bank_max=float(_BANKS[turning - 1]) if turning else 0.0,
        load_factor_max=float(factors.max(initial=1.0)),
        climb_rate_max=float(climbs.max()),
        sink_rate_max=float(-climbs.min()),
    )


def _speed_grid(low: ScalarLike, high: ScalarLike) -> jax.Array:
    return jnp.exp(jnp.linspace(jnp.log(low), jnp.log(high), _SPEEDS))


def _with_reserve(airframe: AbstractAirframe, points: TrimMapPoint) -> np.ndarray:
    """Whether something is left of power, surfaces and angle of attack."""
    commanded = np.flatnonzero(airframe.actuators.is_commanded)
    left = np.asarray(points.surface_margin)[:, commanded].min(axis=1)
    alpha_left = float(airframe.alpha_range[1]) - np.asarray(points.trim.alpha)
    return (np.asarray(points.power_margin) >= RESERVE) & (left >= RESERVE) & (alpha_left >= ALPHA_RESERVE)


def _range(flags: np.ndarray, near: int) -> tuple[int, int] | None:
    """First and last of the neighbours that are all true: around `near`, or the longest; None: there are none."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(int), [0]])))
    runs = [(int(a), int(b) - 1) for a, b in zip(edges[::2], edges[1::2], strict=True)]
    around = [run for run in runs if run[0] <= near <= run[1]]
    return around[0] if around else max(runs, key=lambda run: run[1] - run[0], default=None)
