"""What engines have in common whose power follows the throttle with one lag, percent being 100 times the throttle."""

import jax.numpy as jnp

from anser.aircraft.engine import EnginePower
from anser.aircraft.wrench import Wrench
from anser.numerics import cross
from anser.shapes import Scalar, ScalarLike, Vector3


def lagged_rate(power: Scalar, throttle: ScalarLike, lag: Scalar) -> EnginePower:
    """Rate of a power (percent) toward 100 times the throttle, held within 0..1: (100 throttle - power) / lag."""
    return EnginePower((100.0 * jnp.clip(throttle, 0.0, 1.0) - power) / lag)


def steady_throttle(power: ScalarLike) -> Scalar:
    """Throttle (0..1) that holds a power (percent)."""
    return jnp.clip(jnp.asarray(power) / 100.0, 0.0, 1.0)


def throttle_of_rate(power: ScalarLike, power_rate: ScalarLike, lag: Scalar) -> Scalar:
    """Throttle (0..1) whose lag (s) gives nearest to a rate (percent/s) at a power (percent)."""
    return jnp.clip((power + lag * power_rate) / 100.0, 0.0, 1.0)


def at_point(thrust: Scalar, torque: Scalar, point_b: Vector3) -> Wrench:
    """Thrust (N) along body x at a point seen from the centre of gravity (m), and a torque about body x (N m)."""
    zero = jnp.zeros_like(thrust)
    force_b = jnp.stack([thrust, zero, zero])
    return Wrench(force_b=force_b, moment_b=cross(point_b, force_b) + jnp.stack([torque, zero, zero]))
