"""Deep stall of the F-16: pitch trims with fixed surfaces over the centre of gravity, and descents in these trims."""

from collections.abc import Sequence
from typing import Any, cast

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
from anser.environment.environment import Environment, standard_environment
from anser.results.documents import version_attributes
from anser.results.variable_labels import unit_attributes
from anser.shapes import Scalar, ScalarLike, Vector
from anser.units import DEG_RAD, RAD_DEG

_NEWTON_STEPS = 12
_CM_TOLERANCE = 1e-10
_SPEED_STEPS = 60


class PitchBranch(eqx.Module):
    """Points on a curve of pitch trims (Cm = 0) over angle of attack and centre of gravity."""

    alpha: Vector  # rad
    x_cg: Vector  # fraction of the mean chord
    slope: Vector  # dCm/dalpha, 1/rad; negative: stable
    balanced: Bool[Array, " points"]  # False for a point at which no trim was reached


class SteadyDescent(eqx.Module):
    """Steady straight descent, wings level, engine idling: true airspeed (m/s), path angle and pitch angle (rad)."""

    speed: Scalar
    path_angle: Scalar
    pitch: Scalar


def pitching_moment(
    airframe: AbstractF16, mach: ScalarLike, elevator: ScalarLike, alpha: ScalarLike, x_cg: ScalarLike
) -> Scalar:
    """Return the pitching-moment coefficient Cm of an F-16 at zero sideslip and body rates.

    Elevator and alpha are in rad; `x_cg` (fraction of the mean chord) replaces the airframe's centre of gravity.
    Aileron and rudder are 0; the flap follows the schedule for the Mach number.
    """
    shifted = eqx.tree_at(lambda a: a.x_cg, airframe, jnp.asarray(x_cg))
    data = _flow(mach, alpha)
    return shifted.coefficients(data, jnp.zeros(3), _deflections(shifted, data, elevator)).Cm


def _flow(mach: ScalarLike, alpha: ScalarLike) -> AirData:
    ones = jnp.ones_like(jnp.asarray(alpha, dtype=float))
    return AirData(100.0 * ones, alpha * ones, 0.0 * ones, ones, 5000.0 * ones, mach * ones, 0.0 * ones)


def _deflections(airframe: AbstractF16, data: AirData, elevator: ScalarLike) -> Vector:
    neutral = jnp.zeros(len(airframe.actuators.names)).at[0].set(elevator)
    return airframe.actuators.scheduled_position(neutral, data)


def follow_pitch_trim(
    # see `pitching_moment`
    airframe: AbstractF16,
    mach: ScalarLike,
    elevator: ScalarLike,
    # start point: `alpha` (rad) is corrected to a trim at this `x_cg` (fraction of the mean chord)
    alpha: ScalarLike,
    x_cg: ScalarLike,
    step: ScalarLike,  # length of a step, rad; positive: alpha grows at first
    count: int,  # number of points
) -> PitchBranch:
    """Follow the curve Cm(alpha, x_cg) = 0 from a start point, also beyond its folds; return `count` points.

    A fold is a point at which x_cg has an extremum along the curve. Method: pseudo-arclength continuation (H. B.
    Keller, "Numerical solution of bifurcation and nonlinear eigenvalue problems", 1977).
    """

    def Cm(point: Float[Array, "2"]) -> Scalar:
        return pitching_moment(airframe, mach, elevator, point[0], point[1])

    def corrected(predicted: Float[Array, "2"], direction: Float[Array, "2"]) -> Float[Array, "2"]:
        """Return the point with Cm = 0 on the line through `predicted` perpendicular to `direction`."""
        normal = jnp.stack([-direction[1], direction[0]])

        def newton(_: object, point: Float[Array, "2"]) -> Float[Array, "2"]:
            value, slope = jax.value_and_grad(Cm)(point)
            normal_slope = jnp.sum(slope * normal)
            return point - normal * value / jnp.where(jnp.abs(normal_slope) < 1e-9, 1e-9, normal_slope)

        return jax.lax.fori_loop(0, _NEWTON_STEPS, newton, predicted)

    def tangent(point: Float[Array, "2"], previous: Float[Array, "2"]) -> Float[Array, "2"]:
        slope = jax.grad(Cm)(point)
        direction = jnp.stack([-slope[1], slope[0]]) / jnp.sqrt(jnp.sum(slope**2) + 1e-30)
        return direction * jnp.where(jnp.sum(direction * previous) < 0.0, -1.0, 1.0)

    def advance(carry: tuple[Array, Array], _: None) -> tuple[tuple[Array, Array], PitchBranch]:
        point, direction = carry
        trim = PitchBranch(point[0], point[1], jax.grad(Cm)(point)[0], jnp.abs(Cm(point)) < _CM_TOLERANCE)
        direction = tangent(point, direction)
        return (corrected(point + jnp.abs(step) * direction, direction), direction), trim

    x_cg_axis = jnp.array([0.0, 1.0])
    first_trim = corrected(jnp.stack([jnp.asarray(alpha, dtype=float), jnp.asarray(x_cg, dtype=float)]), x_cg_axis)
    start_direction = jnp.stack([jnp.sign(jnp.asarray(step, dtype=float)), jnp.zeros(())])
    return jax.lax.scan(advance, (first_trim, start_direction), length=count)[1]


