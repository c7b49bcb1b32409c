"""Motion along a path: reference for guidance, and command for the controller (airspeed, path angle, course, rates)."""

import abc

import equinox as eqx
import jax
import jax.numpy as jnp

from anser.parts.part import AbstractPart
from anser.shapes import Scalar, ScalarLike, Vector3
from anser.spatial.vectors import norm

# Rounding must not put the start of a path before the path; float32 rounds a time of four hours by 0.5 ms.
_ROUNDINGS = 1e4


def time_rounding(time: ScalarLike) -> float:
    """Return the tolerance, s, within which two times count as equal: 0 in float64, 1.2 ms in float32."""
    dtype = jnp.result_type(time)
    return 0.0 if dtype == jnp.float64 else _ROUNDINGS * float(jnp.finfo(dtype).eps)


class PathPoint(eqx.Module):
    """Position (m), velocity (m/s), acceleration (m/s^2) over the ground at one instant, NED in the Earth's chart."""

    position_n: Vector3
    velocity_n: Vector3
    acceleration_n: Vector3


class AbstractReference(AbstractPart):
    """Interface of a reference motion for guidance: position, velocity and acceleration as functions of time."""

    @abc.abstractmethod
    def at(self, time: ScalarLike) -> PathPoint:
        """Return position, velocity and acceleration over the ground at a time (s)."""

    def position_n(self, time: ScalarLike) -> Vector3:
        """Return the position in the Earth's chart at a time (s), NED, m."""
        return self.at(time).position_n

    def velocity_n(self, time: ScalarLike) -> Vector3:
        """Return the velocity over the ground at a time (s), NED, m/s."""
        return self.at(time).velocity_n

    def acceleration_n(self, time: ScalarLike) -> Vector3:
        """Return the acceleration over the ground at a time (s), NED, m/s^2."""
        return self.at(time).acceleration_n


class StraightPath(AbstractReference):
    """Straight line over the ground at constant speed; positions NED in the Earth's chart, m, times in s.

    `end_time` must be later than `start_time`.
    """

    start_n: Vector3
    end_n: Vector3
    start_time: ScalarLike
    end_time: ScalarLike

    def at(self, time: ScalarLike) -> PathPoint:
        """Return position, velocity and acceleration at a time (s); the line continues beyond its two ends."""
        velocity_n = (self.end_n - self.start_n) / (self.end_time - self.start_time)
        return PathPoint(self.start_n + (time - self.start_time) * velocity_n, velocity_n, jnp.zeros_like(velocity_n))


class LoopExcitation(eqx.Module):
    """Test inputs inside the autopilot: increments of the commands to the attitude loop and to the rate loop."""

    attitude: Vector3  #: Addition to the commanded (mu, alpha, beta), rad.
    rates_b: Vector3  #: Addition to the commanded (P, Q, R), rad/s.


class PathCommand(eqx.Module):
    """Command to the velocity loop: speed (m/s), path angle and course (rad), with their rates (per second)."""

    V: Scalar  #: Speed, m/s.
    gamma: Scalar  #: Path angle, up positive, rad.
    chi: Scalar  #: Course, clockwise from North, rad, in (-pi, pi].
    V_dot: Scalar  #: Rate of the speed, m/s^2.
    gamma_dot: Scalar  #: Rate of the path angle, rad/s.
    chi_dot: Scalar  #: Rate of the course, rad/s.
    excitation: LoopExcitation | None = None  #: Test input of the inner loops; None: no test input.


def polar(velocity_n: Vector3, acceleration_n: Vector3) -> PathCommand:
    """Convert a velocity and its time derivative (NED, m/s, m/s^2) to speed, path angle and course with their rates.

    The velocity is over the ground or relative to the air. In vertical flight, course and course rate are 0; at rest,
    all angles and rates are 0. Theory section 6, "Commands along a trajectory".
    """
    north, east, down = jnp.unstack(velocity_n)
    north_dot, east_dot, down_dot = jnp.unstack(acceleration_n)
    up, up_dot = -down, -down_dot
    speed, level = norm(velocity_n), norm(velocity_n[:2])
    moving, turning = speed > 0.0, level > 0.0
    safe_speed, safe_level = jnp.where(moving, speed, 1.0), jnp.where(turning, level, 1.0)
    # atan2, because asin loses digits and has no derivative near the vertical. At rest atan2 gets (0, 1), because its
    # derivative at (0, 0) is not a number.
    gamma = jnp.arctan2(up, jnp.where(moving, level, 1.0))
    chi = jnp.arctan2(jnp.where(turning, east, 0.0), jnp.where(turning, north, 1.0))
    level_dot = (north * north_dot + east * east_dot) / safe_level
    return PathCommand(
        V=speed,
        gamma=gamma,
        chi=chi,
        V_dot=(north * north_dot + east * east_dot + up * up_dot) / safe_speed,
        gamma_dot=(level * up_dot - up * level_dot) / safe_speed**2,
        chi_dot=(north * east_dot - east * north_dot) / safe_level**2,
    )


def rescale_command(command: PathCommand, scale: Vector3) -> PathCommand:
    """Return a command whose velocity is multiplied by `scale`, a constant factor for each NED component.

    The function converts a command between velocities and rates of chart coordinates. Test inputs are dropped.
    """

    def cartesian(V: Scalar, gamma: Scalar, chi: Scalar) -> Vector3:
        level = V * jnp.cos(gamma)
        return jnp.stack([level * jnp.cos(chi), level * jnp.sin(chi), -V * jnp.sin(gamma)])

    velocity_n, acceleration_n = jax.jvp(
        cartesian, (command.V, command.gamma, command.chi), (command.V_dot, command.gamma_dot, command.chi_dot)
    )
    return polar(scale * velocity_n, scale * acceleration_n)
