"""Performance sheet of an aircraft: stall, level flight, climb, ceiling, glide, turns, and specific excess power."""

import dataclasses
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from jaxtyping import Array, Float

from anser.aircraft.airframe import AbstractAirframe
from anser.aircraft.f16 import AbstractF16
from anser.aircraft.motion import air_data_and_forces
from anser.analysis.airframes import valid_airspeed_range
from anser.analysis.trim_points import airframe_label
from anser.compiling.options import compiled, enable_compilation_cache
from anser.environment.environment import Environment, standard_environment
from anser.numerics.arrays import as_array, pad_to_multiple, take_rows
from anser.results.documents import finite_or_none, notebook_table, version_attributes
from anser.results.variable_labels import unit_attributes
from anser.shapes import Integer, Scalar
from anser.steady.performance import path_acceleration
from anser.steady.trim import TRIM_OBSTACLES, TrimMapPoint, trim_map_point, trim_target
from anser.units import DEG_RAD, RAD_DEG

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_SPEEDS, _ALTITUDES = 41, 21
_ALTITUDE_MAX_M = 20_000.0
_F16_SPEEDS_M_S = (40.0, 400.0)
_LOAD_FACTOR_MAX, _TURN_GRID, _TURN_PASSES = 9.0, 9, 4
_STALLS = {"least level airspeed": 1.0} | {f"least level airspeed, mass {m:.0%}": m for m in (0.8, 0.9, 1.1, 1.2)}
_CLIMB_STEPS = 8
_CHUNK = 64  # number of points that are trimmed in one call
_SERVICE_CLIMB_M_S = 0.508  # climb rate that remains at the service ceiling: 100 ft/min
# least change of the angle of attack (rad) between neighbouring airspeeds that shows the greatest lift
_STALL_JUMP = 5.0 * DEG_RAD
_LIMITS = {  # text on a limit, by obstacle of a trim
    "tables": "end of the data (altitude or Mach number)",
    "no_balance": "no balance of forces and moments",
    "thrust_max": "full power",
    "thrust_idle": "idle power",
    "surfaces": "stop of a surface",
    "alpha": "angle of attack: end of the data",
    "beta": "sideslip: end of the data",
}


class _Points(NamedTuple):
    """Steady flights to be trimmed, an element each: airspeed (m/s), altitude (m), turn rate (rad/s), mass, power.

    The mass is relative to the airframe's mass. The power (percent) determines the climb angle; NaN: level flight.
    """

    speed: Float[Array, " point"]
    altitude: Float[Array, " point"]
    turn_rate: Float[Array, " point"]
    mass: Float[Array, " point"]
    power: Float[Array, " point"]


class _Flights(NamedTuple):
    """Trims of `_Points`, path angles (rad), and accelerations (thrust - drag) / mass at full power (m/s^2)."""

    trims: TrimMapPoint
    path_angle: Float[Array, " point"]
    acceleration: Float[Array, " point"]


@compiled
def _trim_points(
    airframe: AbstractAirframe, environment: Environment, points: _Points, climb_steps: Integer
) -> _Flights:
    def trim_point(point: _Points) -> _Flights:
        heavier = eqx.tree_at(lambda a: a.mass_properties.mass, airframe, airframe.mass_properties.mass * point.mass)
        is_level = jnp.isnan(point.power)
        power = jnp.where(is_level, 0.0, point.power)

        def fly(path_angle: Scalar) -> tuple[TrimMapPoint, Scalar, Scalar]:
            target = trim_target(point.speed, point.altitude, path_angle, 0.0, point.turn_rate)
            flight = trim_map_point(heavier, environment, target)
            condition = air_data_and_forces(heavier, environment, 0.0, flight.trim.state)
            # accelerations along the path, gravity excluded, that a climb uses up
            surplus, full = (path_acceleration(heavier, condition, p) for p in (power, 100.0))
            return flight, surplus, full

        def climb(_: Any, path_angle: Scalar) -> Scalar:
            sine = jnp.clip(fly(path_angle)[1] / environment.gravity, -0.98, 0.98)
            return jnp.where(is_level, 0.0, jnp.arcsin(sine))

        path_angle = jax.lax.fori_loop(0, climb_steps, climb, jnp.zeros_like(point.speed))
        flight, _, full = fly(path_angle)
        return _Flights(flight, path_angle, full)

    return jax.vmap(trim_point)(points)


@dataclasses.dataclass(frozen=True)
class PerformanceFigure:
    """A figure of a performance sheet: name, value (NaN: no such flight), unit, and limit that determines the value."""

    name: str
    value: float
    unit: str
    limit: str = ""


