"""Deep stall: trims with surfaces held, followed as the centre of gravity moves.

Steady descents; the dataset and the document.
"""

from collections.abc import Sequence
from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from jaxtyping import Array, Bool, Float

from anser.aircraft.air_data import AirData
from anser.aircraft.f16 import AbstractF16
from anser.aircraft_files.library import load_airframe
from anser.compiling.options import compiled, enable_compilation_cache
from anser.environment.atmosphere import AbstractAtmosphere
from anser.environment.environment import standard_environment
from anser.results.documents import version_attributes
from anser.shapes import Scalar, ScalarLike, Vector
from anser.units import DEG_RAD, RAD_DEG

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
    return airframe.actuators.scheduled_position(neutral, data)


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


CENTRES_OF_GRAVITY = (0.30, 0.35, 0.365, 0.38, 0.40)
"""Centres of gravity whose pitching moments are shown, fractions of the chord."""
_GRID_DEG = 0.25
_STEP_DEG, _POINTS = 0.1, 1200
_X_CG_MIN = 0.1

_curves = compiled(
    lambda airframe, mach, elevator, alpha, x_cg: jax.vmap(
        lambda x: jax.vmap(lambda a: pitching_moment(airframe, mach, elevator, a, x))(alpha)
    )(x_cg)
)
_follow = compiled(
    lambda airframe, mach, elevator, alpha, x_cg, steps: jax.vmap(
        lambda step: follow_pitch_trim(airframe, mach, elevator, alpha, x_cg, step, _POINTS)
    )(steps)
)
_descents = compiled(
    lambda airframe, environment, altitude, elevator, alpha: jax.vmap(
        lambda a: steady_descent(airframe, environment.atmosphere, environment.gravity, altitude, elevator, a)
    )(alpha)
)


def deep_stall(
    variant: str = "tp1538",
    *,
    x_cg_over_c: Sequence[float] = CENTRES_OF_GRAVITY,
    elevator_deg: float | None = None,
    alpha_from_deg: float = 20.0,
    mach: float = 0.2,
    altitude_m: float = 5000.0,
) -> xr.Dataset:
    """Find the angles of attack where the pitching moment balances with the elevator held, and follow them.

    Without sideslip and rates, flap at its schedule. From the trims at the centre of gravity furthest aft the curve of
    trims is followed forward, through where a stable and an unstable one meet.

    Parameters
    ----------
    variant
        Of the F-16.
    x_cg_over_c
        Centres of gravity, fractions of the chord.
    elevator_deg
        Deflection that is held; fully nose-down where None.
    alpha_from_deg
        Least angle of attack that is looked at.
    mach
        For the flap's schedule.
    altitude_m
        At which the steady descents of the trims are found.

    Returns
    -------
    xr.Dataset
        `pitching_moment` over (x_cg, alpha); `branch_alpha`, `branch_x_cg`, `branch_slope` over (point), the followed
        curve, nan where it has ended; `trim_alpha`, `trim_x_cg`, `trim_stable`, `trim_speed`, `trim_path_angle`,
        `trim_pitch` over (trim), those at the given centres of gravity.
    """
    enable_compilation_cache()
    airframe, environment = load_airframe("f16", variant), standard_environment()
    most = float(airframe.actuators.upper[0])
    elevator = most if elevator_deg is None else elevator_deg * DEG_RAD
    if not float(airframe.actuators.lower[0]) - 1e-9 <= elevator <= most + 1e-9:
        raise ValueError(f"elevator_deg: arrived {elevator_deg:g}; the surface moves by {most * RAD_DEG:g} deg at most")
    low, high = (float(x) * RAD_DEG for x in airframe.alpha_range)
    if not low <= alpha_from_deg < high:
        raise ValueError(f"alpha_from_deg: arrived {alpha_from_deg:g}; the data go from {low:g} to {high:g} deg")
    centres = np.sort(np.asarray(x_cg_over_c, dtype=float))
    alphas = np.arange(alpha_from_deg, high + 1e-9, _GRID_DEG)
    case = (airframe, jnp.asarray(mach, dtype=float), jnp.asarray(elevator, dtype=float))
    moments = np.asarray(_curves(*case, jnp.asarray(alphas * DEG_RAD), jnp.asarray(centres)))
    trims = [(x, *trim) for x, row in zip(centres, moments, strict=True) for trim in _roots(alphas, row)]
    branch = _branch(case, [trim for trim in trims if trim[0] == centres[-1]], (alpha_from_deg, high), centres[-1])
    found = np.array([alpha for _, alpha, _ in trims])
    descents = (
        _descents(airframe, environment, jnp.asarray(altitude_m, dtype=float), case[2], jnp.asarray(found * DEG_RAD))
        if trims
        else None
    )

    def angle(name: str) -> np.ndarray:
        return np.zeros(0) if descents is None else np.asarray(getattr(descents, name)) * RAD_DEG

    return xr.Dataset(
        {
            "pitching_moment": (("x_cg", "alpha"), moments, {"long_name": "pitching moment coefficient", "units": "1"}),
            "branch_alpha": ("point", branch.alpha * RAD_DEG, {"long_name": "angle of attack", "units": "deg"}),
            "branch_x_cg": ("point", branch.x_cg, {"long_name": "centre of gravity", "units": "1"}),
            "branch_slope": ("point", branch.slope, {"long_name": "slope of Cm against alpha", "units": "rad-1"}),
            "trim_alpha": ("trim", found, {"long_name": "angle of attack", "units": "deg"}),
            "trim_x_cg": ("trim", np.array([x for x, _, _ in trims]), {"long_name": "centre of gravity", "units": "1"}),
            "trim_stable": ("trim", np.array([int(s) for _, _, s in trims]), {"long_name": "stable in pitch"}),
            "trim_speed": (
                "trim",
                np.zeros(0) if descents is None else np.asarray(descents.speed),
                {"long_name": "true airspeed of the steady descent", "units": "m s-1"},
            ),
            "trim_path_angle": ("trim", angle("path_angle"), {"long_name": "path angle", "units": "deg"}),
            "trim_pitch": ("trim", angle("pitch"), {"long_name": "pitch angle", "units": "deg"}),
        },
        coords={
            "x_cg": ("x_cg", centres, {"long_name": "centre of gravity", "units": "1"}),
            "alpha": ("alpha", alphas, {"long_name": "angle of attack", "units": "deg"}),
        },
        attrs={
            "aircraft": "f16",
            "variant": variant,
            "elevator_deg": elevator * RAD_DEG,
            "mach": mach,
            "altitude_m": altitude_m,
            **version_attributes(),
        },
    )


