"""Scenario tables for the environment: Earth, atmosphere, wind, turbulence and discrete gusts."""

import itertools
import math
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, Field, GetJsonSchemaHandler, WithJsonSchema
from pydantic_core import CoreSchema

from anser.config.errors import Problem, describe_value, format_number, problem_error, quoted_list
from anser.config.tables import (
    Table,
    Vector,
    expects,
    identifier,
    interpolate,
    number,
    table,
    tables,
    velocity_on_course,
)
from anser.constants import SEA_LEVEL_PRESSURE_PA, STANDARD_GRAVITY_M_S2
from anser.environment.air import (
    AIR_GAS_CONSTANT_J_KG_K,
    CELSIUS_K,
    Layers,
    geopotential_altitude,
    humid_layers,
    measured_layers,
    standard_layers,
    virtual_temperature,
)
from anser.scenario.schema_settings import DURATION_MAX_S
from anser.scenario.wind_field_file import file_digest

_EARTHS = ("flat", "wgs84")
_WAYS = "one of the three: speed_m_s, from_deg and up_m_s, the same at all altitudes; layers; or field"


class Earth(Table):
    """The Earth, flat or as the rotating ellipsoid, and the position of the origin (north = east = 0)."""

    model: Literal["flat", "wgs84"] = Field(
        default="flat",
        description="flat and at rest with one gravity, or the rotating WGS-84 ellipsoid with J2 gravitation",
    )
    latitude_deg: float = number("geodetic latitude of the origin", -89.99, 89.99, "deg", 45.0)
    longitude_deg: float = number("longitude of the origin", -180, 180, "deg", 0.0)


def _earth_from_name(value: Any) -> Any:
    """Return the name of an Earth model, as in ``earth = "wgs84"``, as a table; raises ScenarioError if unknown."""
    if not isinstance(value, str):
        return value
    if value not in _EARTHS:
        expected = f"{quoted_list(_EARTHS, ' or ')}, or a table [earth]"
        raise problem_error("", describe_value(value), expected)
    return {"model": value}


