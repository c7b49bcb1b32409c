"""Reading of wind fields from NetCDF files with CF conventions: pressure or altitude levels, axes in deg or m."""

import dataclasses
import functools
import hashlib
import itertools
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from anser.config.errors import Problem, ScenarioError, describe_value, os_error_reason
from anser.constants import STANDARD_GRAVITY_M_S2

if TYPE_CHECKING:
    import xarray as xr

_PATH = "wind.field"
_ALTITUDES = ("altitude", "height_above_mean_sea_level")
"""Names of geometric altitudes above mean sea level."""
_ALIASES: dict[str, tuple[str, ...]] = {
    "eastward": ("eastward_wind", "u", "x_wind"),
    "northward": ("northward_wind", "v", "y_wind"),
    "upward": ("upward_air_velocity", "w", "lagrangian_tendency_of_air_pressure", "omega"),
    "height": ("geopotential", "geopotential_height", "z", "gh", "zg", *_ALTITUDES),
    "time": ("time", "valid_time"),
    "member": ("realization", "number", "member"),
    "pressure": ("air_pressure", "pressure_level", "isobaricInhPa", "level", "plev"),
    "altitude": (*_ALTITUDES, "geopotential_height", "z"),
    "height above ground": ("height", "height_above_ground"),
    "latitude": ("latitude", "lat"),
    "longitude": ("longitude", "lon"),
    "north": ("north", "y", "projection_y_coordinate"),
    "east": ("east", "x", "projection_x_coordinate"),
}
"""Standard name (first) and usual names of the variables and coordinates of a file, by their role."""
_UNITS: dict[str, dict[str, float]] = {
    "velocity": dict.fromkeys(("m s-1", "m/s", "m s^-1", "m.s-1", "meter second-1", "meters per second"), 1.0),
    "pressure_rate": dict.fromkeys(("Pa s-1", "Pa/s", "Pa s^-1", "Pa.s-1"), 1.0),
    "geopotential": dict.fromkeys(("m2 s-2", "m^2 s^-2", "m2/s2", "J kg-1"), 1.0 / STANDARD_GRAVITY_M_S2),
    "length": dict.fromkeys(("m", "meter", "meters", "metre", "metres", "gpm"), 1.0),
    "pressure": {
        "Pa": 1.0,
        "pascal": 1.0,
        **dict.fromkeys(("hPa", "mbar", "mb", "millibar", "millibars", "hectopascal"), 100.0),
    },
    "angle": dict.fromkeys(
        ("degrees_north", "degree_north", "degrees_east", "degree_east", "degrees", "degree", "deg"), 1.0
    ),
    "time": {"s": 1.0, "second": 1.0, "seconds": 1.0, "min": 60.0, "minutes": 60.0, "h": 3600.0, "hours": 3600.0},
}
"""Units by quantity, with the factor to SI (geopotential: to geopotential metres; angles: degrees)."""
_GLOBE_DEG = 360.0