def deep_stall_document(found: xr.Dataset) -> dict[str, Any]:
    """What was found in plain data: trims, and where they appear as the centre of gravity moves aft."""
    onset = deep_stall_onset(found)
    return {
        "format_version": 1,
        **{key: found.attrs[key] for key in ("aircraft", "variant", "elevator_deg", "mach", "altitude_m")},
        "greatest_pitching_moment": [
            {
                "x_cg_over_c": float(x),
                "pitching_moment": float(row.max()),
                "alpha_deg": float(found["alpha"][row.argmax()]),
            }
            for x, row in zip(found["x_cg"].values, found["pitching_moment"].values, strict=True)
        ],
        "trims": [
            {
                "x_cg_over_c": float(one["trim_x_cg"]),
                "alpha_deg": float(one["trim_alpha"]),
                "stable": bool(one["trim_stable"]),
                "speed_m_s": float(one["trim_speed"]),
                "path_angle_deg": float(one["trim_path_angle"]),
                "pitch_deg": float(one["trim_pitch"]),
            }
            for one in (found.isel(trim=k) for k in range(found.sizes["trim"]))
        ],
        "appears": None if onset is None else {"x_cg_over_c": onset[0], "alpha_deg": onset[1]},
    }


def deep_stall_onset(found: xr.Dataset) -> tuple[float, float] | None:
    """Centre of gravity furthest forward on the followed curve, with its angle of attack, deg; None without a curve."""
    x_cg = found["branch_x_cg"].values
    if not np.isfinite(x_cg).any():
        return None
    first = int(np.nanargmin(x_cg))
    return float(x_cg[first]), float(found["branch_alpha"][first])


def _roots(alphas: np.ndarray, row: np.ndarray) -> list[tuple[float, bool]]:
    """Angles (deg) where a curve crosses 0, and whether it falls there."""
    at = np.flatnonzero(row[:-1] * row[1:] < 0.0)
    return [
        (float(alphas[k] + (alphas[k + 1] - alphas[k]) * row[k] / (row[k] - row[k + 1])), bool(row[k + 1] < row[k]))
        for k in at
    ]


def _branch(
    case: tuple[Any, Any, Any],
    trims: Sequence[tuple[float, float, bool]],
    alpha_range_deg: tuple[float, float],
    x_cg_max: float,
) -> PitchBranch:
    """The curve of trims through the last stable one, from its one end to the other; nothing where there is none."""
    stable = [trim for trim in trims if trim[2]]
    if not stable:
        nothing = jnp.full(1, jnp.nan)
        return PitchBranch(nothing, nothing, nothing, jnp.zeros(1, bool))
    x_cg, alpha, _ = stable[-1]
    steps = jnp.asarray([1.0, -1.0]) * _STEP_DEG * DEG_RAD
    both = jax.tree.map(np.asarray, _follow(*case, jnp.asarray(alpha * DEG_RAD), jnp.asarray(x_cg), steps))
    low, high = (x * DEG_RAD for x in alpha_range_deg)
    parts = []
    for k in (0, 1):
        inside = both.balanced[k] & (both.alpha[k] >= low) & (both.alpha[k] <= high)
        inside &= (both.x_cg[k] <= x_cg_max + 1e-9) & (both.x_cg[k] >= _X_CG_MIN)
        count = inside.size if inside.all() else int(np.argmin(inside))
        parts.append(jax.tree.map(lambda leaf, k=k, count=count: leaf[k][:count], both))
    up, down = parts
    return jax.tree.map(lambda a, b: np.concatenate([a[:0:-1], b]), up, down)
