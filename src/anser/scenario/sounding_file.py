"""Reading of soundings, tables of the measured atmosphere: CSV files, or text listings of a radiosonde."""

import csv
import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from anser.config.errors import Problem, ScenarioError, problem_error, quoted_list
from anser.config.tables import Table
from anser.config.toml_text import read_text
from anser.config.validation_messages import validation_problems
from anser.environment.air import (
    AIR_GAS_CONSTANT_J_KG_K,
    CELSIUS_K,
    STANDARD_LAYERS,
    VAPOUR_MOLAR_RATIO,
    air_at_geopotential,
    geometric_altitude,
    geopotential_altitude,
    vapour_pressure,
)
from anser.scenario.schema_environment import AirLevel, WindLayer
from anser.units import KNOT_M_S

_COLUMNS: dict[str, tuple[str, float, float]] = {
    "altitude_m": ("altitude", 1.0, 0.0),
    "geopotential_m": ("geopotential", 1.0, 0.0),
    "pressure_hpa": ("pressure", 1.0, 0.0),
    "pressure_pa": ("pressure", 0.01, 0.0),
    "temperature_c": ("temperature", 1.0, 0.0),
    "temperature_k": ("temperature", 1.0, -CELSIUS_K),
    "density_kg_m3": ("density", 1.0, 0.0),
    "relative_humidity_percent": ("humidity", 1.0, 0.0),
    "dew_point_c": ("dew point", 1.0, 0.0),
    "dew_point_k": ("dew point", 1.0, -CELSIUS_K),
    "wind_speed_m_s": ("wind speed", 1.0, 0.0),
    "wind_speed_kt": ("wind speed", KNOT_M_S, 0.0),
    "wind_from_deg": ("wind direction", 1.0, 0.0),
    "wind_up_m_s": ("vertical wind", 1.0, 0.0),
}
"""Columns of a CSV file: quantity, and the factor and addend that convert the number to m, hPa, deg C, %, m/s, deg."""
_LISTING_COLUMNS = {
    ("PRES", "hPa"): "pressure_hpa",
    ("HGHT", "m"): "geopotential_m",
    ("TEMP", "C"): "temperature_c",
    ("DWPT", "C"): "dew_point_c",
    ("RELH", "%"): "relative_humidity_percent",
    ("DRCT", "deg"): "wind_from_deg",
    ("SKNT", "knot"): "wind_speed_kt",
    ("SPED", "m/s"): "wind_speed_m_s",
}
"""Columns of a CSV file by the title and unit of a column in a listing."""
_LISTING_WIDTH = 7
"""Width of a column in a listing, characters."""
_EXPECTED = (
    "a CSV file with columns altitude_m (or geopotential_m), pressure_hpa, temperature_c (or temperature_k; "
    "density_kg_m3 in the place of one of the two), and optional relative_humidity_percent (or dew_point_c), "
    "wind_speed_m_s (or wind_speed_kt), wind_from_deg; or a listing with PRES, HGHT, TEMP"
)
_HUMIDITY_MAX_PERCENT = 105.0
"""Greatest relative humidity that a radiosonde may measure in saturated air; counted as 100 %."""
_DEW_POINT_MIN_C = -130.0
_SUPERSATURATION_MAX_K = 2.0
"""Greatest excess of a measured dew point over the temperature; counted as saturated air."""
_PRESSURE_RATIO_RANGE = (0.5, 2.0)
"""Range of the lowest level's pressure over the standard atmosphere's at its altitude; beyond, a unit is wrong."""
_WIND_ALTITUDE_MAX_M = 30_000.0


@dataclass(frozen=True)
class MeasuredAir:
    """Air levels and winds of a sounding, each with the keys of a scenario table."""

    levels: list[dict[str, Any]]  # keys and values of `AirLevel`
    winds: list[dict[str, Any]]  # keys and values of `WindLayer`; empty if no wind was measured


@dataclass(frozen=True)
class _Row:
    line: int
    values: dict[str, float]  # by quantity of `_COLUMNS`; m, hPa, deg C, kg/m^3, %, m/s, deg