@dataclasses.dataclass(frozen=True, repr=False)
class PerformanceSheet:
    """Performance of an aircraft in the standard atmosphere and still air; prints as a table of `figures`."""

    #: Figures at `altitude_m`: least airspeed of level flight (stall) for five masses, greatest level airspeed, best
    #: climb rate and glide ratio with their airspeeds, best sustained turns; and the ceilings.
    figures: tuple[PerformanceFigure, ...]
    #: Specific excess power (m/s) at full power in level flight, and Mach number, over altitude (m) and true airspeed
    #: (m/s); NaN where level flight is impossible for a reason other than power.
    dataset: xr.Dataset
    identity: Mapping[str, str | int | float]  #: Name of the aircraft, and variant if any.
    altitude_m: float  #: Altitude of the figures, m.

    def __getitem__(self, name: str) -> PerformanceFigure:
        """Return a figure by its name; raises KeyError if the name is unknown."""
        by_name = {figure.name: figure for figure in self.figures}
        if name not in by_name:
            raise KeyError(f"{name!r} is not on the sheet; the names are {', '.join(by_name)}")
        return by_name[name]

    @property
    def title(self) -> str:
        """Title of tables and figures: aircraft and altitude."""
        return f"{airframe_label(self.identity)}: performance at {self.altitude_m:g} m"

    def __repr__(self) -> str:
        widest = max(len(figure.name) for figure in self.figures)
        lines = (f"  {f.name:<{widest}}  {f.value:10.4g} {f.unit:<6} {f.limit}".rstrip() for f in self.figures)
        return "\n".join([self.title, *lines])

    def _repr_html_(self) -> str:
        cells = [{"figure": f.name, "value": f"{f.value:.4g}", "unit": f.unit, "limit": f.limit} for f in self.figures]
        return notebook_table(self.title, cells)

    def document(self) -> dict[str, Any]:
        """Return aircraft, altitude (m) and figures as plain data for JSON; value None: no such flight."""
        return {
            "format_version": 1,
            "aircraft": dict(self.identity),
            "altitude_m": self.altitude_m,
            "figures": [dataclasses.asdict(f) | {"value": finite_or_none(f.value)} for f in self.figures],
        }

    def plot(self) -> "Figure":
        """Return a figure of the specific excess power at full power over Mach number and altitude."""
        from anser.report.aircraft_flight import excess_power_figure

        title = f"{airframe_label(self.identity)}: specific excess power at full power"
        return excess_power_figure(self.dataset, title)


def performance_sheet(
    airframe: AbstractAirframe, identity: Mapping[str, str | int | float], altitude_m: float = 0.0
) -> PerformanceSheet:
    """Compute the performance of an aircraft at an altitude, and the ceilings, in the standard atmosphere, still air.

    `identity` is the description of the aircraft from `resolve_airframe`. Raises ValueError if the altitude is not
    within 0 to 20,000 m.
    """
    if not isinstance(altitude_m, int | float | np.number) or not 0.0 <= altitude_m <= _ALTITUDE_MAX_M:
        raise ValueError(f"altitude_m: arrived {altitude_m!r}; expected a number from 0 to {_ALTITUDE_MAX_M:g}")
    enable_compilation_cache()
    environment = standard_environment()
    gravity = float(environment.gravity)
    # the data of the F-16 have no limits of the airspeed: a wider range than the F-16 can fly
    slowest, fastest = _F16_SPEEDS_M_S if isinstance(airframe, AbstractF16) else valid_airspeed_range(airframe)
    # the ends themselves can round out of the data
    speeds = np.geomspace(slowest * (1.0 + 1e-9), fastest * (1.0 - 1e-9), _SPEEDS)
    altitudes = np.linspace(0.0, _ALTITUDE_MAX_M, _ALTITUDES)

    def fly(**columns: Any) -> _Flights:
        values = {"turn_rate": 0.0, "mass": 1.0, "power": np.nan, "altitude": altitude_m} | columns
        arrays = np.broadcast_arrays(*(np.asarray(values[name], dtype=float) for name in _Points._fields))
        points = pad_to_multiple(_Points(*(as_array(np.ravel(array)) for array in arrays)), _CHUNK)
        climb_steps = as_array(0 if np.isnan(values["power"]) else _CLIMB_STEPS, int)
        parts = [  # of one size, so that one program serves all
            _trim_points(airframe, environment, take_rows(points, slice(first, first + _CHUNK)), climb_steps)
            for first in range(0, arrays[0].size, _CHUNK)
        ]
        return jax.tree.map(lambda *leaves: np.concatenate(leaves)[: arrays[0].size], *parts)

    field = fly(speed=speeds[None, :], altitude=altitudes[:, None])
    dataset = _excess_power(field, speeds, altitudes, gravity).assign_attrs(identity, **version_attributes())
    figures = (
        *(PerformanceFigure(name, *_edge(fly, speeds, mass, lowest=True)) for name, mass in _STALLS.items()),
        PerformanceFigure("greatest level airspeed", *_edge(fly, speeds, 1.0, lowest=False)),
        *_path_figures(fly, speeds, 100.0, "best climb rate", "m/s"),
        *_path_figures(fly, speeds, 0.0, "best glide ratio", "1"),
        *_turn_figures(fly, speeds, gravity),
        PerformanceFigure("absolute ceiling", *_ceiling(dataset, 0.0)),
        PerformanceFigure("service ceiling", *_ceiling(dataset, _SERVICE_CLIMB_M_S)),
    )
    return PerformanceSheet(figures, dataset, dict(identity), float(altitude_m))


