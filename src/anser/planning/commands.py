"""Speed, path angle and course of a velocity, with their rates."""

import equinox as eqx
import jax
import jax.numpy as jnp

from anser.planning.vectors import norm
from anser.shapes import Scalar, Vector3


class PathCommand(eqx.Module):
    """Velocity in polar form and its rates: what the trajectory asks of the autopilot."""

    V: Scalar
    """Speed, m/s."""
    gamma: Scalar
    """Path angle, up positive, rad."""
    chi: Scalar
    """Course, clockwise from North, rad, in (-pi, pi]."""
    V_dot: Scalar
    """m/s^2."""
    gamma_dot: Scalar
    """rad/s."""
    chi_dot: Scalar
    """rad/s."""


def polar(velocity_n: Vector3, acceleration_n: Vector3) -> PathCommand:
    """Polar form of a velocity and of its rate of change.

    Parameters
    ----------
    velocity_n
        Velocity over the ground or relative to the air, NED, m/s. In vertical flight the course is reported as 0 and
        its rate as 0, at rest all angles and rates.
    acceleration_n
        Its time derivative, NED, m/s^2.

    Notes
    -----
    Theory section 6, "Commands along a trajectory"; the path angle by atan2 instead of asin, which loses digits and
    its derivative near the vertical.
    """
    north, east, up = velocity_n[0], velocity_n[1], -velocity_n[2]
    north_dot, east_dot, up_dot = acceleration_n[0], acceleration_n[1], -acceleration_n[2]
    speed, level = norm(velocity_n), norm(velocity_n[:2])
    moving, turning = speed > 0.0, level > 0.0
    safe_speed, safe_level = jnp.where(moving, speed, 1.0), jnp.where(turning, level, 1.0)
    # At rest atan2 is asked about (0, 1): its derivative at (0, 0) is not a number.
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


def rescaled(command: PathCommand, scale: Vector3) -> PathCommand:
    """Command for the velocity whose components are those of another one times `scale` (3,), taken as constant.

    Takes a command from the coordinates of a chart to velocities over ground and back.
    """

    def cartesian(V: Scalar, gamma: Scalar, chi: Scalar) -> Vector3:
        level = V * jnp.cos(gamma)
        return jnp.stack([level * jnp.cos(chi), level * jnp.sin(chi), -V * jnp.sin(gamma)])

    velocity_n, acceleration_n = jax.jvp(
        cartesian, (command.V, command.gamma, command.chi), (command.V_dot, command.gamma_dot, command.chi_dot)
    )
    return polar(scale * velocity_n, scale * acceleration_n)