def read_sounding(path: Path) -> MeasuredAir:
    """Read a sounding from a CSV file or a radiosonde's listing.

    Raises ScenarioError, with the file and the line, if the file cannot be read, a number is missing or invalid, the
    altitudes do not rise, or there are fewer than two levels.
    """
    source = str(path)
    text = read_text(path, "sounding")
    lines = text.splitlines()
    header = next((k for k, line in enumerate(lines) if line.split()[:2] == ["PRES", "HGHT"]), None)
    rows = list(_csv_rows(text, source) if header is None else _listing_rows(lines, header, source))
    levels = [_level(row, source) for row in rows]
    if len(levels) < 2:
        raise problem_error(source, f"{len(levels)} levels with numbers", f"at least two levels; {_EXPECTED}")
    for (_, lower), (row, upper) in itertools.pairwise(zip(rows, levels, strict=True)):
        if upper["altitude_m"] <= lower["altitude_m"]:
            arrived = f"altitude {upper['altitude_m']:g} m after {lower['altitude_m']:g} m"
            raise _line_error(source, row.line, arrived, "levels with rising altitudes")
    _require_usual_pressure(levels[0], rows[0].line, source)
    winds = [_wind(row, level["altitude_m"], source) for row, level in zip(rows, levels, strict=True)]
    for row, level, wind in zip(rows, levels, winds, strict=True):
        _require_ranges(AirLevel, level, row.line, source)
        if wind is not None:
            _require_ranges(WindLayer, wind, row.line, source)
    return MeasuredAir(levels, [wind for wind in winds if wind is not None])


def _require_ranges(table: type[Table], values: dict[str, float], line: int, source: str) -> None:
    """Raise ScenarioError, with the line, if a value is out of the range of its key in a scenario file."""
    try:
        table.model_validate(values)
    except ValidationError as error:
        problem = validation_problems(error, table, values)[0]
        raise _line_error(source, line, f"{problem.path} = {problem.arrived}", problem.expected) from None


def _require_usual_pressure(level: dict[str, float], line: int, source: str) -> None:
    altitude = float(geopotential_altitude(np.float64(level["altitude_m"])))
    standard_hpa = 0.01 * float(air_at_geopotential(STANDARD_LAYERS, altitude).pressure)
    low, high = (ratio * standard_hpa for ratio in _PRESSURE_RATIO_RANGE)
    if not low <= level["pressure_hpa"] <= high:
        arrived = f"{level['pressure_hpa']:g} hPa at {level['altitude_m']:g} m"
        raise _line_error(
            source, line, arrived, f"{low:.0f} to {high:.0f} hPa at this altitude, in the unit of the column"
        )


def _csv_rows(text: str, source: str) -> Iterator[_Row]:
    reader = csv.reader(text.splitlines(keepends=True), strict=True)
    names: list[str] | None = None
    for cells in _records(reader, source):
        if not any(cell.strip() for cell in cells) or cells[0].lstrip().startswith("#"):
            continue
        cells = [cell.strip() for cell in cells]
        if names is None:
            names = cells
            unknown = [name for name in names if name not in _COLUMNS]
            if unknown:
                raise _line_error(source, reader.line_num, f"a column {unknown[0]!r:.40}", _EXPECTED)
            quantities = [_COLUMNS[name][0] for name in names]
            twice = next((name for k, name in enumerate(names) if quantities[k] in quantities[:k]), None)
            if twice is not None:
                raise _line_error(source, reader.line_num, f"a second column of one quantity, {twice}", _EXPECTED)
            _require_columns(quantities, source, reader.line_num)
            continue
        if len(cells) != len(names):
            expected = f"{len(names)} cells: {', '.join(names)}"
            raise _line_error(source, reader.line_num, f"{len(cells)} cells", expected)
        yield _Row(reader.line_num, _converted(dict(zip(names, cells, strict=True)), source, reader.line_num))


def _records(reader: Any, source: str) -> Iterator[list[str]]:
    """Yield the records of a CSV reader; raises ScenarioError with the line if the text is not CSV."""
    try:
        yield from reader
    except csv.Error as error:
        raise _line_error(source, reader.line_num, f"text that is no CSV ({error})", _EXPECTED) from None


def _listing_rows(lines: Sequence[str], header: int, source: str) -> Iterator[_Row]:
    units = lines[header + 1].split() if header + 1 < len(lines) else []
    titles = lines[header].split()
    if len(units) != len(titles):
        raise _line_error(source, header + 2, f"{len(units)} units", f"a unit for each of {', '.join(titles)}")
    names = [_LISTING_COLUMNS.get((title, unit)) for title, unit in zip(titles, units, strict=True)]
    known = [name for name in names if name is not None]
    _require_columns([_COLUMNS[name][0] for name in known], source, header + 1)
    if "relative_humidity_percent" in known:
        names = [None if name == "dew_point_c" else name for name in names]
    for number, line in enumerate(lines[header + 2 :], header + 3):
        cells = [line[k * _LISTING_WIDTH : (k + 1) * _LISTING_WIDTH].strip() for k in range(len(names))]
        if set(line.strip()) <= {"-"}:
            continue
        if not cells[0].replace(".", "").isdigit():
            return  # the text after the table
        values = {name: cell for name, cell in zip(names, cells, strict=True) if name is not None}
        row = _Row(number, _converted(values, source, number))
        if {"geopotential", "pressure", "temperature"} <= set(row.values):  # pressures below the ground have no air
            yield row


