"""The tables of a scenario for air that is not smooth: turbulence and discrete gusts."""

from collections.abc import Sequence
from typing import Literal

from pydantic import Field

from anser.scenario.errors import Problem
from anser.scenario.schema_aircraft import Aircraft
from anser.scenario.schema_base import NAME_PATTERN, Table, choice, expects, number
from anser.scenario.schema_settings import DURATION_MAX_S

INTENSITIES = {"light": (7.71667, 1e-2), "moderate": (15.43333, 1e-3), "severe": (23.15, 1e-5)}
"""Wind at 20 ft (m/s; 15, 30 and 45 kt) and probability of being exceeded, by MIL-F-8785C."""


class Turbulence(Table):
    """Continuous gusts by MIL-F-8785C and MIL-HDBK-1797 (the same numbers), drawn for each aircraft by itself."""

    intensity: Literal["none", "light", "moderate", "severe"] = choice(
        "how strong: the wind at 20 ft below 1,000 ft, the probability of being exceeded above 2,000 ft",
        ("none", "light", "moderate", "severe"),
        "none",
    )
    spectrum: Literal["dryden", "von-karman"] = choice("form of the spectra", ("dryden", "von-karman"), "dryden")


class DiscreteGust(Table):
    """A gust of the form 1 - cos, met by one aircraft or by all."""

    time_s: float = number("when the aircraft meets it", 0, DURATION_MAX_S, "s")
    aircraft: str | None = Field(
        None,
        pattern=NAME_PATTERN,
        description="who meets it; left out: all",
        json_schema_extra=expects("the name of an aircraft"),
    )
    along_m_s: float = number("greatest velocity of the air along body x, forwards", -30, 30, "m/s", 0.0)
    right_m_s: float = number("the same along body y, to the right", -30, 30, "m/s", 0.0)
    up_m_s: float = number("the same along body z, upwards", -30, 30, "m/s", 0.0)
    length_m: float = number("way flown through the air until it is greatest", 1, 10_000, "m", 120.0)
    returns: bool = Field(
        True,
        description="whether it dies down again as it grew; else it stays",
        json_schema_extra=expects("true or false"),
    )

    def own_problems(self) -> list[Problem]:
        """Find a gust without strength."""
        if self.along_m_s or self.right_m_s or self.up_m_s:
            return []
        return [Problem("up_m_s", "no strength in any direction", "along_m_s, right_m_s or up_m_s other than 0")]


def gust_problems(gusts: Sequence[DiscreteGust], aircraft: Sequence[Aircraft]) -> list[Problem]:
    """Find gusts for aircraft that do not exist."""
    names = [one.name for one in aircraft]
    known = ", ".join(f'"{name}"' for name in names)
    return [
        Problem(f"gust[{k}].aircraft", f'"{gust.aircraft}"', f"the name of an aircraft of this scenario ({known})")
        for k, gust in enumerate(gusts)
        if gust.aircraft is not None and gust.aircraft not in names
    ]