def _is_flyable(flights: _Flights, *, except_power: bool = False) -> np.ndarray:
    counted = [not (except_power and name in ("thrust_max", "thrust_idle")) for name in TRIM_OBSTACLES]
    return np.logical_not(np.asarray(flights.trims.obstacles)[:, counted].any(axis=-1))


def _limit_of(flights: _Flights, index: int) -> str:
    obstacles = np.asarray(flights.trims.obstacles)[index]
    return "; ".join(_LIMITS[name] for name, flag in zip(TRIM_OBSTACLES, obstacles, strict=True) if flag)


def _limit_beyond(flights: _Flights, inside: int, outside: int) -> str:
    """Return a text on the limit between two level flights (indices): `inside` is flyable, `outside` is not."""
    alpha = np.asarray(flights.trims.trim.alpha)
    # A jump of alpha shows the greatest lift: a trim at the neighbour lies far beyond the stall.
    is_stall = abs(alpha[outside] - alpha[inside]) > _STALL_JUMP
    return "greatest lift (stall)" if is_stall else _limit_of(flights, outside)


def _edge(fly: Any, speeds: np.ndarray, mass: float, *, lowest: bool) -> tuple[float, str, str]:
    """Return the least or the greatest airspeed of level flight (NaN: none), the unit, and a text on the limit there.

    `fly` trims flights from columns of `_Points`; `speeds` (m/s, rising) is the search range; `mass` is relative to the
    airframe's mass.
    """
    value, grid, limit = np.nan, speeds, "end of the data (airspeed)"
    for _ in range(2):  # a second grid between the last two airspeeds
        flights = fly(speed=grid, mass=mass)
        flyable = np.flatnonzero(_is_flyable(flights))
        if flyable.size == 0:
            return np.nan, "m/s", "no level flight"
        inside, outside = (flyable[0], flyable[0] - 1) if lowest else (flyable[-1], flyable[-1] + 1)
        value = float(grid[inside])
        if not 0 <= outside < grid.size:
            break
        limit = _limit_beyond(flights, int(inside), int(outside))
        grid = np.linspace(min(value, grid[outside]), max(value, grid[outside]), _SPEEDS)
    return value, "m/s", limit


def _path_figures(fly: Any, speeds: np.ndarray, power: float, name: str, unit: str) -> list[PerformanceFigure]:
    """Return two figures: best climb rate (m/s, `power` 100) or best glide ratio (`power` 0), and its airspeed.

    `fly` trims flights from columns of `_Points`; `name` and `unit` are for the first figure. If no climb or glide
    exists, the result is a single NaN.
    """
    flights = fly(speed=speeds, power=power)
    angle = np.asarray(flights.path_angle)
    # The power is prescribed: a violated limit of power is a rounding error.
    values = speeds * np.sin(angle) if power > 0.0 else -1.0 / np.tan(np.minimum(angle, -1e-6))
    values = np.where(_is_flyable(flights, except_power=True) & (angle != 0.0), values, -np.inf)
    is_flown = np.isfinite(values)
    if not is_flown.any() or (power == 0.0 and np.max(angle[is_flown]) >= 0.0):
        return [PerformanceFigure(name, np.nan, unit, "no such flight")]
    best = int(np.argmax(values))
    airspeed, value, limit = speeds[best], values[best], "end of the range"
    around = slice(best - 1, best + 2)
    if 0 < best < speeds.size - 1 and is_flown[around].all():
        # the top of the parabola through the greatest value and its neighbours
        a, b, c = np.polyfit(speeds[around] - speeds[best], values[around], 2)
        shift = -0.5 * b / a if a < 0.0 else 0.0
        airspeed, value, limit = speeds[best] + shift, c + b * shift + a * shift**2, ""
    at = f"airspeed of the {name.removesuffix(' ratio').removesuffix(' rate')}"
    return [
        PerformanceFigure(name, float(value), unit, "full power" if power > 0.0 else "idle power"),
        PerformanceFigure(at, float(airspeed), "m/s", limit),
    ]


