"""What guidance follows: a motion over the ground by time."""

import abc

import equinox as eqx
import jax.numpy as jnp

from anser.shapes import ScalarLike, Vector3

_ROUNDINGS = 1e4


def time_rounding(time: ScalarLike) -> float:
    """By how much rounding may part two times of a flight that are the same, s: 0 in float64; 1.2 ms in float32.

    The instant at which a path begins must not count as one before it, where nothing accelerates: float32 rounds a time
    of ten minutes by 0.03 ms, and of four hours by 0.5 ms.
    """
    dtype = jnp.result_type(time)
    return 0.0 if dtype == jnp.float64 else _ROUNDINGS * float(jnp.finfo(dtype).eps)


class PathPoint(eqx.Module):
    """Motion along a path at one instant, over the ground in the Earth's chart, NED.

    Attributes
    ----------
    position_n
        m.
    velocity_n
        m/s.
    acceleration_n
        m/s^2.
    """

    position_n: Vector3
    velocity_n: Vector3
    acceleration_n: Vector3


class AbstractReference(eqx.Module):
    """A motion that can be followed."""

    @abc.abstractmethod
    def at(self, time: ScalarLike) -> PathPoint:
        """Where to be at a time (s), how fast, and how that changes."""

    def position_n(self, time: ScalarLike) -> Vector3:
        """Position over the ground at a time, NED, m."""
        return self.at(time).position_n

    def velocity_n(self, time: ScalarLike) -> Vector3:
        """Velocity over the ground at a time, NED, m/s."""
        return self.at(time).velocity_n

    def acceleration_n(self, time: ScalarLike) -> Vector3:
        """Acceleration over the ground at a time, NED, m/s^2."""
        return self.at(time).acceleration_n
