"""What guidance follows: a motion over the ground by time."""

import abc

import equinox as eqx

from anser.shapes import ScalarLike, Vector3


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
