"""Deep stall: angles of attack where the pitching moment balances with surfaces held, followed as the c.g. moves."""

from typing import TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from anser.aircraft import AbstractF16, AirData
from anser.environment import AbstractAtmosphere
from anser.shapes import Scalar, ScalarLike, Vector

_CORRECTIONS = 12
_BALANCED = 1e-10
_SPEED_STEPS = 60
AnyF16 = TypeVar("AnyF16", bound=AbstractF16)


class PitchBranch(eqx.Module):
    """Pitch trims along a curve, one after the other.

    Attributes
    ----------
    alpha
        Angle of attack, rad, shape (points,).
    x_cg
        Centre of gravity, fraction of the chord.
    slope
        dCm/dalpha there, 1/rad: stable where it is negative.
    balanced
        Whether the pitching moment vanishes there: False from where the curve could not be followed.
    """

    alpha: Vector
    x_cg: Vector
    slope: Vector
    balanced: Bool[Array, " points"]


class SteadyDescent(eqx.Module):
    """Straight descent, wings level, at an angle of attack with the engine idling.

    Attributes
    ----------
    speed, path_angle, pitch
        True airspeed, m/s; angles, rad.
    """

    speed: Scalar
    path_angle: Scalar
    pitch: Scalar


def pitching_moment(
    airframe: AbstractF16, mach: ScalarLike, elevator: ScalarLike, alpha: ScalarLike, x_cg: ScalarLike
) -> Scalar:
    """Cm without sideslip and rates, the elevator (rad) held, aileron and rudder at 0, the flap at its schedule.

    Parameters
    ----------
    airframe
        Its own centre of gravity does not matter.
    mach
        Of the flap's schedule.
    elevator, alpha
        Rad.
    x_cg
        Centre of gravity, fraction of the chord.
    """
    moved = eqx.tree_at(lambda a: a.x_cg, airframe, jnp.asarray(x_cg))
    data = _flow(mach, alpha)
    return moved.coefficients(data, jnp.zeros(3), _held(moved, data, elevator)).Cm


def _flow(mach: ScalarLike, alpha: ScalarLike) -> AirData:
    one = jnp.ones_like(jnp.asarray(alpha, dtype=float))
    return AirData(100.0 * one, alpha * one, 0.0 * one, one, 5000.0 * one, mach * one, 0.0 * one)


def _held(airframe: AbstractF16, data: AirData, elevator: ScalarLike) -> Vector:
    neutral = jnp.zeros(len(airframe.actuators.names)).at[0].set(elevator)
    return airframe.actuators.scheduled(neutral, data)


def follow_pitch_trim(
    airframe: AbstractF16,
    mach: ScalarLike,
    elevator: ScalarLike,
    alpha: ScalarLike,
    x_cg: ScalarLike,
    step: ScalarLike,
    count: int,
) -> PitchBranch:
    """Follow a pitch trim as the centre of gravity moves, around folds.

    Pseudo-arclength continuation in (alpha in rad, x_cg): a step along the tangent of Cm(alpha, x_cg) = 0, then Newton
    steps on Cm and on the distance along the tangent (H. B. Keller, "Numerical solution of bifurcation and nonlinear
    eigenvalue problems", 1977). Slopes of tables jump at their breakpoints: there Newton steps land in the next piece.

    Parameters
    ----------
    airframe, mach, elevator
        See `pitching_moment`.
    alpha, x_cg
        Near the first trim: it is corrected at this x_cg.
    step
        Length of a step, rad; positive begins with growing alpha.
    count
        Number of points.
    """

    def Cm(at: Float[Array, "2"]) -> Scalar:
        return pitching_moment(airframe, mach, elevator, at[0], at[1])

    def corrected(start: Float[Array, "2"], along: Float[Array, "2"]) -> Float[Array, "2"]:
        """Where Cm vanishes on the line through `start` across `along`."""
        across = jnp.stack([-along[1], along[0]])

        def newton(_: object, at: Float[Array, "2"]) -> Float[Array, "2"]:
            value, slope = jax.value_and_grad(Cm)(at)
            towards = jnp.sum(slope * across)
            return at - across * value / jnp.where(jnp.abs(towards) < 1e-9, 1e-9, towards)

        return jax.lax.fori_loop(0, _CORRECTIONS, newton, start)

    def tangent(at: Float[Array, "2"], before: Float[Array, "2"]) -> Float[Array, "2"]:
        slope = jax.grad(Cm)(at)
        along = jnp.stack([-slope[1], slope[0]]) / jnp.sqrt(jnp.sum(slope**2) + 1e-30)
        return along * jnp.where(jnp.sum(along * before) < 0.0, -1.0, 1.0)

    def one(carry: tuple[Array, Array], _: None) -> tuple[tuple[Array, Array], PitchBranch]:
        at, along = carry
        here = PitchBranch(at[0], at[1], jax.grad(Cm)(at)[0], jnp.abs(Cm(at)) < _BALANCED)
        along = tangent(at, along)
        return (corrected(at + jnp.abs(step) * along, along), along), here

    only_alpha = jnp.array([0.0, 1.0])
    first = corrected(jnp.stack([jnp.asarray(alpha, dtype=float), jnp.asarray(x_cg, dtype=float)]), only_alpha)
    begin = jnp.stack([jnp.sign(jnp.asarray(step, dtype=float)), jnp.zeros(())])
    return jax.lax.scan(one, (first, begin), length=count)[1]


def steady_descent(
    airframe: AbstractF16,
    atmosphere: AbstractAtmosphere,
    gravity: ScalarLike,
    altitude: ScalarLike,
    elevator: ScalarLike,
    alpha: ScalarLike,
) -> SteadyDescent:
    """Speed at which the aerodynamic force and idle thrust carry the weight, and the path angle that follows.

    `altitude` in m, angles in rad. Pitching moment and the lateral axes are not looked at.
    """
    air = atmosphere.at(altitude)
    weight = airframe.mass_properties.mass * gravity

    def forces(speed: Scalar) -> tuple[Scalar, Scalar]:
        data = _flow(speed / air.speed_of_sound, alpha)
        values = speed, air.density, 0.5 * air.density * speed**2, jnp.asarray(altitude, dtype=float)
        data = eqx.tree_at(lambda d: (d.V, d.density, d.qbar, d.altitude), data, values)
        body = airframe.aerodynamics(data, jnp.zeros(3), _held(airframe, data, elevator)).force_b
        X, Z = body[0] + airframe.engine.propulsion(0.0, data).force_b[0], body[2]
        ca, sa = jnp.cos(alpha), jnp.sin(alpha)
        return -(X * ca + Z * sa), X * sa - Z * ca

    def closer(_: object, speed: Scalar) -> Scalar:
        drag, lift = forces(speed)
        return speed * jnp.sqrt(jnp.sqrt(weight / jnp.sqrt(drag**2 + lift**2)))

    speed = jax.lax.fori_loop(0, _SPEED_STEPS, closer, jnp.asarray(100.0))
    drag, lift = forces(speed)
    path_angle = -jnp.arctan2(drag, lift)
    return SteadyDescent(speed, path_angle, path_angle + alpha)
