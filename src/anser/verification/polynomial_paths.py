"""Verification of polynomial trajectories by published arc lengths, and the published families of paths as datasets.

The families are bent sideways by the shape parameter b_4 and vertically by c_4 (theory section 6).
"""

import math
from collections.abc import Iterator

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr

from anser.compiling.options import compiled_quickly
from anser.parts.paths import PathCommand, polar
from anser.planning.published.trajectory import Trajectory, arc_length, arc_length_estimate, fit_trajectory
from anser.results.variable_labels import catalogue_attributes, to_dataset_units
from anser.shapes import Scalar, ScalarLike, Vector3
from anser.spatial.rotations import safe_norm
from anser.units import DEG_RAD
from anser.variables import CATALOGUE, SHAPE_VARIABLES
from anser.verification.checks import Comparison, compare_as_printed, load_published, make_check

_SPEED_M_S = 150.0
DURATION_S = 36.0
"""Duration of each path of the published families, s."""
_SAMPLES = 3601
_ERROR_BOUND_PERCENT = 1.3


def published_path(final_path_angle_deg: ScalarLike, b_4: ScalarLike = 0.0, c_4: ScalarLike = 0.0) -> Trajectory:
    """Return the path of the published tables of arc lengths with the shape parameters b_4 and c_4, m/s^4.

    The path (theory section 6) leads in 36 s from N 0, E 0, altitude 2000 m to N 5000 m, E 0, altitude 0. The velocity
    is 150 m/s due North at both ends. The path angle is 0 at the start and `final_path_angle_deg` at the end.
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
def _lengths(final_path_angle_deg: Scalar, b_4: Scalar, c_4: Scalar) -> tuple[Scalar, Scalar, Scalar]:
    """Return the length of `published_path`, m, by three rules: six points, sum of speeds times step, trapezoids."""
    path = published_path(final_path_angle_deg, b_4, c_4)
    times = jnp.linspace(0.0, DURATION_S, _SAMPLES)
    speeds = jax.vmap(lambda time: safe_norm(path.at(time).velocity_n))(times)
    step = DURATION_S / (_SAMPLES - 1)
    summed = step * jnp.sum(speeds)
    return arc_length_estimate(path), summed, summed - step * (speeds[0] + speeds[-1]) / 2


def _measure() -> Iterator[Comparison]:
    published_rows = load_published("arc_lengths")["rows"]
    parameters = jnp.array([published_row[:3] for published_row in published_rows]).T
    estimates, sums, lengths = map(np.asarray, _lengths(*parameters))
    for (angle, b_4, c_4, estimate, length), *computed in zip(published_rows, estimates, sums, strict=True):
        family = "lateral" if math.isclose(angle, -30.0) else "vertical"
        point = f"gamma_f {angle:g} deg, b_4 {b_4:g}, c_4 {c_4:g}"
        yield compare_as_printed(f"{family}, six-point estimate", point, "m", estimate, computed[0])
        yield compare_as_printed(f"{family}, sum of 3,601 speeds", point, "m", length, computed[1])
    worst, reason = float(np.max(100.0 * np.abs(estimates / lengths - 1.0))), "printed bound"
    figures = 0.0, worst, _ERROR_BOUND_PERCENT
    yield Comparison("error of the estimate", "greatest of the ten", "%", *figures, tolerance_reason=reason)


ARC_LENGTHS = make_check("arc-lengths", _measure)


_TIMES = 181
"""Number of samples of a path in a dataset: five per second."""
_MEMBERS = 81
_SHAPES = ("lateral_shape", "vertical_shape")
_VARIABLES = {variable.key: variable for variable in (*CATALOGUE, *SHAPE_VARIABLES)}


def shape_families() -> dict[str, xr.Dataset]:
    """Return the published families of paths (theory section 6), one dataset per shape parameter: `b4` and `c4`.

    - Variables over `path` and `time`: the path, and the commands of an aircraft at the published speeds.
    - Variables over `path`: shape parameter, length, estimate by the six-point rule, and printed length.
    - Variables over `member`: shape parameters, length and estimate of many more paths of the family.

    Paths and members are sorted by the parameter.
    """
    published_rows = load_published("arc_lengths")["rows"]
    # The lateral family ends at another path angle.
    lateral_angles = {angle for angle, b_4, *_ in published_rows if b_4}
    families = {"b4": [], "c4": []}
    for published_row in published_rows:
        families["b4" if published_row[0] in lateral_angles else "c4"].append(published_row)
    return {
        name: _dataset(sorted(family, key=lambda published_row: published_row[1:3]))
        for name, family in families.items()
    }


def _dataset(published_rows: list[list]) -> xr.Dataset:
    angle, lateral, vertical = (np.array(column) for column in list(zip(*published_rows, strict=True))[:3])
    time = np.linspace(0.0, DURATION_S, _TIMES)
    positions_n, command, length, estimate = _paths(*map(jnp.asarray, (angle, lateral, vertical, time)))
    history = {
        "north": positions_n[..., 0],
        "east": positions_n[..., 1],
        "altitude": -positions_n[..., 2],
        "airspeed_command": command.V,
        "path_angle_command": command.gamma,
        "course_command": command.chi,
        "lateral_shape": lateral,
        "vertical_shape": vertical,
        "final_path_angle": np.radians(angle),
        "length": length,
        "length_estimate": estimate,
        "length_published": np.array([float(published_row[3]) for published_row in published_rows]),
    }
    data = {
        _VARIABLES[key].name: (
            ("path", "time")[: np.ndim(values)],
            to_dataset_units(_VARIABLES[key], np.asarray(values)),
            catalogue_attributes(_VARIABLES[key]),
        )
        for key, values in history.items()
    }
    parameters = {key: np.linspace(history[key][0], history[key][-1], _MEMBERS) for key in _SHAPES}
    lateral, vertical = (jnp.asarray(parameters[key]) for key in _SHAPES)
    _, _, length, estimate = _paths(jnp.full(_MEMBERS, angle[0]), lateral, vertical, jnp.asarray(time[:1]))
    for key, values in (*parameters.items(), ("length", length), ("length_estimate", estimate)):
        variable = _VARIABLES[key]
        data[f"member_{variable.name}"] = (("member",), np.asarray(values), catalogue_attributes(variable))
    return xr.Dataset(data, {"time": ("time", time, {"units": "s", "long_name": "Time", "symbol": "t"})})


@compiled_quickly
def _paths(
    angles_deg: jax.Array, lateral: jax.Array, vertical: jax.Array, times: jax.Array
) -> tuple[jax.Array, PathCommand, jax.Array, jax.Array]:
    def sample_path(angle_deg: Scalar, b_4: Scalar, c_4: Scalar) -> tuple[jax.Array, PathCommand, Scalar, Scalar]:
        path = published_path(angle_deg, b_4, c_4)

        def sample(time: Scalar) -> tuple[Vector3, PathCommand]:
            return path.position_n(time), polar(path.velocity_n(time), path.acceleration_n(time))

        return *jax.vmap(sample)(times), arc_length(path), arc_length_estimate(path)

    return jax.vmap(sample_path)(angles_deg, lateral, vertical)
