"""Limits that a planned path is held against, and the margins that it leaves to them."""

from dataclasses import dataclass

import numpy as np
import xarray as xr

from anser.units import RAD_DEG

__all__ = ["PLAN_LIMITS", "PlanLimit", "plan_margins"]

_UNITS = {"m": ("m", 1.0), "m_s": ("m s-1", 1.0), "m_s2": ("m s-2", 1.0), "deg": ("degree", RAD_DEG), "": ("1", 1.0)}


@dataclass(frozen=True)
class PlanLimit:
    """One limit of a path.

    Attributes
    ----------
    key
        Name of the extreme that it bounds: "airspeed_min".
    suffix
        Unit of a name in a dataset: "m_s"; empty for a pure number.
    least
        Whether it bounds from below.
    words
        What it is.
    """

    key: str
    suffix: str
    least: bool
    words: str

    @property
    def name(self) -> str:
        """Name with the unit."""
        return f"{self.key}_{self.suffix}" if self.suffix else self.key

    @property
    def unit(self) -> str:
        """Unit in a dataset, as CF writes it."""
        return _UNITS[self.suffix][0]

    @property
    def factor(self) -> float:
        """Dataset value divided by the value in SI units or radians."""
        return _UNITS[self.suffix][1]


PLAN_LIMITS = (
    PlanLimit("airspeed_min", "m_s", True, "least airspeed"),
    PlanLimit("airspeed_max", "m_s", False, "greatest airspeed"),
    PlanLimit("bank_max", "deg", False, "bank angle"),
    PlanLimit("load_factor_max", "", False, "load factor"),
    PlanLimit("climb_rate_max", "m_s", False, "rate of climb or descent"),
    PlanLimit("altitude_min", "m", True, "least altitude"),
    PlanLimit("altitude_max", "m", False, "greatest altitude"),
    PlanLimit("level_off_min", "m", True, "least altitude of the level-off after the arrival"),
    PlanLimit("thrust_surplus_max", "m_s2", False, "acceleration"),
    PlanLimit("thrust_deficit_max", "m_s2", False, "deceleration"),
)
"""Every limit, in the order in which it is shown."""


def plan_margins(dataset: xr.Dataset) -> dict[str, np.ndarray]:
    """What a plan leaves to each limit, by the limit's name; (aircraft,), in its unit, negative where it is passed.

    Parameters
    ----------
    dataset
        As `anser.results.plan_dataset` makes it. Where a bound is proven the margin is that of the bound, else that of
        the samples; NaN where there is no limit.
    """
    found = {}
    for limit in PLAN_LIMITS:
        proven = f"bound_{limit.name}"
        worst = dataset[proven if proven in dataset else limit.name].values
        room = worst - dataset[f"limit_{limit.name}"].values
        found[limit.name] = room if limit.least else -room
    return found
