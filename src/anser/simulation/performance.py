"""What an aircraft can do along its path: with all its thrust, and with its engine idle at any airspeed."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from anser.aircraft import AbstractAirframe, Condition, air_data
from anser.environment import Environment
from anser.planning import IdleDeceleration, Performance
from anser.shapes import Scalar, ScalarLike, Vector

_SPEEDS = np.array([0.55, 0.65, 0.75, 0.85, 1.0, 1.25])  # of that at the start
_PUSH_OVER = 0.75  # load factor at which the drag due to lift is looked at besides 1
_NEWTON_STEPS = 6  # the lift curve is piecewise linear
ABLE_LEAST = 0.1
"""Acceleration or deceleration that every aircraft is taken to have, m/s^2."""


def performance_at(
    airframe: AbstractAirframe, environment: Environment, now: Condition, surfaces: Vector
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
    share = jnp.maximum(deceleration, ABLE_LEAST)
    by_lift = jnp.maximum(level - pushed_over, 0.0) / (1.0 - _PUSH_OVER**2)
    return Performance(
        deceleration=deceleration,
        acceleration=_along_path(airframe, now, 100.0),
        idle=IdleDeceleration(speeds=jnp.asarray(_SPEEDS) * data.V, level=level / share, by_lift=by_lift / share),
    )


def _along_path(airframe: AbstractAirframe, now: Condition, power: ScalarLike) -> Scalar:
    """Thrust at a power (percent) less drag, over mass, in the trimmed condition, m/s^2."""
    data = now.air_data
    pushed = airframe.engine.propulsion(power, data)
    direction_b = jnp.stack(
        [jnp.cos(data.alpha) * jnp.cos(data.beta), jnp.sin(data.beta), jnp.sin(data.alpha) * jnp.cos(data.beta)]
    )
    return jnp.sum(direction_b * (now.aerodynamic.force_b + pushed.force_b)) / airframe.mass_properties.mass


def _idle_decelerations(
    airframe: AbstractAirframe, environment: Environment, now: Condition, surfaces: Vector, load_factor: float
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

    return jax.vmap(at_speed)(jnp.asarray(_SPEEDS) * here.V)
