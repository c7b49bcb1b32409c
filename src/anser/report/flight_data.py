"""What the page gets of a flight to draw: packed variables, labels, events, facts of each aircraft; as plain data."""

import json
from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from anser.report.flight_events import LIMITED, RENEWALS, events_of
from anser.report.flight_panels import needed_variables, packed_variables, sections_for
from anser.report.goal_forms import goal_forms
from anser.report.labels import label_of
from anser.report.packing import pack, step_of

_SAMPLES_MAX = 150_000  # of all aircraft together: 20 aircraft at 10 Hz for 750 s
_TIMES_MAX = 12_000
_SUMMARY_KEYS = ("scenario", "versions", "seed", "aircraft", "fleet", "requirements")
_FACT_KEYS = ("name", "goal", "planned_arrival_s", "arrival_s", "miss_m", "status")
_ROW_KEYS = (
    *_FACT_KEYS,
    *("speed_min_m_s", "speed_mean_m_s", "speed_max_m_s", "clearance_min_m", "position_error_max_m", "tables_left_s"),
)


def check_flight(dataset: xr.Dataset, summary: Mapping[str, Any]) -> None:
    """Refuse what cannot be reported.

    Raises
    ------
    ValueError
        The dataset lacks a variable, the summary a key, or dataset and summary are not of one flight.
    """
    missing = [name for name in needed_variables(dataset) if name not in dataset.data_vars]
    if missing:
        raise ValueError(f"the dataset lacks {', '.join(missing)}, which the report draws")
    lacking = [key for key in _SUMMARY_KEYS if key not in summary]
    rows = [] if lacking else summary["aircraft"]
    lacking += [f"aircraft.{key}" for key in _ROW_KEYS if any(key not in row for row in rows)]
    if lacking:
        raise ValueError(f"the summary lacks {', '.join(lacking)}, which the report tells")
    flown, summarized = [str(name) for name in dataset["aircraft"].values], [row["name"] for row in summary["aircraft"]]
    if flown != summarized:
        raise ValueError(f"the dataset holds the aircraft {flown}, the summary {summarized}")
    of_dataset, of_summary = dataset.attrs.get("scenario_hash"), summary["scenario"]["hash"]
    if of_dataset is not None and of_dataset != of_summary:
        raise ValueError(f"the dataset is of scenario {of_dataset}, the summary {of_summary}")


def flight_data(
    dataset: xr.Dataset, summary: Mapping[str, Any], scenario: Mapping[str, Any], label: str
) -> dict[str, Any]:
    """Collect what the page draws of one flight.

    Parameters
    ----------
    dataset
        The flight with its derived variables.
    summary
        As `summary.json` holds it.
    scenario
        As the dataset carries it; may be empty.
    label
        What the run is called on the page.

    Returns
    -------
    dict
        For JSON. Variables come packed, every `every`-th record of them.
    """
    every = max(
        1,
        -(-dataset.sizes["time"] * dataset.sizes["aircraft"] // _SAMPLES_MAX),
        -(-dataset.sizes["time"] // _TIMES_MAX),
    )
    kept = np.unique(np.append(np.arange(0, dataset.sizes["time"], every), dataset.sizes["time"] - 1))
    names = packed_variables(dataset)
    time = dataset["time"].values[kept][:, None]
    columns = [(time, step_of(time, "s"))]
    for name in names:
        values = np.asarray(dataset[name].values[kept], dtype=np.float64)
        columns.append((values, step_of(values, str(dataset[name].attrs["units"]))))
    packed, gaps = pack(columns)
    variables = {
        name: label_of(dataset[name]) | {"place": k, "step": columns[k][1], "gaps": gaps[k]}
        for k, name in enumerate(names, start=1)
    }
    return {
        "label": label,
        "times": int(kept.size),
        "every": every,
        "timeStep": columns[0][1],
        "aircraft": [
            {key: row[key] for key in _FACT_KEYS} | {"form": form, "before": before}
            for row, form, before in zip(
                summary["aircraft"], goal_forms(dataset, scenario), _goals_before(summary, scenario), strict=True
            )
        ],
        "variables": variables,
        "packed": packed,
        "events": events_of(dataset),
        "eventWords": {"renewals": RENEWALS, "limited": list(LIMITED.values())},
        "sections": sections_for(dataset),
        "keepOuts": scenario.get("keep_out") or [],
    }


def _goals_before(summary: Mapping[str, Any], scenario: Mapping[str, Any]) -> list[list[Any] | None]:
    """Of each aircraft that took over another's goal: its own goal, and until when, s, it flew to that."""
    own = {str(one["name"]): str(one["goal"]) for one in scenario.get("aircraft") or [] if "goal" in one}
    events = [one for one in summary.get("events", ()) if one["kind"] == "goal-taken-over"]
    until = {str(one["whom"]): float(one["time_s"]) for one in events}
    names = [str(row["name"]) for row in summary["aircraft"]]
    return [[own[name], until[name]] if name in own and name in until else None for name in names]


def as_script(data: Any) -> str:
    """JSON that can stand within a script element: nothing in it ends the element or begins another."""
    text = json.dumps(data, ensure_ascii=True, allow_nan=False, separators=(",", ":"))
    return text.replace("&", "\\u0026").replace("<", "\\u003c").replace(">", "\\u003e")
