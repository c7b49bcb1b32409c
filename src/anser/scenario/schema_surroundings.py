"""The tables of a scenario that say what surrounds the flight: the Earth and the wind."""

import math
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, GetJsonSchemaHandler
from pydantic_core import CoreSchema

from anser.scenario.errors import Problem, ScenarioError, plain, show
from anser.scenario.schema_base import Table, Vector, between, choice, number, tables, velocity_on_course

_EARTHS = ("flat", "wgs84")
_WAYS = "either speed_m_s, from_deg and up_m_s, the same at all altitudes, or layers; not both"


class Earth(Table):
    """The Earth: flat, or rotating and round, and the place on it with north = east = 0."""

    model: Literal["flat", "wgs84"] = choice(
        "flat and at rest with one gravity, or the rotating WGS-84 ellipsoid with J2 gravitation", _EARTHS, "flat"
    )
    latitude_deg: float = number("geodetic latitude of the origin", -89.99, 89.99, "deg", 45.0)
    longitude_deg: float = number("longitude of the origin", -180, 180, "deg", 0.0)


def _from_word(value: Any) -> Any:
    """Read ``earth = "wgs84"`` as a table with that model."""
    if not isinstance(value, str):
        return value
    if value not in _EARTHS:
        words = " or ".join(f'"{word}"' for word in _EARTHS)
        raise ScenarioError("", [Problem("", show(value), f"{words}, or a table [earth]")])
    return {"model": value}


class _OrWord:
    """Adds the word to what the JSON Schema says of the table."""

    def __get_pydantic_json_schema__(self, core: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        return {"anyOf": [handler(core), {"enum": list(_EARTHS)}]}


EarthOrWord = Annotated[Earth, BeforeValidator(_from_word), _OrWord()]


class WindLayer(Table):
    """The wind at one altitude."""

    altitude_m: float = number("height above sea level", -500, 30_000, "m")
    speed_m_s: float = number("horizontal wind speed", 0, 150, "m/s")
    from_deg: float = number("direction that the wind comes from, clockwise from north", -360, 360, "deg", 0.0)
    up_m_s: float = number("vertical wind, positive upwards", -20, 20, "m/s", 0.0)


class Wind(Table):
    """The wind: steady and the same everywhere, or a shear profile."""

    speed_m_s: float = number("horizontal wind speed", 0, 100, "m/s", 0.0)
    from_deg: float = number("direction that the wind comes from, clockwise from north", -360, 360, "deg", 0.0)
    up_m_s: float = number("vertical wind, positive upwards", -20, 20, "m/s", 0.0)
    layers: tuple[WindLayer, ...] | None = tables(
        "the wind at rising altitudes, linear in between and as at the ends beyond",
        "a list of layers, at least one",
        at_least=1,
        default=None,
    )

    def own_problems(self) -> list[Problem]:
        """Find a wind given in both ways, and layers that do not rise."""
        if self.layers is None:
            return []
        steady = [key for key in ("speed_m_s", "from_deg", "up_m_s") if key in self.model_fields_set]
        found = [Problem(key, f"{plain(getattr(self, key))} beside layers", _WAYS) for key in steady]
        for index in range(1, len(self.layers)):
            below, here = self.layers[index - 1].altitude_m, self.layers[index].altitude_m
            if here <= below:
                words = f"more than the layer before it, {plain(below)} m"
                found.append(Problem(f"layers[{index}].altitude_m", plain(here), words))
        return found

    @property
    def profile_m_s(self) -> tuple[tuple[float, Vector], ...]:
        """Altitude (m) and velocity of the air over the ground (north, east, up; m/s) of each layer."""
        if self.layers is None:
            return ((0.0, _blowing(self)),)
        return tuple((layer.altitude_m, _blowing(layer)) for layer in self.layers)

    @property
    def greatest_m_s(self) -> float:
        """Greatest speed of the air over the ground at any altitude, m/s."""
        return max(math.hypot(*velocity) for _, velocity in self.profile_m_s)

    def velocity_m_s(self, altitude_m: float) -> Vector:
        """Velocity of the air over the ground (north, east, up), m/s, at an altitude, m."""
        return between(self.profile_m_s, altitude_m)


def _blowing(wind: Wind | WindLayer) -> Vector:
    return velocity_on_course(-wind.speed_m_s, wind.from_deg, wind.up_m_s)
