"""Air and Earth of a flight of one aircraft, from the tables of a scenario file."""

import os
from collections.abc import Mapping, Sequence
from typing import Any, cast

import numpy as np
from pydantic import ValidationError

from anser.aircraft.airframe import AbstractAirframe
from anser.aircraft_files.library import span_of
from anser.config.errors import Problem, ScenarioError, format_number
from anser.config.tables import Table, table, tables, whole_number
from anser.config.validation_messages import validation_problems
from anser.environment.environment import Environment, standard_environment
from anser.environment.gusts import AbstractGusts
from anser.scenario.build_environment import build_atmosphere, build_environment, build_gusts, build_wind
from anser.scenario.schema import Scenario, insert_sounding
from anser.scenario.schema_environment import Atmosphere, DiscreteGust, Earth, EarthField, Turbulence, Wind
from anser.scenario.schema_tables import SEED_MAX


class Air(Table):
    """Earth, atmosphere, wind, turbulence and discrete gusts of one aircraft's flight, as tables of a scenario file."""

    earth: EarthField | None = table("the Earth and its origin", 'a table, or the word "flat" or "wgs84"', None)
    atmosphere: Atmosphere | None = table("air off the standard", "a table of an atmosphere", None, omit_default=True)
    wind: Wind = table("wind", "a table of wind", Wind())
    turbulence: Turbulence = table("gusts of the air", "a table of turbulence", Turbulence())
    gust: tuple[DiscreteGust, ...] = tables("single gusts", "a list of tables", at_least=0, default=())
    seed: int = whole_number("seed of the random numbers", 0, SEED_MAX, 0)

    @property
    def name(self) -> str:
        """Name "aircraft" of the single aircraft, to which gusts of a scenario file can refer."""
        return "aircraft"

    @property
    def is_random(self) -> bool:
        """Whether the air has turbulence, which depends on the seed."""
        return self.turbulence.intensity != "none"

    def consistency_problems(self) -> list[Problem]:
        """Return a problem for each gust of another aircraft, which would have no effect."""
        return [
            Problem(f"gust[{k}].aircraft", f'"{gust.aircraft}"', f'nothing, or "{self.name}"')
            for k, gust in enumerate(self.gust)
            if gust.aircraft not in (None, self.name)
        ]

    def refuse_late_gusts(self, duration_s: float) -> None:
        """Raise ScenarioError if a gust begins after the end of a flight of `duration_s`."""
        expected = f"a time before the end of the flight, duration_s = {format_number(duration_s)} s"
        late = [
            Problem(f"gust[{k}].time_s", format_number(gust.time_s), expected)
            for k, gust in enumerate(self.gust)
            if gust.time_s >= duration_s
        ]
        if late:
            raise ScenarioError("air and Earth", late)

    def describe(self) -> str:
        """Return a text on Earth, atmosphere (if not standard), wind, turbulence with its seed, and number of gusts."""
        earth = "flat Earth, standard gravity" if self.earth is None else f"Earth {self.earth.model}"
        uniform = f"wind {self.wind.speed_m_s:g} m/s from {self.wind.from_deg:g} deg, {self.wind.up_m_s:g} m/s up"
        wind = "wind by layers" if self.wind.layers is not None else uniform
        if self.wind.field is not None:
            wind = f"wind field of SHA-256 {self.wind.field.sha256[:12]}, member {self.wind.member}"
        is_calm = self.wind.speed_max_m_s == 0.0
        turbulence = f"{self.turbulence.intensity} turbulence, seed {self.seed}"
        parts = [earth] if self.atmosphere is None else [earth, self.atmosphere.describe()]
        parts += ["no wind" if is_calm else wind]
        parts += [turbulence] if self.is_random else []
        parts += [f"{len(self.gust)} gusts"] if self.gust else []
        return "; ".join(parts)

    def environment(self) -> Environment:
        """Return atmosphere, wind and Earth; if `earth` is None, the Earth is flat with standard gravity."""
        if self.earth is None:
            standard = standard_environment()
            return Environment(build_atmosphere(self.atmosphere), build_wind(cast(Scenario, self)), standard.earth)
        return build_environment(cast(Scenario, self))

    def gusts(self, airframe: AbstractAirframe) -> AbstractGusts:
        """Return the gusts at an aircraft: turbulence, which depends on the wing span, and discrete gusts."""
        span_m = span_of(airframe) if self.is_random else 0.0
        return build_gusts(cast(Scenario, self), cast(Any, self), span_m)


def read_air(
    earth: str | Mapping[str, Any] | Earth | None = None,
    wind: Mapping[str, Any] | Wind | None = None,
    turbulence: str | Mapping[str, Any] | Turbulence | None = None,
    gust: Sequence[Mapping[str, Any] | DiscreteGust] = (),
    seed: int = 0,
    atmosphere: Mapping[str, Any] | Atmosphere | None = None,
) -> Air:
    """Return the air of a flight from tables as in a scenario file; `turbulence` may be a word such as "moderate".

    None: flat Earth with standard gravity, no wind, no turbulence, standard atmosphere. The path of a sounding is
    relative to the working folder. Raises ScenarioError if a table is not valid.
    """
    seed = seed.item() if isinstance(seed, np.integer) else seed
    if isinstance(turbulence, str):
        turbulence = {"intensity": turbulence}
    values: dict[str, Any] = {"earth": earth, "atmosphere": atmosphere, "wind": wind, "turbulence": turbulence}
    values = {key: value for key, value in values.items() if value is not None} | {"gust": tuple(gust), "seed": seed}
    values = {key: _with_text_paths(table) for key, table in values.items()}
    values = insert_sounding(values, "air and Earth")
    try:
        return Air.model_validate(values)
    except ValidationError as error:
        raise ScenarioError("air and Earth", validation_problems(error, Air, values)) from None


def _with_text_paths(table: Any) -> Any:
    """Return a table with the paths of files as texts; another value is returned unchanged."""
    if not isinstance(table, Mapping):
        return table
    return {key: os.fspath(value) if isinstance(value, os.PathLike) else value for key, value in table.items()}
