"""Conversion of a flight's history (SI units, radians) to a labelled dataset in the units of `anser.variables`."""

from collections.abc import Mapping, Sequence

import jax
import numpy as np
import xarray as xr
from jaxtyping import Array, Float

from anser.compiling.options import compiled
from anser.environment.air import (
    STANDARD_LAYERS,
    Layers,
    air_in_layers,
    altimeter_setting_in_layers,
    calibrated_from_true,
    density_altitude,
    equivalent_from_true,
    pressure_altitude,
)
from anser.numerics.arrays import as_array, bucket_size, pad_to_multiple
from anser.results.variable_labels import catalogue_attributes, record_coordinates, to_dataset_units
from anser.shapes import Scalar
from anser.spatial.wgs84 import geodetic_from_flat
from anser.variables import (
    OPTIONAL_KEYS,
    STANDARD_SURFACES,
    Variable,
    all_surface_names,
    catalogue,
    recorded_keys,
    surface_variables,
)

_BUCKET_ROWS = 4096  # rows are padded to 1, 2, 4, ... times this number, so that few sizes are compiled
_REFERENCE_KEYS = ("reference_latitude_deg", "reference_longitude_deg")


def to_dataset(
    time_s: np.ndarray,
    history: Mapping[str, np.ndarray],
    aircraft_names: Sequence[str],
    attributes: Mapping[str, str | int | float],
    surfaces: Sequence[Sequence[str]] = (),
    air_layers: Layers = STANDARD_LAYERS,
) -> xr.Dataset:
    """Convert a flight's history to an xarray dataset over (time, aircraft), with a variable for each key.

    Geodetic position, calibrated and equivalent airspeed, and pressure and density altitude are added.

    Parameters
    ----------
    time_s
        Times of the record, s, increasing; shape (time,).
    history
        Arrays (time, aircraft), SI units and radians: one for each key of `anser.variables.recorded_keys(surfaces)`,
        optionally also for `OPTIONAL_KEYS`. NaN for surfaces that an aircraft does not have.
    aircraft_names
        Unique names of the aircraft, in the order of the history's columns.
    attributes
        Attributes of the dataset, text or numbers. `reference_latitude_deg` and `reference_longitude_deg` must be the
        geodetic position of the origin of the NED axes, at altitude 0.
    surfaces
        Names of the control surfaces by aircraft; empty: `anser.variables.STANDARD_SURFACES` for every aircraft.
    air_layers
        Layers of the flight's air, see `anser.environment.air`.

    Returns
    -------
    xr.Dataset
        Variables with the attributes `units`, `frame`, `long_name` and `symbol`. Angles are in (-180, 180] deg;
        latitude and longitude refer to the flat Earth of theory section 1. The dataset has the additional attributes
        `surfaces` (see `surface_names`) and `qnh_hpa`, the altimeter setting. The variables of a surface that some
        aircraft do not have say so in the attribute `comment`.

    Raises
    ------
    ValueError
        If a key is unknown or missing, a shape is wrong, time does not increase, a name is repeated, the geodetic
        reference is missing, or the surfaces do not match the aircraft.
    TypeError
        If a number type cannot be cast to the type of the catalogue, or an attribute is neither text nor number.
    """
    time = np.asarray(time_s, dtype=np.float64)
    if time.ndim != 1 or time.size == 0 or not np.all(np.isfinite(time)) or np.any(np.diff(time) <= 0):
        raise ValueError(f"time_s must be one finite increasing row of times in s, not shape {time.shape}: {time}")
    names = list(aircraft_names)
    if len(set(names)) != len(names) or not names:
        raise ValueError(f"aircraft_names must be given, each once, not {names}")
    if surfaces and len(surfaces) != len(names):
        raise ValueError(f"surfaces are those of {len(surfaces)} aircraft; there are {len(names)}")
    all_surfaces = all_surface_names(surfaces) or STANDARD_SURFACES
    _check_keys(history, all_surfaces)
    _check_attributes(attributes)

    variables, shape = catalogue(all_surfaces), (time.size, len(names))
    arrays = {v.key: _check_values(v, history[v.key], shape) for v in variables if v.key in history}
    arrays["latitude"], arrays["longitude"] = _geodetic(
        arrays, *(np.radians(attributes[key]) for key in _REFERENCE_KEYS)
    )
    arrays |= air_variables(arrays["airspeed"], arrays["altitude"], air_layers)
    recorded = [v for v in variables if v.key in arrays]
    data = {
        v.name: (("time", "aircraft"), to_dataset_units(v, arrays[v.key]), catalogue_attributes(v)) for v in recorded
    }
    for v in surface_variables(name for name in all_surfaces if any(name not in group for group in surfaces)):
        data[v.name][2]["comment"] = "NaN for an aircraft without this surface"
    return xr.Dataset(
        data,
        record_coordinates(time, names),
        {**attributes, **qnh_attributes(air_layers), "surfaces": " ".join(all_surfaces)},
    )


