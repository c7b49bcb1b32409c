"""Construction of a scenario's wind from a file with a wind field, and checks that the field contains the flight."""

import functools
import math
from collections.abc import Iterator

import jax
import numpy as np
from jaxtyping import Array

from anser.config.errors import Problem, ScenarioError, describe_value, format_number
from anser.config.tables import Vector
from anser.constants import WGS84_A_M, WGS84_F
from anser.environment.air import geopotential_altitude
from anser.environment.gridded_wind import GriddedWind
from anser.numerics.arrays import as_array
from anser.numerics.tables import make_axes
from anser.planning.certified.fitted_wind import FieldSamples, FittedWind, Way, fit_layers
from anser.scenario.schema_environment import FIELD_SPEED_MAX_M_S, Earth, Wind
from anser.scenario.schema_tables import ScenarioTables
from anser.scenario.wind_field_file import WindField, read_wind_field
from anser.units import DEG_RAD

_TURN = 2.0 * math.pi
_WAY_MARGIN_M = np.array([1000.0, 1000.0, 100.0])  # around starts and rendezvous points: north, east, altitude


def build_wind_field(wind: Wind, earth: Earth | None) -> GriddedWind:
    """Build the wind of a file for positions in the chart (local map) around the origin of `earth`.

    If `earth` is None, the field must have axes in m. Raises ScenarioError if the file is not a wind field, the table's
    other keys do not fit the file, or a field in latitude and longitude has no Earth.
    """
    field = field_of(wind, earth)
    if field.is_geographic and earth is None:
        arrived = "a field in latitude and longitude without an Earth"
        raise _error(wind, Problem("wind.field", arrived, "the origin's latitude_deg and longitude_deg in earth"))
    times, (north, east) = _times_s(wind, field), chart_axes(field, earth)
    axes = [north, east] if times.size == 1 else [times, north, east]
    lowest, highest = field.altitude_bounds
    return GriddedWind(
        columns=_device_columns(*_file_and_longitude(wind, earth)),
        member=as_array(wind.member, np.int32),
        axes=make_axes(axes, clamp=True),
        level_tops=as_array(highest[1:-1]),
        altitude_min=as_array(highest[0]),
        altitude_max=as_array(lowest[-1]),
        radii=as_array(chart_radii(earth)) if field.is_geographic and earth is not None else None,
        is_geopotential=field.is_geopotential,
        interval_count=_interval_count(lowest, highest),
        is_held=wind.outside == "hold",
    )


def build_fitted_wind(scenario: ScenarioTables) -> FittedWind:
    """Return layers of wind for planning, fitted to a scenario's wind field around starts and rendezvous points."""
    wind, earth = scenario.wind, scenario.earth
    field = field_of(wind, earth)
    north, east = chart_axes(field, earth)
    samples = FieldSamples(
        times=_times_s(wind, field),
        north=north,
        east=east,
        columns=field.columns[wind.member],
        radii_m=chart_radii(earth) if field.is_geographic else None,
        is_geopotential=field.is_geopotential,
        is_held=wind.outside == "hold",
    )
    positions_m = np.array([position_m for _, _, position_m in _positions(scenario)])
    duration_s = scenario.timing.duration_s
    way = Way(
        least_m=positions_m.min(axis=0) - _WAY_MARGIN_M,
        greatest_m=positions_m.max(axis=0) + _WAY_MARGIN_M,
        reach_m=(scenario.speed_limit_m_s + wind.speed_max_m_s) * duration_s,
        end_s=duration_s,
    )
    return fit_layers(samples, way)


def field_of(wind: Wind, earth: Earth | None) -> WindField:
    """Return the wind field of a table [wind]; a field around the globe starts and ends opposite the Earth's origin.

    Raises ScenarioError if the file is no wind field, has no ensemble member `wind.member`, or has winds above
    `FIELD_SPEED_MAX_M_S`.
    """
    field = _field_around(*_file_and_longitude(wind, earth))
    count, fastest = field.columns.shape[0], math.sqrt(np.max(np.sum(field.columns[..., :3] ** 2, axis=-1)))
    if wind.member >= count:
        expected = "0, as the file has no ensemble" if count == 1 else f"from 0 to {count - 1}, the file's members"
        raise _error(wind, Problem("wind.member", str(wind.member), expected))
    if fastest > FIELD_SPEED_MAX_M_S:
        arrived = f"a field with {fastest:.0f} m/s of wind"
        raise _error(wind, Problem("wind.field", arrived, f"at most {FIELD_SPEED_MAX_M_S:g} m/s"))
    return field


def _file_and_longitude(wind: Wind, earth: Earth | None) -> tuple[str, str, float | None]:
    """Return path and SHA-256 of a wind field's file, and the longitude of the chart's origin, deg (None: no Earth)."""
    assert wind.field is not None
    return wind.field.path, wind.field.sha256, None if earth is None else earth.longitude_deg


@functools.lru_cache(maxsize=4)
def _field_around(path: str, digest: str, longitude_deg: float | None) -> WindField:
    field = read_wind_field(path, digest)
    return field if longitude_deg is None else field.around(longitude_deg)


def _error(wind: Wind, problem: Problem) -> ScenarioError:
    return ScenarioError(wind.field.path if wind.field is not None else "", [problem])