def _require_columns(quantities: Sequence[str], source: str, line: int) -> None:
    state = [quantity for quantity in ("pressure", "temperature", "density") if quantity in quantities]
    if len(state) < 2 or not {"altitude", "geopotential"} & set(quantities):
        raise _line_error(source, line, f"columns of {quoted_list(quantities)}", _EXPECTED)


def _converted(cells: dict[str, str], source: str, line: int) -> dict[str, float]:
    values: dict[str, float] = {}
    for name, cell in cells.items():
        if not cell:
            continue
        quantity, factor, addend = _COLUMNS[name]
        try:
            value = float(cell)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise _line_error(source, line, f"{cell!r:.40} as {name}", "a finite number, or an empty cell")
        values[quantity] = value * factor + addend
    return values


def _level(row: _Row, source: str) -> dict[str, float]:
    values = row.values
    altitude_m = values.get("altitude")
    if altitude_m is None and "geopotential" in values:
        altitude_m = float(geometric_altitude(np.float64(values["geopotential"])))
    pressure, celsius, density = (values.get(quantity) for quantity in ("pressure", "temperature", "density"))
    if altitude_m is None or [pressure, celsius, density].count(None) > 1:
        raise _line_error(source, row.line, f"only {quoted_list(list(values))}", "an altitude and two of the air")
    if density is not None and density <= 0.0:
        raise _line_error(source, row.line, f"a density of {density:g} kg/m^3", "a positive density")
    if celsius is None:  # the density is that of dry air of the virtual temperature
        virtual = 100.0 * values["pressure"] / (AIR_GAS_CONSTANT_J_KG_K * values["density"])
        return {"altitude_m": altitude_m, "pressure_hpa": values["pressure"], "temperature_c": virtual - CELSIUS_K}
    temperature = celsius + CELSIUS_K
    saturated = float(vapour_pressure(temperature))
    humidity = values.get("humidity", 0.0)
    humidity = 100.0 if 100.0 < humidity <= _HUMIDITY_MAX_PERCENT else humidity
    if "dew point" in values:
        if not _DEW_POINT_MIN_C <= values["dew point"] <= celsius + _SUPERSATURATION_MAX_K:
            arrived = f"a dew point of {values['dew point']:g} deg C at {celsius:g} deg C"
            expected = f"{_DEW_POINT_MIN_C:g} deg C to the temperature; dew_point_k for a dew point in kelvin"
            raise _line_error(source, row.line, arrived, expected)
        humidity = min(100.0, 100.0 * float(vapour_pressure(values["dew point"] + CELSIUS_K)) / saturated)
    if pressure is None:
        lighter = (1.0 - VAPOUR_MOLAR_RATIO) * 0.01 * humidity * saturated
        pressure = 0.01 * (values["density"] * AIR_GAS_CONSTANT_J_KG_K * temperature + lighter)
    return {
        "altitude_m": altitude_m,
        "pressure_hpa": pressure,
        "temperature_c": celsius,
        "relative_humidity_percent": humidity,
    }


def _wind(row: _Row, altitude_m: float, source: str) -> dict[str, float] | None:
    """Return the wind of a level as values of a `WindLayer`; None if not measured, or too high for a `WindLayer`.

    Raises ScenarioError if speed or direction is missing, except the direction of a calm.
    """
    speed, direction = row.values.get("wind speed"), row.values.get("wind direction")
    if (speed is None) != (direction is None) and speed != 0.0:
        arrived = "a wind without speed" if speed is None else "a wind without direction"
        raise _line_error(source, row.line, arrived, "wind speed and direction, or neither")
    if speed is None and "vertical wind" in row.values:
        raise _line_error(source, row.line, "a vertical wind without a wind speed", "a speed beside it, 0 for a calm")
    if speed is None or altitude_m > _WIND_ALTITUDE_MAX_M:
        return None
    return {
        "altitude_m": altitude_m,
        "speed_m_s": speed,
        "from_deg": direction or 0.0,
        "up_m_s": row.values.get("vertical wind", 0.0),
    }


def _line_error(source: str, line: int, arrived: str, expected: str) -> ScenarioError:
    return ScenarioError(source, [Problem(f"line {line}", arrived, expected)])
