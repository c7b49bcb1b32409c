"""What an aircraft can do by its trim map: airspeeds of level flight, greatest bank and climb with something left."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from anser.aircraft import AbstractAirframe
from anser.environment import Environment
from anser.shapes import ScalarLike
from anser.simulation.survey_trim import MapPoint, map_point
from anser.simulation.trim import trim_target

_SPEEDS = 64
_BANKS = np.radians(np.arange(5.0, 76.0, 5.0))
_SLOPES = np.radians(np.concatenate([np.arange(-20.0, 0.0, 2.0), np.arange(1.0, 41.0, 1.5)]))
RESERVE = 0.1
"""Part of the power, and of the way of every surface to its stop, that must be left."""
ALPHA_LEFT = np.radians(2.0)
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
) -> MapPoint:
    """Trim map from which `capability_of` reads: level flight, then level turns, then climbs and descents.

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
    return jax.vmap(lambda target: map_point(airframe, environment, target))(targets)


def capability_of(
    airframe: AbstractAirframe, points: MapPoint, speed: float, speeds: tuple[float, float]
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


def _with_reserve(airframe: AbstractAirframe, points: MapPoint) -> np.ndarray:
    """Whether something is left of power, surfaces and angle of attack."""
    commanded = np.flatnonzero(airframe.actuators.commanded)
    left = np.asarray(points.surface_left)[:, commanded].min(axis=1)
    alpha_left = float(airframe.alpha_range[1]) - np.asarray(points.trim.alpha)
    return (np.asarray(points.power_left) >= RESERVE) & (left >= RESERVE) & (alpha_left >= ALPHA_LEFT)


def _range(flags: np.ndarray, near: int) -> tuple[int, int] | None:
    """First and last of the neighbours that are all true: around `near`, or the longest; None: there are none."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(int), [0]])))
    runs = [(int(a), int(b) - 1) for a, b in zip(edges[::2], edges[1::2], strict=True)]
    around = [run for run in runs if run[0] <= near <= run[1]]
    return around[0] if around else max(runs, key=lambda run: run[1] - run[0], default=None)