def _times_s(wind: Wind, field: WindField) -> np.ndarray:
    """Return the times of the field, s after the start; raises ScenarioError if `wind.start_time` does not fit them."""
    start, epoch = wind.start_time, field.epoch
    if start is None:
        return field.times_s - field.times_s[0]
    first, last = field.times_s[0], field.times_s[-1]
    span = f"from {first:g} to {last:g} s, the times of the file"
    if epoch is not None:
        first, last = (epoch + np.timedelta64(round(1e6 * time), "us") for time in (first, last))
        span = f"a date and time (UTC) in quotes from {str(first)[:19]} to {str(last)[:19]}, the times of the file"
    try:
        if (epoch is None) == isinstance(start, str):
            raise ValueError
        offset = (
            start if epoch is None else (np.datetime64(str(start).removesuffix("Z")) - epoch) / np.timedelta64(1, "s")
        )
    except ValueError:
        raise _error(wind, Problem("wind.start_time", describe_value(start), span)) from None
    if not field.times_s[0] <= offset <= field.times_s[-1]:
        raise _error(wind, Problem("wind.start_time", describe_value(start), span))
    return field.times_s - offset


def chart_axes(field: WindField, earth: Earth | None) -> tuple[np.ndarray, np.ndarray]:
    """Return coordinates of the field's nodes: north and east, m, or latitude and longitude minus the origin's, rad.

    If `earth` is None, latitude and longitude are as in the file, deg.
    """
    if not field.is_geographic or earth is None:
        return field.north, field.east
    north = (field.north - earth.latitude_deg) * DEG_RAD
    east = (field.east - earth.longitude_deg) * DEG_RAD
    return north, east - _TURN * np.round(0.5 * (east[0] + east[-1]) / _TURN)


def chart_radii(earth: Earth) -> np.ndarray:
    """Return the radii (2,), m, by which the chart (local map) scales latitude and longitude (theory section 1)."""
    latitude, e2 = earth.latitude_deg * DEG_RAD, WGS84_F * (2.0 - WGS84_F)
    w2 = 1.0 - e2 * math.sin(latitude) ** 2
    across = WGS84_A_M / math.sqrt(w2)
    return np.array([across * (1.0 - e2) / w2, across * math.cos(latitude)])


@functools.lru_cache(maxsize=4)
def _device_columns(path: str, digest: str, longitude_deg: float | None) -> Array:
    columns = _field_around(path, digest, longitude_deg).columns
    with jax.ensure_compile_time_eval():
        return as_array(columns.reshape(-1, *columns.shape[-2:]))


def _interval_count(lowest: np.ndarray, highest: np.ndarray) -> int:
    """Return the greatest number of intervals between levels in which one altitude lies, at different nodes and times.

    `lowest` and `highest` are the bounds of each level's altitude over nodes and times, m.
    """
    altitudes = np.concatenate([lowest[1:-1], highest[1:-1]])
    first = np.sum(altitudes[:, None] >= highest[1:-1], axis=1)
    last = np.sum(altitudes[:, None] >= lowest[1:-1], axis=1)
    return int(np.max(last - first, initial=0)) + 1


def check_wind_field(scenario: ScenarioTables) -> None:
    """Raise ScenarioError if starts or rendezvous points are outside the wind field, or the flight outlasts it.

    If `wind.outside` is "hold", the file is read, but positions and duration are not checked.
    """
    wind = scenario.wind
    if wind.field is None:
        return
    field = field_of(wind, scenario.earth)
    times, duration_s = _times_s(wind, field), scenario.timing.duration_s
    if wind.outside == "hold":
        return
    problems = []
    if times.size > 1 and duration_s > times[-1]:
        expected = f"at most {format_number(times[-1])} s, where the wind field ends; {_REMEDY}"
        problems.append(Problem("timing.duration_s", format_number(duration_s), expected))
    for path, label, position_m in _positions(scenario):
        outside = _outside(field, scenario.earth, position_m)
        if outside is not None:
            problems.append(Problem(path, outside[0], f"{outside[1]}, the extent of the wind field; {_REMEDY}", label))
    if problems:
        raise ScenarioError(scenario.name, problems)


_REMEDY = 'or wind.outside = "hold", with which the wind beyond is as at the boundary'


def _positions(scenario: ScenarioTables) -> Iterator[tuple[str, str, Vector]]:
    for k, aircraft in enumerate(scenario.aircraft):
        yield f"aircraft[{k}].start", aircraft.label, aircraft.start.position_m
        goal = scenario.goal_of(aircraft)
        times_s = {0.0, scenario.timing.duration_s} if goal.velocity_m_s() != (0.0, 0.0, 0.0) else {0.0}
        for time_s in sorted(times_s | {point.time_s for point in goal.waypoints or ()}):
            north, east, up = (
                a + b for a, b in zip(goal.position_m(time_s), aircraft.rendezvous.stand_off_m, strict=True)
            )
            yield f"aircraft[{k}].rendezvous", f"{aircraft.label}, after {time_s:g} s", (north, east, up)


def _outside(field: WindField, earth: Earth, position_m: Vector) -> tuple[str, str] | None:
    """Return coordinate and extent of the field as texts if a position (north, east, up; m) is outside, or None."""
    north, east, up = position_m
    axes, unit = chart_axes(field, earth), "m north or east of the origin"
    if field.is_geographic:
        unit = "deg of latitude or longitude from the origin"
        north, east = np.arctan2((north, east), chart_radii(earth))
    factor = 1.0 / DEG_RAD if field.is_geographic else 1.0
    for value, axis in zip((north, east), axes, strict=True):
        if not axis[0] <= value <= axis[-1]:
            return f"{factor * value:.7g} {unit}", f"from {factor * axis[0]:.7g} to {factor * axis[-1]:.7g} {unit}"
    altitude = geopotential_altitude(up) if field.is_geopotential else up
    lowest, highest = field.altitude_bounds
    if not highest[0] <= altitude <= lowest[-1]:
        return f"{up:.1f} m of altitude", f"from {highest[0]:.1f} to {lowest[-1]:.1f} m"
    return None
