"""The published families of paths: bent sideways by b_4, and vertically by c_4."""

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr

from anser.compiling import compiled_quickly
from anser.planning import PathCommand, arc_length, arc_length_estimate, polar
from anser.results.variable_labels import converted, labels_of
from anser.shapes import Scalar, Vector3
from anser.variables import CATALOGUE, SHAPE_VARIABLES
from anser.verification.arc_lengths import DURATION_S, published_path
from anser.verification.published import published

_TIMES = 181  # every fifth of a second
_MEMBERS = 81
_SHAPES = ("lateral_shape", "vertical_shape")
_VARIABLES = {variable.key: variable for variable in (*CATALOGUE, *SHAPE_VARIABLES)}


def shape_families() -> dict[str, xr.Dataset]:
    """Paths of the published tables of lengths (theory section 6).

    Returns
    -------
    `b4` and `c4`: over `path` and `time`, where each path leads and what it asks of an aircraft that flies it at the
    published speeds; over `path`, its shape parameters, its length, that of the six-point rule and the printed one;
    the two computed lengths also over `member`, many more members of the family. All in the order of the parameter.
    """
    rows = published("arc_lengths")["rows"]
    lateral = {row[0] for row in rows if row[1]}  # the lateral family ends at another path angle
    families = {"b4": [row for row in rows if row[0] in lateral], "c4": [row for row in rows if row[0] not in lateral]}
    return {name: _dataset(sorted(family, key=lambda row: row[1:3])) for name, family in families.items()}


def _dataset(rows: list[list]) -> xr.Dataset:
    angle, lateral, vertical = (np.array(column) for column in list(zip(*rows, strict=True))[:3])
    time = np.linspace(0.0, DURATION_S, _TIMES)
    place, command, length, estimate = _paths(*map(jnp.asarray, (angle, lateral, vertical, time)))
    history = {
        "north": place[..., 0],
        "east": place[..., 1],
        "altitude": -place[..., 2],
        "airspeed_command": command.V,
        "path_angle_command": command.gamma,
        "course_command": command.chi,
        "lateral_shape": lateral,
        "vertical_shape": vertical,
        "final_path_angle": np.radians(angle),
        "length": length,
        "length_estimate": estimate,
        "length_published": np.array([float(row[3]) for row in rows]),
    }
    data = {
        _VARIABLES[key].name: (
            ("path", "time")[: np.ndim(values)],
            converted(_VARIABLES[key], np.asarray(values)),
            labels_of(_VARIABLES[key]),
        )
        for key, values in history.items()
    }
    parameters = {key: np.linspace(history[key][0], history[key][-1], _MEMBERS) for key in _SHAPES}
    _, _, length, estimate = _paths(
        jnp.full(_MEMBERS, angle[0]),
        jnp.asarray(parameters["lateral_shape"]),
        jnp.asarray(parameters["vertical_shape"]),
        jnp.asarray(time[:1]),
    )
    for key, values in (*parameters.items(), ("length", length), ("length_estimate", estimate)):
        data[f"member_{_VARIABLES[key].name}"] = (("member",), np.asarray(values), labels_of(_VARIABLES[key]))
    return xr.Dataset(data, {"time": ("time", time, {"units": "s", "long_name": "Time", "symbol": "t"})})


@compiled_quickly
def _paths(
    angles_deg: jax.Array, lateral: jax.Array, vertical: jax.Array, times: jax.Array
) -> tuple[jax.Array, PathCommand, jax.Array, jax.Array]:
    def one(angle_deg: Scalar, b_4: Scalar, c_4: Scalar) -> tuple[jax.Array, PathCommand, Scalar, Scalar]:
        path = published_path(angle_deg, b_4, c_4)

        def at(time: Scalar) -> tuple[Vector3, PathCommand]:
            return path.position_n(time), polar(path.velocity_n(time), path.acceleration_n(time))

        return *jax.vmap(at)(times), arc_length(path), arc_length_estimate(path)

    return jax.vmap(one)(angles_deg, lateral, vertical)