def _turn_figures(fly: Any, speeds: np.ndarray, gravity: float) -> list[PerformanceFigure]:
    """Return greatest load factor and rate (deg/s) and least radius (m) of sustained level turns, each with airspeed.

    `fly` trims flights from columns of `_Points`. The search ends at a load factor of 9. If no level turn exists, the
    result is a single NaN.
    """
    low, high = np.ones(speeds.size), np.full(speeds.size, _LOAD_FACTOR_MAX)
    limits = [f"load factor of the search, {_LOAD_FACTOR_MAX:g}"] * speeds.size
    no_turn = [PerformanceFigure("greatest sustained turn rate", np.nan, "deg/s", "no level turn")]
    if not _is_flyable(fly(speed=speeds)).any():
        return no_turn
    for _ in range(_TURN_PASSES):  # each pass narrows the load factor of every airspeed to a part of the range
        factors = np.linspace(low, high, _TURN_GRID, axis=1)
        rates = gravity * np.sqrt(factors**2 - 1.0) / speeds[:, None]
        flights = fly(speed=speeds[:, None], turn_rate=rates)
        # A tighter turn counts only if each wider one can be flown too.
        flyable = np.logical_and.accumulate(_is_flyable(flights).reshape(factors.shape), axis=1)
        for k, count in enumerate(flyable.sum(axis=1)):
            if 0 < count < _TURN_GRID:
                low[k], high[k] = factors[k, count - 1 : count + 1]
                limits[k] = _limit_of(flights, k * _TURN_GRID + int(count))
            else:  # every turn of the search, or not even level flight
                low[k] = high[k] = high[k] if count else np.nan
    rates = gravity * np.sqrt(low**2 - 1.0) / speeds
    is_turning = np.isfinite(low) & (low > 1.0)
    if not is_turning.any():
        return no_turn
    figures = []
    for name, values, unit, sign in (
        ("greatest sustained load factor", low, "1", 1.0),
        ("greatest sustained turn rate", rates * RAD_DEG, "deg/s", 1.0),
        ("least sustained turn radius", speeds / np.where(is_turning, rates, 1.0), "m", -1.0),
    ):
        best = int(np.argmax(np.where(is_turning, sign * values, -np.inf)))
        figures.append(PerformanceFigure(name, float(values[best]), unit, f"at {speeds[best]:.4g} m/s; {limits[best]}"))
    return figures


def _excess_power(field: _Flights, speeds: np.ndarray, altitudes: np.ndarray, gravity: float) -> xr.Dataset:
    flyable = _is_flyable(field, except_power=True)
    excess = np.where(flyable, field.acceleration, np.nan).reshape(altitudes.size, -1) * speeds / gravity
    axes, mach = ("altitude", "airspeed"), np.reshape(field.trims.mach, excess.shape)
    power = unit_attributes("m s-1", "Specific excess power at full power")
    return xr.Dataset(
        {"specific_excess_power_m_s": (axes, excess, power), "mach": (axes, mach, unit_attributes("1", "Mach number"))},
        {
            "altitude": ("altitude", altitudes, unit_attributes("m", "Altitude")),
            "airspeed": ("airspeed", speeds, unit_attributes("m s-1", "True airspeed")),
        },
    )


def _ceiling(dataset: xr.Dataset, threshold: float) -> tuple[float, str, str]:
    """Return the altitude (m) at which the greatest excess power is `threshold` (m/s), the unit, and the limit.

    The altitude is NaN if the excess power at the lowest altitude with data does not exceed the threshold, and the
    highest altitude with data if the excess power exceeds the threshold everywhere.
    """
    best, altitudes = dataset["specific_excess_power_m_s"].max("airspeed").values, dataset["altitude"].values
    first = int(np.argmax(np.isfinite(best)))
    best, altitudes = best[first:], altitudes[first:]
    if not best[0] > threshold:
        return np.nan, "m", f"no climb at {f'{altitudes[0]:g} m' if first else 'sea level'}"
    count = int(np.argmin([*np.isfinite(best), False]))
    below = np.flatnonzero(best[:count] <= threshold)
    if below.size == 0:
        return float(altitudes[count - 1]), "m", "end of the data or of the grid, still climbing"
    k = int(below[0])
    share = (best[k - 1] - threshold) / (best[k - 1] - best[k])
    return float(altitudes[k - 1] + share * (altitudes[k] - altitudes[k - 1])), "m", "full power"