class _EarthNameSchema:
    """Annotation of the key `earth` for the JSON Schema: a table, or the name of the Earth model alone."""

    def __get_pydantic_json_schema__(self, core: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        return {"anyOf": [handler(core), {"enum": list(_EARTHS)}]}


EarthField = Annotated[Earth, BeforeValidator(_earth_from_name), _EarthNameSchema()]


class WindLayer(Table):
    """Wind at one altitude."""

    altitude_m: float = number("height above sea level", -500, 30_000, "m")
    speed_m_s: float = number("horizontal wind speed", 0, 150, "m/s")
    from_deg: float = number("direction that the wind comes from, clockwise from north", -360, 360, "deg", 0.0)
    up_m_s: float = number("vertical wind, positive upwards", -20, 20, "m/s", 0.0)


FIELD_SPEED_MAX_M_S = 150.0
"""Greatest speed of the air in a wind field from a file, m/s."""


class WindFieldSource(Table):
    """File of a wind field, with the checksum of its content; a scenario file has the path alone."""

    path: str = Field(description="path of the NetCDF file", json_schema_extra=expects("a path in quotes"))
    sha256: str = Field(
        pattern=r"^[0-9a-f]{64}$",
        description="SHA-256 of the file's content",
        json_schema_extra=expects("64 hexadecimal digits"),
    )


def _field_from_path(value: Any) -> Any:
    """Return a path, as in ``field = "FILE.nc"``, as a table with the checksum of the file; reads the file."""
    if not isinstance(value, str):
        return value
    path = Path(value).absolute()
    return {"path": str(path), "sha256": file_digest(path)}


def _field_key(description: str, expected: str, default: Any, **options: Any) -> Any:
    """Declare a key of a wind field that a dump leaves out if its value is the default; `options` are for `Field`."""
    exclude_if = lambda value: value == default  # noqa: E731
    return Field(
        default, description=description, json_schema_extra=expects(expected), exclude_if=exclude_if, **options
    )


class Wind(Table):
    """Wind: uniform and steady, a shear profile, or a field from a file."""

    speed_m_s: float = number("horizontal wind speed", 0, 100, "m/s", 0.0)
    from_deg: float = number("direction that the wind comes from, clockwise from north", -360, 360, "deg", 0.0)
    up_m_s: float = number("vertical wind, positive upwards", -20, 20, "m/s", 0.0)
    layers: tuple[WindLayer, ...] | None = tables(
        "the wind at rising altitudes, linear in between and as at the ends beyond",
        "a list of layers, at least one",
        at_least=1,
        default=None,
    )
    field: Annotated[
        WindFieldSource | None, BeforeValidator(_field_from_path), WithJsonSchema({"type": ["string", "object"]})
    ] = _field_key(
        "NetCDF file with the wind over time, altitude and two horizontal axes",
        'the path of a file in quotes, such as "era5.nc"',
        None,
    )
    start_time: float | str | None = _field_key(
        "time of the file at which the flight begins; left out: the first",
        'a date and time (UTC) in quotes, such as "2026-01-05T12:00"; a number of seconds for a file without dates',
        None,
    )
    member: int = _field_key("member of an ensemble, from 0", "a whole number from 0 to 999", 0, ge=0, le=999)
    outside: Literal["refuse", "hold"] = _field_key(
        "beyond the field: the flight is refused, or the wind is as at the boundary", '"refuse" or "hold"', "refuse"
    )

    def consistency_problems(self) -> list[Problem]:
        """List a wind defined twice, keys that need a missing wind field, and layers whose altitudes do not rise."""
        alternatives = ("layers", "field")
        used = [key for key in alternatives if getattr(self, key) is not None]
        uniform_keys = [key for key in ("speed_m_s", "from_deg", "up_m_s") if key in self.model_fields_set]
        problems = [
            Problem(key, f"{format_number(getattr(self, key))} beside {used[0]}", _WAYS) for key in uniform_keys if used
        ]
        if len(used) > 1:
            problems.append(Problem("layers", "layers beside field", _WAYS))
        if self.field is None:
            keys = [key for key in ("start_time", "member", "outside") if key in self.model_fields_set]
            problems += [Problem(key, f"{key} without field", "the key only beside field") for key in keys]
        if self.layers is None:
            return problems
        altitudes_m = [layer.altitude_m for layer in self.layers]
        for index, (lower_altitude, altitude) in enumerate(itertools.pairwise(altitudes_m), 1):
            if altitude <= lower_altitude:
                expected = f"more than the layer before it, {format_number(lower_altitude)} m"
                problems.append(Problem(f"layers[{index}].altitude_m", format_number(altitude), expected))
        return problems

    @property
    def profile_m_s(self) -> tuple[tuple[float, Vector], ...]:
        """Layers of the wind: pairs of altitude (m) and velocity over the ground (north, east, up), m/s.

        A uniform wind has one layer. A wind field has one layer of still air, because its file is not read here.
        """
        if self.layers is None:
            return ((0.0, _wind_velocity(self)),)
        return tuple((layer.altitude_m, _wind_velocity(layer)) for layer in self.layers)

    @property
    def speed_max_m_s(self) -> float:
        """Greatest speed of the air, vertical part included, m/s; for a wind field, `FIELD_SPEED_MAX_M_S`."""
        if self.field is not None:
            return FIELD_SPEED_MAX_M_S
        return max(math.hypot(*velocity) for _, velocity in self.profile_m_s)

    def velocity_m_s(self, altitude_m: float) -> Vector:
        """Return the velocity of the air over the ground (north, east, up), m/s, at an altitude (m).

        The result is 0 for a wind field.
        """
        return interpolate(self.profile_m_s, altitude_m)


def _wind_velocity(wind: Wind | WindLayer) -> Vector:
    return velocity_on_course(-wind.speed_m_s, wind.from_deg, wind.up_m_s)


_SOUNDING_PATH = 'the path of a sounding (CSV, or a text listing of a radiosonde), such as "sounding.csv"'
_THICKNESS_ERROR_MAX = 0.1
"""Greatest relative difference between the measured and the hydrostatic fall of the pressure."""
_PRESSURE_ROUNDING_HPA = 1.0
"""Rounding of the pressures in a listing of a radiosonde, which matters at great altitudes."""


class AirLevel(Table):
    """Air at one altitude."""

    altitude_m: float = number("geometric altitude above sea level", -500, 40_000, "m")
    pressure_hpa: float = number("pressure", 1, 1_100, "hPa")
    temperature_c: float = number("temperature", -130, 70, "deg C")
    relative_humidity_percent: float = number("relative humidity over water", 0, 100, "%", 0.0)


class Sounding(Table):
    """Air measured by a sounding, at two or more levels."""

    level: tuple[AirLevel, ...] = tables("the air at rising altitudes", "a list of levels, at least two", at_least=2)

    def consistency_problems(self) -> list[Problem]:
        """Return a problem if levels do not rise, pressures do not fall, or a pressure contradicts the temperatures."""
        for index, (lower, upper) in enumerate(itertools.pairwise(self.level), 1):
            place = f"level[{index}]"
            if upper.altitude_m <= lower.altitude_m:
                expected = f"more than the level before it, {format_number(lower.altitude_m)} m"
                return [Problem(f"{place}.altitude_m", format_number(upper.altitude_m), expected)]
            if upper.pressure_hpa >= lower.pressure_hpa:
                expected = f"less than the level below it, {format_number(lower.pressure_hpa)} hPa"
                return [Problem(f"{place}.pressure_hpa", format_number(upper.pressure_hpa), expected)]
        h, T, p = self._measured(0.0)
        fall = -np.diff(np.log(p))
        at_rest = STANDARD_GRAVITY_M_S2 / AIR_GAS_CONSTANT_J_KG_K * np.diff(h) / (0.5 * (T[:-1] + T[1:]))
        error = np.abs(fall - at_rest) - _THICKNESS_ERROR_MAX * at_rest - _PRESSURE_ROUNDING_HPA * 100.0 / p[1:]
        index = int(np.argmax(error))
        if error[index] > 0.0:
            lower, upper = self.level[index : index + 2]
            arrived = f"{format_number(upper.pressure_hpa)} hPa at {format_number(upper.altitude_m)} m"
            expected = (
                f"about {lower.pressure_hpa * math.exp(-at_rest[index]):.1f} hPa, by the level below and the "
                "temperatures; altitudes are in m, pressures in hPa, temperatures in deg C"
            )
            return [Problem(f"level[{index + 1}].pressure_hpa", arrived, expected)]
        return []

    def _measured(self, offset_k: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        columns = np.array(
            [(x.altitude_m, x.pressure_hpa, x.temperature_c, x.relative_humidity_percent) for x in self.level]
        ).T
        pressure, temperature = 100.0 * columns[1], columns[2] + CELSIUS_K + offset_k
        virtual = virtual_temperature(temperature, pressure, columns[3] / 100.0)
        return geopotential_altitude(columns[0]), virtual, pressure

    def layers(self, offset_k: float) -> Layers:
        """Return the air between the levels, with temperatures raised by an offset (K), as layers (layer, 7).

        The columns are described in `anser.environment.air`.
        """
        return measured_layers(*self._measured(offset_k))


def _without_path(value: Any) -> Any:
    """Return a sounding's contents or None unchanged; raises ScenarioError for another value, such as a path."""
    if isinstance(value, dict | Sounding | None):
        return value
    raise problem_error("", describe_value(value), _SOUNDING_PATH)


class Atmosphere(Table):
    """Air other than the standard atmosphere: another temperature or pressure, humid, or measured by a sounding."""

    temperature_offset_k: float = number("temperature above the standard's, or the sounding's", -60, 60, "K", 0.0)
    sea_level_pressure_hpa: float | None = number(
        "pressure at sea level; left out: the standard's, 1013.25", 850, 1_100, "hPa", None
    )
    relative_humidity_percent: float | None = number(
        "relative humidity up to the tropopause; left out: dry", 0, 100, "%", None
    )
    sounding: Annotated[
        Sounding | None, BeforeValidator(_without_path), WithJsonSchema({"type": ["string", "object"]})
    ] = table("path of a sounding: CSV, or a text listing of a radiosonde", _SOUNDING_PATH, None)

    def consistency_problems(self) -> list[Problem]:
        """List a pressure at sea level or a humidity beside a sounding, which has its own."""
        if self.sounding is None:
            return []
        keys = ("sea_level_pressure_hpa", "relative_humidity_percent")
        given = [key for key in keys if getattr(self, key) is not None]
        expected = "no such key beside a sounding, which measured it"
        return [Problem(key, format_number(getattr(self, key)), expected) for key in given]

    @property
    def layers(self) -> Layers:
        """Layers of the air: array (layer, 7) with the columns described in `anser.environment.air`."""
        if self.sounding is not None:
            return self.sounding.layers(self.temperature_offset_k)
        pressure = SEA_LEVEL_PRESSURE_PA
        if self.sea_level_pressure_hpa is not None:
            pressure = 100.0 * self.sea_level_pressure_hpa
        if self.relative_humidity_percent is None:
            return standard_layers(self.temperature_offset_k, pressure)
        return humid_layers(self.relative_humidity_percent / 100.0, self.temperature_offset_k, pressure)

    def describe(self) -> str:
        """Describe the air for reports, such as "standard atmosphere, +10 K, 1000 hPa at sea level"."""
        offset = f"{self.temperature_offset_k:+g} K" if self.temperature_offset_k else ""
        if self.sounding is not None:
            levels = self.sounding.level
            heights = f"{levels[0].altitude_m:g} to {levels[-1].altitude_m:g} m"
            return " ".join(filter(None, [f"sounding of {len(levels)} levels from {heights}", offset]))
        parts = ["standard atmosphere", offset]
        parts += [] if self.sea_level_pressure_hpa is None else [f"{self.sea_level_pressure_hpa:g} hPa at sea level"]
        humidity = self.relative_humidity_percent
        parts += [] if humidity is None else [f"{humidity:g} % relative humidity"]
        return ", ".join(filter(None, parts))


INTENSITIES = {"light": (7.71667, 1e-2), "moderate": (15.43333, 1e-3), "severe": (23.15, 1e-5)}
"""Wind at 20 ft (m/s; 15, 30 and 45 kt) and probability of exceedance by intensity of turbulence, MIL-F-8785C."""


class Turbulence(Table):
    """Turbulence by MIL-F-8785C and MIL-HDBK-1797 (with the same numbers), independent for every aircraft."""

    intensity: Literal["none", "light", "moderate", "severe"] = Field(
        default="none",
        description="how strong: the wind at 20 ft below 1,000 ft, the probability of being exceeded above 2,000 ft",
    )
    spectrum: Literal["dryden", "von-karman"] = Field(default="dryden", description="form of the spectra")


class DiscreteGust(Table):
    """Gust of the form 1 - cos, which one aircraft or every aircraft flies into at the time `time_s`."""

    time_s: float = number("time at which the aircraft meets the gust", 0, DURATION_MAX_S, "s")
    aircraft: str | None = identifier("aircraft that meets the gust; left out: all", "the name of an aircraft", None)
    along_m_s: float = number("greatest velocity of the air along body x, forwards", -30, 30, "m/s", 0.0)
    right_m_s: float = number("the same along body y, to the right", -30, 30, "m/s", 0.0)
    up_m_s: float = number("the same along body z, upwards", -30, 30, "m/s", 0.0)
    length_m: float = number("distance flown through the air until the gust is greatest", 1, 10_000, "m", 120.0)
    returns: bool = Field(
        True,
        description="whether the gust decays as it grew; else it persists",
        json_schema_extra=expects("true or false"),
    )

    def consistency_problems(self) -> list[Problem]:
        """Return a problem if the gust has no velocity in any direction."""
        if self.along_m_s or self.right_m_s or self.up_m_s:
            return []
        return [Problem("up_m_s", "no strength in any direction", "along_m_s, right_m_s or up_m_s other than 0")]