@dataclasses.dataclass(frozen=True, eq=False)
class WindField:
    """Wind of a file on a grid with rising coordinates, in float64."""

    epoch: np.datetime64 | None  #: Date and time (UTC) from which `times_s` count; None for times without a date.
    times_s: np.ndarray  #: Times of the file, s, at least one.
    north: np.ndarray  #: Latitudes, deg, or distances to the north, m, of the nodes.
    east: np.ndarray  #: Longitudes, deg (continuous), or distances to the east, m, of the nodes.
    is_geographic: bool  #: Whether the coordinates are latitude and longitude, not distances.
    #: Velocity of the air (north, east, down), m/s, and altitude of each level, lowest first, m; shape (member, time,
    #: north, east, level, 4).
    columns: np.ndarray
    is_geopotential: bool  #: Whether the altitudes are geopotential.

    @property
    def altitude_bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Least and greatest altitude of each level over all members, times and nodes, m: two arrays (level,)."""
        heights = self.columns[..., 3].reshape(-1, self.columns.shape[-2])
        return heights.min(axis=0), heights.max(axis=0)

    def around(self, longitude_deg: float) -> "WindField":
        """Return a global field, rearranged to begin and end at the meridian opposite to `longitude_deg`.

        A field in metres, or a field that does not span all longitudes, is returned unchanged.
        """
        gap_deg = _GLOBE_DEG - (self.east[-1] - self.east[0])
        if not self.is_geographic or gap_deg > 1.5 * np.max(np.diff(self.east)):
            return self
        meridians = self.east[self.east < self.east[0] + _GLOBE_DEG - 1e-6]  # the last ones may repeat the first
        first_deg = longitude_deg - 0.5 * _GLOBE_DEG
        east = first_deg + (meridians - first_deg) % _GLOBE_DEG
        order = np.argsort(east)
        closed = np.append(order, order[0])
        east = np.append(east[order], east[order[0]] + _GLOBE_DEG)
        return dataclasses.replace(self, east=east, columns=np.ascontiguousarray(self.columns[:, :, :, closed]))


def file_digest(path: Path) -> str:
    """Return the SHA-256 of a file, 64 hexadecimal digits; raises ScenarioError if the file cannot be read."""
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        problem = Problem(
            "", f"{describe_value(path.name)}: {os_error_reason(error)}", "a NetCDF file that can be read"
        )
        raise ScenarioError(str(path), [problem]) from None


def read_wind_field(path: str, digest: str) -> WindField:
    """Read the wind field of a NetCDF file whose SHA-256 (64 hexadecimal digits) is `digest`.

    Raises ScenarioError if the file cannot be read, has another SHA-256, or is not a wind field.
    """
    found_digest = file_digest(Path(path))
    if found_digest != digest:
        arrived = f"a file of another content (SHA-256 {found_digest[:12]}...)"
        raise _refusal(Path(path), arrived, f"the file that the scenario was made with (SHA-256 {digest[:12]}...)")
    return _read(path, digest)


@functools.lru_cache(maxsize=4)
def _read(path: str, _digest: str) -> WindField:
    import xarray as xr

    try:
        dataset = xr.open_dataset(path, engine="netcdf4", decode_timedelta=False)
    except (OSError, ValueError) as error:
        raise _refusal(Path(path), f"a file that cannot be read ({error})", "NetCDF with CF conventions") from None
    with dataset:
        return _Reader(Path(path), dataset.load()).field()


def _refusal(path: Path, arrived: str, expected: str) -> ScenarioError:
    return ScenarioError(str(path), [Problem(_PATH, f"{path.name} with {arrived}", expected)])


class _Reader:
    """Reader of one NetCDF file; raises ScenarioError if content is missing or irregular."""

    def __init__(self, path: Path, dataset: "xr.Dataset") -> None:
        self.path, self.dataset = path, dataset

    def field(self) -> WindField:
        """Return the wind field: velocities and altitudes on sorted axes, without missing values."""
        eastward, northward = self._variable("eastward"), self._variable("northward")
        is_geographic = self._find("latitude", self.dataset.coords) is not None
        horizontal = ("latitude", "longitude") if is_geographic else ("north", "east")
        vertical = "pressure" if self._find("pressure", eastward.coords) is not None else "altitude"
        roles = {role: self._find(role, eastward.coords) for role in ("member", "time", *horizontal, vertical)}
        above_ground = self._find("height above ground", eastward.coords)
        if roles[vertical] is None and above_ground in eastward.dims:
            arrived = f"the levels {above_ground}, read as heights above the ground"
            expected = 'altitudes above mean sea level, of standard_name "altitude" if the coordinate has another name'
            raise self._refuse(arrived, expected)
        for role in (*horizontal, vertical):
            if roles[role] is None or roles[role] not in eastward.dims:
                expected = f"a coordinate {role} ({', '.join(_ALIASES[role])}) along one dimension"
                raise self._refuse(f"{eastward.name} over ({', '.join(map(str, eastward.dims))})", expected)
        dims = [name for name in roles.values() if name is not None and name in eastward.dims]
        axes = {role: self._axis(name, role) for role, name in roles.items() if name in dims and role != "member"}

        def values(variable: "xr.DataArray", factor: float) -> np.ndarray:
            extra = [str(dim) for dim in variable.dims if dim not in dims]
            if any(variable.sizes[dim] > 1 for dim in extra):
                expected = "time, member, one vertical and two horizontal dimensions: a file with one of its entries"
                raise self._refuse(f"{variable.name} with the dimension {extra[0]}", expected)
            variable = variable.squeeze(extra, drop=True) if extra else variable
            missing_dims = [dim for dim in dims if dim not in variable.dims]
            variable = variable.expand_dims({dim: self.dataset.sizes[dim] for dim in missing_dims})
            array = factor * np.asarray(variable.transpose(*dims), dtype=float)
            absent = np.argwhere(~np.isfinite(array))
            if absent.size:
                place = ", ".join(f"{dim} {k}" for dim, k in zip(dims, absent[0], strict=True))
                raise self._refuse(f"{len(absent)} missing values of {variable.name}, first at {place}", "no gaps")
            return array

        u, v = (values(part, self._factor(part, "velocity")) for part in (eastward, northward))
        height, is_geopotential = self._heights(vertical, roles[vertical], axes[vertical], values, u.shape)
        upward = self._upward(vertical, roles[vertical], axes[vertical], values, height, dims)
        down = np.zeros_like(u) if upward is None else -upward
        columns = np.stack([v, u, down, height], axis=-1)
        if roles["member"] not in dims:
            columns = columns[None]
        if roles["time"] not in dims:
            columns = columns[:, None]
        return self._sorted(columns, axes, horizontal, is_geographic, is_geopotential)

    def _sorted(
        self,
        columns: np.ndarray,
        axes: Mapping[str, np.ndarray],
        horizontal: tuple[str, str],
        is_geographic: bool,
        is_geopotential: bool,
    ) -> WindField:
        """Return the field with rising axes and levels; raises ScenarioError if they have no order or one value.

        `columns` has the axes of `WindField.columns`, in the order of the file; `axes` has the coordinates by role;
        `horizontal` are the roles of the northward and the eastward axis.
        """
        times, epoch = axes.get("time", np.zeros(1)), None
        if np.issubdtype(times.dtype, np.datetime64):
            epoch = times[0]
            times = (times - epoch) / np.timedelta64(1, "s")
        coordinates = [times, *(axes[role] for role in horizontal)]
        if is_geographic:
            coordinates[2] = np.unwrap(coordinates[2], period=_GLOBE_DEG)
        for k, role in enumerate(("time", *horizontal)):
            values = coordinates[k]
            if values.size < 2 and role != "time":
                raise self._refuse(f"one {role}", f"two or more along {role}, between which the wind is interpolated")
            steps = np.diff(values)
            if not (np.all(steps > 0.0) or np.all(steps < 0.0)):
                raise self._refuse(f"a coordinate {role} that neither rises nor falls throughout", "a monotonic one")
            if steps.size and steps[0] < 0.0:
                coordinates[k], columns = values[::-1], np.flip(columns, axis=k + 1)
        heights = columns[..., 3]
        if heights.shape[-1] < 2:
            raise self._refuse("one level", "two levels or more, between which the wind is interpolated")
        if heights[0, 0, 0, 0, 0] > heights[0, 0, 0, 0, -1]:
            columns = np.flip(columns, axis=-2)
        if not np.all(np.diff(columns[..., 3], axis=-1) > 0.0):
            raise self._refuse(
                "levels whose altitudes do not rise from each to the next at every node", "rising levels"
            )
        times_s, north, east = coordinates
        columns = np.ascontiguousarray(columns)
        return WindField(epoch, times_s, north, east, is_geographic, columns, is_geopotential)

    def _heights(
        self,
        vertical: str,
        name: str | None,
        axis: np.ndarray,
        values: Callable[["xr.DataArray", float], np.ndarray],
        shape: tuple[int, ...],
    ) -> tuple[np.ndarray, bool]:
        """Return the altitude of every node and level, m, and whether it is geopotential.

        `vertical` is "pressure" or "altitude"; `name` and `axis` are name and values of this coordinate. `values`
        returns a variable times a factor as an array of the shape `shape`. Raises ScenarioError if pressure levels have
        no altitudes.
        """
        if vertical == "altitude":
            standard = self.dataset[name].attrs.get("standard_name") or name
            return np.broadcast_to(axis, shape), standard == "geopotential_height"
        height = self._find("height", self.dataset.data_vars)
        if height is None:
            above_ground = self._find("height above ground", self.dataset.data_vars)
            arrived = "alone" if above_ground is None else f"with {above_ground}, read as heights above the ground"
            expected = "a variable geopotential (z in m2 s-2), geopotential_height or altitude beside them"
            raise self._refuse(f"pressure levels ({name}) {arrived}", expected)
        variable = self.dataset[height]
        quantity = "geopotential" if self._units(variable) in _UNITS["geopotential"] else "length"
        is_geopotential = quantity == "geopotential" or variable.attrs.get("standard_name", height) not in _ALTITUDES
        return values(variable, self._factor(variable, quantity, "m2 s-2 or m")), is_geopotential

    def _upward(
        self,
        vertical: str,
        name: str | None,
        axis: np.ndarray,
        values: Callable[["xr.DataArray", float], np.ndarray],
        height: np.ndarray,
        dims: list[str],
    ) -> np.ndarray | None:
        """Return the vertical velocity of the air at nodes and levels, m/s, up positive; None if not in the file.

        `height` is the altitude of nodes and levels (m); `dims` names the axes of the arrays. For the other arguments,
        see `_heights`.
        """
        found = self._find("upward", self.dataset.data_vars)
        if found is None:
            return None
        variable = self.dataset[found]
        if self._units(variable) in _UNITS["velocity"]:
            return values(variable, 1.0)
        if vertical == "altitude":
            self._factor(variable, "velocity")
        omega = values(variable, self._factor(variable, "pressure_rate", "m s-1 or Pa s-1"))
        level, log_pressure = dims.index(str(name)), np.log(axis)
        if log_pressure.size < 2:
            return np.zeros_like(omega)
        # -omega / (rho g) with the hydrostatic balance rho g = -dp/dz
        thickness = np.gradient(height, log_pressure, axis=level, edge_order=1)
        pressure = np.expand_dims(axis, tuple(k for k in range(height.ndim) if k != level))
        return omega * thickness / pressure

    def _axis(self, name: str | None, role: str) -> np.ndarray:
        coordinate = self.dataset[name]
        if coordinate.ndim != 1:
            expected = "one dimension: a grid that is regular in its coordinates, as cdo remapbil makes one"
            raise self._refuse(f"a coordinate {name} of {coordinate.ndim} dimensions", expected)
        values = np.asarray(coordinate)
        if role == "time":
            if np.issubdtype(values.dtype, np.datetime64):
                return values
            if values.dtype == object:
                raise self._refuse(f"{name} in the calendar {coordinate.dt.calendar}", "the standard calendar")
        quantity = {"latitude": "angle", "longitude": "angle", "pressure": "pressure", "time": "time"}.get(
            role, "length"
        )
        array = self._factor(coordinate, quantity) * np.asarray(values, dtype=float)
        if not np.all(np.isfinite(array)):
            raise self._refuse(f"missing values of the coordinate {name}", "a number at every node")
        if role == "latitude" and np.max(np.abs(array)) > 90.0:
            arrived = f"latitudes from {np.min(array):g} to {np.max(array):g} deg"
            raise self._refuse(arrived, "latitudes within -90 to 90 deg")
        if role == "altitude" and coordinate.attrs.get("positive", "up") != "up":
            raise self._refuse(f"{name} that is positive {coordinate.attrs['positive']}", "altitudes, positive up")
        return array

    def _variable(self, role: str) -> "xr.DataArray":
        name = self._find(role, self.dataset.data_vars)
        if name is None:
            present = ", ".join(map(str, self.dataset.data_vars)) or "none"
            raise self._refuse(f"the variables {present}", f"one of standard_name {_ALIASES[role][0]}")
        return self.dataset[name]

    def _find(self, role: str, variables: Mapping[Any, "xr.DataArray"] | Iterable[Any]) -> str | None:
        """Return the name of the variable or coordinate of a role (key of `_ALIASES`); None if `variables` has none.

        A standard name has precedence over a variable's name. A variable whose standard name belongs to another role is
        not returned.
        """
        standard_names = {str(name): str(self.dataset[name].attrs.get("standard_name")) for name in variables}
        by_standard = {standard: name for name, standard in reversed(standard_names.items())}
        aliases = _ALIASES[role]
        foreign = set(itertools.chain.from_iterable(_ALIASES.values())) - set(aliases)
        named = [alias for alias in aliases if alias in standard_names and standard_names[alias] not in foreign]
        candidates = [*map(by_standard.get, aliases), *named]
        return next((name for name in candidates if name is not None), None)

    def _units(self, variable: "xr.DataArray") -> str:
        return str(variable.attrs.get("units", "")).replace("**", "").strip()

    def _factor(self, variable: "xr.DataArray", quantity: str, expected: str = "") -> float:
        units, accepted = self._units(variable), _UNITS[quantity]
        if units not in accepted:
            arrived = f"{variable.name} in {variable.attrs['units']!r}" if units else f"{variable.name} without units"
            raise self._refuse(arrived, f"units {expected or repr(next(iter(accepted)))}")
        return accepted[units]

    def _refuse(self, arrived: str, expected: str) -> ScenarioError:
        return _refusal(self.path, arrived, expected)