def air_variables(airspeed: np.ndarray, altitude: np.ndarray, layers: Layers) -> dict[str, np.ndarray]:
    """Compute airspeeds (m/s) and altitudes (m) that depend on the air, by key of `anser.variables`.

    The results are calibrated and equivalent airspeed, and pressure and density altitude, with the shape of the true
    airspeed `airspeed` (m/s) and the geometric altitude `altitude` (m). `layers` is the flight's air, see
    `anser.environment.air`.
    """
    with np.errstate(all="ignore"):  # the motion of a lost aircraft is not finite
        air = air_in_layers(layers, np.asarray(altitude, dtype=float))
        speed = np.asarray(airspeed, dtype=float)
        return {
            "airspeed_calibrated": np.asarray(calibrated_from_true(speed, air)),
            "airspeed_equivalent": np.asarray(equivalent_from_true(speed, air)),
            "pressure_altitude": pressure_altitude(air.pressure),
            "density_altitude": density_altitude(air.density),
        }


def qnh_attributes(layers: Layers) -> dict[str, float]:
    """Return the altimeter setting (QNH) of a flight's air, hPa, as the dataset attribute `qnh_hpa`."""
    return {"qnh_hpa": altimeter_setting_in_layers(layers) / 100.0}


def surface_names(dataset: xr.Dataset) -> tuple[str, ...]:
    """Return the names of the control surfaces in a dataset, from the attribute `surfaces` (separated by blanks).

    A dataset of an older version, without the attribute, has the standard surfaces elevator, aileron and rudder.
    """
    return tuple(str(dataset.attrs.get("surfaces", " ".join(STANDARD_SURFACES))).split())


def value_range(values: xr.DataArray) -> tuple[float, float, float, float]:
    """Return first, last, least and greatest value of a variable over time; NaN values are not skipped."""
    numbers = values.values
    return float(numbers[0]), float(numbers[-1]), float(numbers.min()), float(numbers.max())


def _check_keys(history: Mapping[str, np.ndarray], surfaces: Sequence[str]) -> None:
    required = set(recorded_keys(surfaces))
    unknown = sorted(set(history) - required - OPTIONAL_KEYS)
    missing = sorted(required - set(history))
    if unknown or missing:
        raise ValueError(
            f"the history does not match the catalogue in anser.variables: unknown keys {unknown}, "
            f"missing keys {missing}; with the surfaces {', '.join(surfaces)} it must have every key of "
            "recorded_keys(surfaces), may have OPTIONAL_KEYS, and no other"
        )


def _check_attributes(attributes: Mapping[str, str | int | float]) -> None:
    for key, value in attributes.items():
        if isinstance(value, bool) or not isinstance(value, str | int | float | np.integer | np.floating):
            raise TypeError(f"attribute {key} must be text or a number, not {value!r}")
    missing = [key for key in _REFERENCE_KEYS if key not in attributes]
    if missing:
        raise ValueError(f"attributes must hold {' and '.join(missing)}, the geodetic place of the NED origin, in deg")


def _check_values(variable: Variable, values: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    array = np.asarray(values)
    if array.shape != shape:
        raise ValueError(f"{variable.key} has shape {array.shape}; (time, aircraft) is {shape}")
    if not np.can_cast(array.dtype, variable.dtype, casting="same_kind"):
        raise TypeError(f"{variable.key} holds {array.dtype} numbers; the catalogue says {variable.dtype}")
    return array.astype(variable.dtype)


def _geodetic(arrays: Mapping[str, np.ndarray], latitude: float, longitude: float) -> tuple[np.ndarray, np.ndarray]:
    positions = np.stack([arrays["north"], arrays["east"], -np.asarray(arrays["altitude"])], axis=-1)
    points = positions.reshape(-1, 3)
    padded = pad_to_multiple(points, bucket_size(len(points), _BUCKET_ROWS)) if len(points) else points
    coordinates = _geodetic_positions(as_array(padded), as_array(latitude), as_array(longitude))[:2]
    grids = [np.asarray(coordinate)[: len(points)].reshape(positions.shape[:2]) for coordinate in coordinates]
    return grids[0], grids[1]


@compiled
def _geodetic_positions(
    positions_n: Float[Array, "rows 3"], latitude: Scalar, longitude: Scalar
) -> tuple[Float[Array, " rows"], Float[Array, " rows"], Float[Array, " rows"]]:
    return jax.vmap(lambda position: geodetic_from_flat(position, latitude, longitude, 0.0))(positions_n)