def steady_descent(
    airframe: AbstractF16,
    atmosphere: AbstractAtmosphere,
    gravity: ScalarLike,
    altitude: ScalarLike,
    elevator: ScalarLike,
    alpha: ScalarLike,
) -> SteadyDescent:
    """Return the steady descent in which aerodynamic force and idle thrust balance the weight at a given alpha.

    Units are m (altitude), rad (elevator, alpha) and m/s^2 (gravity). Moments and side force need not be zero.
    """
    air = atmosphere.at(altitude)
    weight = airframe.mass_properties.mass * gravity

    def forces(speed: Scalar) -> tuple[Scalar, Scalar]:
        data = _flow(speed / air.speed_of_sound, alpha)
        values = speed, air.density, 0.5 * air.density * speed**2, jnp.asarray(altitude, dtype=float)
        data = eqx.tree_at(lambda d: (d.V, d.density, d.qbar, d.altitude), data, values)
        body = airframe.aerodynamics(data, jnp.zeros(3), _deflections(airframe, data, elevator)).force_b
        X, Z = body[0] + airframe.engine.propulsion(0.0, data).force_b[0], body[2]
        ca, sa = jnp.cos(alpha), jnp.sin(alpha)
        return -(X * ca + Z * sa), X * sa - Z * ca

    def scale_to_weight(_: object, speed: Scalar) -> Scalar:
        drag, lift = forces(speed)
        return speed * jnp.sqrt(jnp.sqrt(weight / jnp.sqrt(drag**2 + lift**2)))

    speed = jax.lax.fori_loop(0, _SPEED_STEPS, scale_to_weight, jnp.asarray(100.0))
    drag, lift = forces(speed)
    path_angle = -jnp.arctan2(drag, lift)
    return SteadyDescent(speed, path_angle, path_angle + alpha)


CENTRES_OF_GRAVITY = (0.30, 0.35, 0.365, 0.38, 0.40)
"""Default centres of gravity for the curves of the pitching moment, fractions of the mean chord."""
_GRID_DEG = 0.25
_STEP_DEG, _POINTS = 0.1, 1200
_X_CG_MIN = 0.1


@compiled
def _curves(airframe: AbstractF16, mach: ScalarLike, elevator: ScalarLike, alpha: Array, x_cg: Array) -> Array:
    at_alpha = jax.vmap(lambda x, a: pitching_moment(airframe, mach, elevator, a, x), (None, 0))
    return jax.vmap(at_alpha, (0, None))(x_cg, alpha)


@compiled
def _follow(
    airframe: AbstractF16, mach: ScalarLike, elevator: ScalarLike, alpha: ScalarLike, x_cg: ScalarLike, steps: Array
) -> PitchBranch:
    return jax.vmap(lambda step: follow_pitch_trim(airframe, mach, elevator, alpha, x_cg, step, _POINTS))(steps)


@compiled
def _descents(
    airframe: AbstractF16, environment: Environment, altitude: ScalarLike, elevator: ScalarLike, alpha: Array
) -> SteadyDescent:
    atmosphere, gravity = environment.atmosphere, environment.gravity
    return jax.vmap(lambda a: steady_descent(airframe, atmosphere, gravity, altitude, elevator, a))(alpha)


