"""4-D trajectories: a Hermite cubic with two bends, in the frame that drifts with a steady wind."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from anser.planning.reference import AbstractReference, PathPoint
from anser.planning.time_law import Clock, TimeLaw, even_law, path_derivative, published_law
from anser.planning.vectors import norm
from anser.shapes import Flag, Scalar, ScalarLike, Vector3

# s^2 (1 - s)^2 in ascending powers of s: the only quartic that vanishes with its slope at both ends.
BEND_COEFFICIENTS = (0.0, 0.0, 1.0, -2.0, 1.0)
# Below this horizontal distance (m) a line from start to rendezvous has no usable direction of its own.
_NO_DIRECTION = 1e-6


class Trajectory(AbstractReference):
    """Where one aircraft is to be at which time, over a steady wind.

    The path is a polynomial in s, from 0 to 1, in a frame that drifts with the wind and coincides with the ground at
    `start_time`; `law` says how s runs with time. Source: theory section 6.
    """

    start_time: Scalar
    """When the path begins, s."""
    duration: Scalar
    """Time from start to rendezvous, s; positive."""
    coefficients_n: Float[Array, "3 5"]
    """Ascending powers of s, one row per NED axis, m."""
    wind_n: Vector3
    """Velocity of the air over the ground, NED, m/s."""
    lateral_n: Vector3
    """Horizontal unit vector along which lateral bends act, NED."""
    law: TimeLaw
    """Path parameter by time."""

    def clock(self, time: ScalarLike) -> Clock:
        """Path parameter s and its rates at a time: s is 0 at the start, 1 at the rendezvous."""
        return self.law.clock(self.coefficients_n, time - self.start_time, self.duration)

    def phase(self, time: ScalarLike) -> Scalar:
        """Path parameter s at a time."""
        return self.clock(time).s

    def path_derivative(self, phase: ScalarLike, order: int) -> Vector3:
        """Derivative of the air-frame path with respect to s, of order 0 to 3, at a given s, m."""
        return path_derivative(self.coefficients_n, phase, order)

    def at(self, time: ScalarLike) -> PathPoint:
        """Motion over the ground at a time (the acceleration is the same in both frames, the wind being steady)."""
        now = self.clock(time)
        slope_n, bend_n = self.path_derivative(now.s, 1), self.path_derivative(now.s, 2)
        return PathPoint(
            position_n=self.path_derivative(now.s, 0) + self.wind_n * (time - self.start_time),
            velocity_n=slope_n * now.s_dot + self.wind_n,
            acceleration_n=bend_n * now.s_dot**2 + slope_n * now.s_ddot,
        )

    def air_velocity_n(self, time: ScalarLike) -> Vector3:
        """Velocity relative to the air at a time, NED, m/s."""
        now = self.clock(time)
        return self.path_derivative(now.s, 1) * now.s_dot


def lateral_direction_n(line_n: Vector3, velocity_0_n: Vector3) -> Vector3:
    """Horizontal unit vector to the right of the line from start to rendezvous in the frame of the path, NED.

    The horizontal direction of the velocity at the start replaces that of a vertical line, and North that of both.
    """
    ahead = line_n[:2]
    for replacement in (velocity_0_n[:2], jnp.array([1.0, 0.0])):
        ahead = jnp.where(norm(ahead) > _NO_DIRECTION, ahead, replacement)
    ahead = ahead / norm(ahead)
    return jnp.stack([-ahead[1], ahead[0], jnp.zeros_like(ahead[0])])


def bend_trajectory(trajectory: Trajectory, lateral_bend: ScalarLike, vertical_bend: ScalarLike = 0.0) -> Trajectory:
    """Add to a trajectory's bends; the ends and their directions, and the times, stay.

    A lateral bend kappa = b_4 duration^4, m, shifts the middle by kappa/16 along `lateral_n`, a vertical one,
    c_4 duration^4, upwards. The result follows the published time law; `with_even_speed` gives it another.
    """
    shift = lateral_bend * trajectory.lateral_n - vertical_bend * jnp.array([0.0, 0.0, 1.0])
    coefficients = trajectory.coefficients_n + shift[:, None] * jnp.array(BEND_COEFFICIENTS)[None, :]
    return eqx.tree_at(lambda path: (path.coefficients_n, path.law), trajectory, (coefficients, published_law()))


def with_even_speed(
    trajectory: Trajectory,
    speed_0: ScalarLike,
    deceleration: ScalarLike | None = None,
    exchange: ScalarLike | None = None,
    even: Flag | bool = True,
) -> Trajectory:
    """The same path and times at an airspeed that changes evenly from `speed_0` (m/s); see `even_law`."""
    law = even_law(trajectory.coefficients_n, trajectory.duration, speed_0, deceleration, exchange, even)
    return eqx.tree_at(lambda path: path.law, trajectory, law)


def fit_trajectory(
    start_time: ScalarLike,
    duration: ScalarLike,
    position_0: Vector3,
    velocity_0: Vector3,
    position_f: Vector3,
    velocity_f: Vector3,
    lateral_bend: ScalarLike = 0.0,
    vertical_bend: ScalarLike = 0.0,
    wind_n: Vector3 | None = None,
    line_n: Vector3 | None = None,
) -> Trajectory:
    """Trajectory through given positions and velocities at its ends.

    Parameters
    ----------
    start_time, duration
        Seconds; the duration is positive.
    position_0
        Start, NED, m.
    velocity_0
        Velocity relative to the air at the start, NED, m/s.
    position_f
        Rendezvous in the frame that drifts with the air (place over the ground minus wind times duration), NED, m.
    velocity_f
        Velocity relative to the air at the rendezvous, NED, m/s.
    lateral_bend, vertical_bend
        Shape parameters, m, see `bend_trajectory`; zero is the nominal path.
    wind_n
        Steady wind, NED, m/s; none is still air.
    line_n
        Direction to the right of which lateral bends act; from start to rendezvous where none is given. A plan renewed
        on the way names the line of its first start: only then is a bent path's rest again a path of this family.

    Notes
    -----
    Theory section 6, with time scaled to [0, 1]: there the solution for the four lower coefficients is the Hermite
    cubic and the null space of the boundary conditions is s^2 (1 - s)^2.
    """
    duration = jnp.asarray(duration, dtype=float)
    line, slope_0, slope_f = position_f - position_0, duration * velocity_0, duration * velocity_f
    cubic = [position_0, slope_0, 3.0 * line - 2.0 * slope_0 - slope_f, slope_0 + slope_f - 2.0 * line]
    nominal = Trajectory(
        jnp.asarray(start_time, dtype=float),
        duration,
        jnp.stack([*cubic, jnp.zeros(3)], axis=1),
        jnp.zeros(3) if wind_n is None else wind_n,
        lateral_direction_n(line if line_n is None else line_n, velocity_0),
        published_law(),
    )
    return bend_trajectory(nominal, lateral_bend, vertical_bend)
