"""Where an aircraft pitches no further down: deep-stall trims over the centre of gravity, found and followed."""

from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr

from anser.compiling import compiled, enable_compilation_cache
from anser.environment import standard_environment
from anser.results.provenance import version_attributes
from anser.scenario import load_airframe
from anser.simulation import PitchBranch, follow_pitch_trim, pitching_moment, steady_descent
from anser.units import DEG_RAD, RAD_DEG

CENTRES = (0.30, 0.35, 0.365, 0.38, 0.40)
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
    x_cg_over_c: Sequence[float] = CENTRES,
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
    onset = first_stable(found)
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


def first_stable(found: xr.Dataset) -> tuple[float, float] | None:
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
