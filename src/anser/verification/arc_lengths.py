"""Lengths of polynomial trajectories against the published ones."""

import math

import jax
import jax.numpy as jnp

from anser.planning import Trajectory, arc_length_estimate, fit_trajectory
from anser.shapes import Scalar, ScalarLike
from anser.units import DEG_RAD
from anser.verification.check import Check, Comparison
from anser.verification.published import as_printed, published

_SPEED_M_S = 150.0
DURATION_S = 36.0
"""Of every path of the published families."""


def published_path(final_path_angle_deg: ScalarLike, b_4: ScalarLike = 0.0, c_4: ScalarLike = 0.0) -> Trajectory:
    """Trajectory of the published lengths (theory section 6).

    Parameters
    ----------
    final_path_angle_deg
        Climb angle at the end, deg.
    b_4, c_4
        Lateral and vertical shape parameters, m/s^4.

    Returns
    -------
    t in [0, 36] s from N 0, E 0, 2000 m to N 5000 m, E 0, 0 m, 150 m/s and due North at both ends, level at the start.
    """
    final = jnp.asarray(final_path_angle_deg) * DEG_RAD
    return fit_trajectory(
        0.0,
        DURATION_S,
        jnp.array([0.0, 0.0, -2000.0]),
        jnp.array([_SPEED_M_S, 0.0, 0.0]),
        jnp.array([5000.0, 0.0, 0.0]),
        _SPEED_M_S * jnp.stack([jnp.cos(final), jnp.zeros(()), -jnp.sin(final)]),
        b_4 * DURATION_S**4,
        c_4 * DURATION_S**4,
    )


@jax.jit
@jax.vmap
def _estimate(final_path_angle_deg: Scalar, b_4: Scalar, c_4: Scalar) -> Scalar:
    return arc_length_estimate(published_path(final_path_angle_deg, b_4, c_4))


def _measure() -> tuple[Comparison, ...]:
    rows = published("arc_lengths")["rows"]
    lengths = _estimate(*jnp.array([row[:3] for row in rows]).T)
    return tuple(
        as_printed(
            "lateral" if math.isclose(angle, -30.0) else "vertical",
            f"gamma_f {angle:g} deg, b_4 {b_4:g}, c_4 {c_4:g}",
            "m",
            printed,
            length,
        )
        for (angle, b_4, c_4, printed), length in zip(rows, lengths, strict=True)
    )


ARC_LENGTHS = Check(
    key="arc-lengths",
    title="Six-point arc lengths of the polynomial trajectories",
    source="[TH] tables of path lengths",
    why="half the last digit",
    explanation=(
        "Five paths bent sideways by b_4 and five bent vertically by c_4, of 36 s each. The length is the published "
        "six-point estimate itself, not the exact length: the rule misses the most bent of these by up to 1.5 "
        "percent, and anser plans with a Gauss-Legendre rule instead. Corrected misprints: the rule's factor (t_f - "
        "t_0), the term 4 c_4 t^3 of the vertical speed, and the final path angle of the lateral lengths, which is "
        "-30 deg and not the -21.8 deg of the table of boundary conditions."
    ),
    measure=_measure,
)
