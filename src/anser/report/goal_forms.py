"""What a goal is drawn as: by where it is, which the scenario says, and how it moves, which the record says."""

import html
from collections.abc import Collection, Mapping
from typing import Any

import numpy as np
import xarray as xr

_STILL_M_S = 1.0  # slower than a ship keeps steerage, as fast as a current sets a buoy adrift
_DRIFTING_M_S = 30.0  # slower than wings carry, as fast as a gale: what drifts with the air
_PATHS = {
    "ship": "M1 9H15L13 13H4ZM5 8V5H9V8ZM6 4V2H8V4Z",
    "buoy": "M3 11H13L11 14H5ZM5 10L7 4H9L11 10ZM6 3V1H10V3Z",
    "drifting": "M5 13a4 4 0 0 1 -1 -7.5a4.2 4.2 0 0 1 8 -0.5a3.8 3.8 0 0 1 0 8Z",
    "flying": "M15 8L2 13L5 8L2 3Z",
    "goal": "M8 2L14 8L8 14L2 8Z",
}
WORDS = {
    "ship": "goal under way on the surface (ship, boat)",
    "buoy": "goal at rest or adrift on the surface (buoy)",
    "drifting": "goal in the air, at rest or drifting (storm cell, balloon)",
    "flying": "goal in the air, faster than a gale (aircraft)",
    "goal": "goal",
}
"""Forms by their names, in words for a key."""


def goal_forms(dataset: xr.Dataset, scenario: Mapping[str, Any]) -> list[str]:
    """Form of the goal of each aircraft, a key of `WORDS`: "goal" where the scenario does not say where it is.

    Parameters
    ----------
    dataset
        The flight, with its goals as it holds them for each aircraft.
    scenario
        As the dataset carries it; may be empty.
    """
    kinds = {str(goal["name"]): str(goal.get("kind", "")) for goal in scenario.get("goal") or []}
    goal_of = {str(one["name"]): str(one.get("goal", "")) for one in scenario.get("aircraft") or []}
    time = dataset["time"].values
    return [
        _form(kinds.get(goal_of.get(str(name), ""), ""), _speed_m_s(dataset.isel(aircraft=k), time))
        for k, name in enumerate(dataset["aircraft"].values)
    ]


def goals_key(forms: Collection[str]) -> str:
    """Entries of the scene's key for the forms that are drawn, HTML."""
    return "".join(
        f'<span><svg class="mark" viewBox="0 0 16 16" aria-hidden="true"><path d="{_PATHS[form]}"/></svg>'
        f"{html.escape(words)}</span>"
        for form, words in WORDS.items()
        if form in forms
    )


def _form(kind: str, speed_m_s: float) -> str:
    if kind == "surface":
        return "ship" if speed_m_s > _STILL_M_S else "buoy"
    if kind == "airborne":
        return "flying" if speed_m_s > _DRIFTING_M_S else "drifting"
    return "goal"


def _speed_m_s(one: xr.Dataset, time: np.ndarray) -> float:
    """Speed of a goal for most of the record; 0 where it has no two places."""
    place = np.stack([one[f"goal_{axis}_m"].values for axis in ("north", "east", "altitude")])
    known = np.isfinite(place).all(axis=0)
    if known.sum() < 2:
        return 0.0
    return float(np.median(np.linalg.norm(np.diff(place[:, known]), axis=0) / np.diff(time[known])))