def deep_stall(
    variant: str = "tp1538",
    *,
    x_cg_over_c: Sequence[float] = CENTRES_OF_GRAVITY,
    elevator_deg: float | None = None,
    alpha_from_deg: float = 20.0,
    mach: float = 0.2,
    altitude_m: float = 5000.0,
) -> xr.Dataset:
    """Compute the deep stalls of the F-16: pitch trims (Cm = 0) at high alpha with a fixed elevator.

    Sideslip and body rates are 0; the flap follows its schedule. The trims form a curve of alpha over centre of
    gravity, which is followed from the stable trim at the rearmost of `x_cg_over_c`. At the fold of the curve, a stable
    and an unstable trim merge: the foremost centre of gravity with a deep stall.

    Raises ValueError if the deflection is beyond the stops, the data do not contain `alpha_from_deg`, or `x_cg_over_c`
    is empty.

    Parameters
    ----------
    variant
        Variant of the F-16.
    x_cg_over_c
        Centres of gravity, fractions of the mean chord.
    elevator_deg
        Fixed deflection of the elevator; None: fully nose-down.
    alpha_from_deg
        Least angle of attack at which trims are searched.
    mach
        Mach number for the flap's schedule.
    altitude_m
        Altitude of the steady descents.

    Returns
    -------
    xr.Dataset
        - over (x_cg, alpha): `pitching_moment`, the coefficient Cm
        - over (point), the curve of trims: `branch_alpha` (deg), `branch_x_cg`, `branch_slope` (dCm/dalpha, 1/rad);
          a single NaN if no trim is stable
        - over (trim), the trims at `x_cg_over_c`: `trim_alpha` (deg), `trim_x_cg`, `trim_stable`
        - over (trim), the steady descents in the trims: `trim_speed` (m/s), `trim_path_angle`, `trim_pitch` (deg)
    """
    enable_compilation_cache()
    airframe, environment = cast(AbstractF16, load_airframe("f16", variant)), standard_environment()
    elevator_max = float(airframe.actuators.upper[0])
    elevator = elevator_max if elevator_deg is None else elevator_deg * DEG_RAD
    if not float(airframe.actuators.lower[0]) - 1e-9 <= elevator <= elevator_max + 1e-9:
        raise ValueError(
            f"elevator_deg: arrived {elevator_deg:g}; the surface moves by {elevator_max * RAD_DEG:g} deg at most"
        )
    low, high = (float(x) * RAD_DEG for x in airframe.alpha_range)
    if not low <= alpha_from_deg < high:
        raise ValueError(f"alpha_from_deg: arrived {alpha_from_deg:g}; the data go from {low:g} to {high:g} deg")
    centres = np.sort(np.asarray(x_cg_over_c, dtype=float))
    if not centres.size:
        raise ValueError("x_cg_over_c: arrived no centre of gravity; expected one at least")
    alphas = np.arange(alpha_from_deg, high + 1e-9, _GRID_DEG)
    case = (airframe, jnp.asarray(mach, dtype=float), jnp.asarray(elevator, dtype=float))
    moments = np.asarray(_curves(*case, jnp.asarray(alphas * DEG_RAD), jnp.asarray(centres)))
    trims = [(x, *trim) for x, curve in zip(centres, moments, strict=True) for trim in _roots(alphas, curve)]
    branch = _branch(case, [trim for trim in trims if trim[0] == centres[-1]], (alpha_from_deg, high), centres[-1])
    trim_x_cg, trim_alphas, trim_stable = np.array(trims).reshape(-1, 3).T
    descents = SteadyDescent(*jnp.zeros((3, 0)))
    if trims:
        descent_alphas = jnp.asarray(trim_alphas * DEG_RAD)
        altitude = jnp.asarray(altitude_m, dtype=float)
        descents = jax.tree.map(np.asarray, _descents(airframe, environment, altitude, case[2], descent_alphas))
    variables = (
        ("pitching_moment", ("x_cg", "alpha"), moments, "1", "pitching moment coefficient"),
        ("branch_alpha", "point", branch.alpha * RAD_DEG, "deg", "angle of attack"),
        ("branch_x_cg", "point", branch.x_cg, "1", "centre of gravity"),
        ("branch_slope", "point", branch.slope, "rad-1", "slope of Cm against alpha"),
        ("trim_alpha", "trim", trim_alphas, "deg", "angle of attack"),
        ("trim_x_cg", "trim", trim_x_cg, "1", "centre of gravity"),
        ("trim_stable", "trim", trim_stable.astype(int), "", "stable in pitch"),
        ("trim_speed", "trim", descents.speed, "m s-1", "true airspeed of the steady descent"),
        ("trim_path_angle", "trim", descents.path_angle * RAD_DEG, "deg", "path angle"),
        ("trim_pitch", "trim", descents.pitch * RAD_DEG, "deg", "pitch angle"),
        ("x_cg", "x_cg", centres, "1", "centre of gravity"),
        ("alpha", "alpha", alphas, "deg", "angle of attack"),
    )
    return xr.Dataset(
        {
            name: (dimensions, values, unit_attributes(unit, long_name))
            for name, dimensions, values, unit, long_name in variables
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


_TRIM_KEYS = {
    "x_cg_over_c": "trim_x_cg",
    "alpha_deg": "trim_alpha",
    "stable": "trim_stable",
    "speed_m_s": "trim_speed",
    "path_angle_deg": "trim_path_angle",
    "pitch_deg": "trim_pitch",
}
"""Key of a trim in the JSON document, and the variable of the dataset."""


def deep_stall_document(dataset: xr.Dataset) -> dict[str, Any]:
    """Return the dataset of `deep_stall` as plain data for JSON, with the greatest pitching moment at each x_cg.

    The entry `appears` is the result of `deep_stall_onset`.
    """
    onset = deep_stall_onset(dataset)
    return {
        "format_version": 1,
        **{key: dataset.attrs[key] for key in ("aircraft", "variant", "elevator_deg", "mach", "altitude_m")},
        "greatest_pitching_moment": [
            {
                "x_cg_over_c": float(x),
                "pitching_moment": float(curve.max()),
                "alpha_deg": float(dataset["alpha"][curve.argmax()]),
            }
            for x, curve in zip(dataset["x_cg"].values, dataset["pitching_moment"].values, strict=True)
        ],
        "trims": [
            {key: dataset[name].values[k].item() for key, name in _TRIM_KEYS.items()}
            | {"stable": bool(dataset["trim_stable"][k])}
            for k in range(dataset.sizes["trim"])
        ],
        "appears": None if onset is None else {"x_cg_over_c": onset[0], "alpha_deg": onset[1]},
    }


def deep_stall_onset(dataset: xr.Dataset) -> tuple[float, float] | None:
    """Return the foremost centre of gravity with a deep stall (fraction of the mean chord), and the alpha there, deg.

    The result is None if the dataset of `deep_stall` has no curve of trims, or the curve ends before its fold.
    """
    x_cg = dataset["branch_x_cg"].values
    finite = np.flatnonzero(np.isfinite(x_cg))
    if not finite.size:
        return None
    foremost = int(np.nanargmin(x_cg))
    if foremost in (finite[0], finite[-1]):
        return None
    return float(x_cg[foremost]), float(dataset["branch_alpha"][foremost])


def _roots(alphas: np.ndarray, moments: np.ndarray) -> list[tuple[float, bool]]:
    """Return the angles of attack (deg) with zero pitching moment, each with a flag: True if the trim is stable."""
    signs, last = np.sign(moments), len(moments) - 1
    roots = []
    for k, (alpha, moment) in enumerate(zip(alphas, moments, strict=True)):
        if moment == 0.0:
            roots.append((float(alpha), bool(moments[min(k + 1, last)] < moments[max(k - 1, 0)])))
        elif k < last and signs[k] * signs[k + 1] < 0.0:
            share = moment / (moment - moments[k + 1])
            roots.append((float(alpha + (alphas[k + 1] - alpha) * share), bool(moments[k + 1] < moment)))
    return roots


def _branch(
    case: tuple[Any, Any, Any],
    trims: Sequence[tuple[float, float, bool]],
    alpha_range_deg: tuple[float, float],
    x_cg_max: float,
) -> PitchBranch:
    """Return the curve of trims through the stable trim with the greatest alpha; one NaN point if no trim is stable.

    `case`: airframe, Mach number, elevator (rad); `trims`: x_cg, alpha (deg), True if stable. The curve ends before
    alpha leaves `alpha_range_deg`, x_cg leaves 0.1 to `x_cg_max`, or a point is not balanced.
    """
    stable = [trim for trim in trims if trim[2]]
    if not stable:
        missing = jnp.full(1, jnp.nan)
        return PitchBranch(missing, missing, missing, jnp.zeros(1, bool))
    x_cg, alpha, _ = stable[-1]
    steps = jnp.asarray([1.0, -1.0]) * _STEP_DEG * DEG_RAD
    branches = jax.tree.map(np.asarray, _follow(*case, jnp.asarray(alpha * DEG_RAD), jnp.asarray(x_cg), steps))
    low, high = (x * DEG_RAD for x in alpha_range_deg)
    parts = []
    for k in (0, 1):
        inside = branches.balanced[k] & (branches.alpha[k] >= low) & (branches.alpha[k] <= high)
        inside &= (branches.x_cg[k] <= x_cg_max + 1e-9) & (branches.x_cg[k] >= _X_CG_MIN)
        count = inside.size if inside.all() else int(np.argmin(inside))
        parts.append(jax.tree.map(lambda leaf, k=k, count=count: leaf[k][:count], branches))
    up, down = parts
    return jax.tree.map(lambda a, b: np.concatenate([a[:0:-1], b]), up, down)
