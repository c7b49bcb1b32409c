"""The summary of a flight in a few lines of text."""

from collections.abc import Mapping, Sequence
from typing import Any

from anser.results.arrival import arrival_accuracy
from anser.results.documents import notebook_table
from anser.results.separation import NO_SEPARATION, is_judged_by_separation

_AIRCRAFT_MOST = 6  # with a line each
_ROWS_MOST = 40  # of a table


def format_summary(summary: Mapping[str, Any]) -> str:
    """Say who arrived when, how far they missed, and what was not met; of a large fleet the first aircraft only."""
    rows = summary["aircraft"]
    shown = rows if len(rows) <= _AIRCRAFT_MOST else rows[: _AIRCRAFT_MOST - 1]
    lines = [
        _judgement(summary),
        *(f"  {_aircraft(row)}" for row in shown),
        *(f"  {one}" for one in _rest(rows, shown)),
    ]
    return "\n".join([*lines, *(f"  {one}" for one in _fleet(summary))])


def format_summary_html(summary: Mapping[str, Any]) -> str:
    """Say the same as a table in a notebook."""
    rows = summary["aircraft"]
    shown = rows if len(rows) <= _ROWS_MOST else rows[: _ROWS_MOST - 1]
    cells = [
        {
            "aircraft": row["name"],
            "status": row["status"],
            "arrived, s": _number(row["arrival_s"]),
            "planned, s": _number(row["planned_arrival_s"]),
            "miss, m": _number(row["miss_m"]),
        }
        for row in shown
    ]
    return notebook_table(_judgement(summary), cells, [*_rest(rows, shown), *_fleet(summary)])


def _judgement(summary: Mapping[str, Any]) -> str:
    rows = summary["aircraft"]
    arrived = sum(row["status"] == "arrived" for row in rows)
    unmet = [entry["name"] for entry in summary["requirements"] if not entry["met"]]
    judged = f"not met: {', '.join(unmet)}" if unmet else "all requirements met"
    if not unmet and not is_judged_by_separation(summary):
        judged += f", {NO_SEPARATION}"
    left = sum("left_s" in row for row in rows)
    if arrived + left < len(rows) and not unmet:
        # one that ends on the ground or breaks off after its arrival has kept every number that is required of it
        judged = "the flight failed"
    return f"{summary['scenario']['name']}: {arrived} of {len(rows)} aircraft arrived, {judged}"


def _rest(rows: Sequence[Mapping[str, Any]], shown: Sequence[Mapping[str, Any]]) -> list[str]:
    if len(rows) == len(shown):
        return []
    stray = sum(row["status"] != "arrived" for row in rows[len(shown) :])
    return [f"and {len(rows) - len(shown)} more, of which {stray or 'none'} failed"]


def _fleet(summary: Mapping[str, Any]) -> list[str]:
    fleet = summary["fleet"]
    lines = [", ".join([*format_fleet(summary), f"{fleet['simulated_s']:g} s flown"])]
    if "network" in summary:
        lines.append(f"without a centre: {summary['network']['message']}")
    return lines


def format_fleet(summary: Mapping[str, Any]) -> list[str]:
    """Say how well the arrivals fit and how near two aircraft came, as far as there is such a number."""
    apart_m = summary["fleet"]["separation_min_m"]
    arrivals = arrival_accuracy(summary).describe(len(summary["aircraft"]))
    return [*([arrivals] if arrivals else []), *([] if apart_m is None else [f"least separation {apart_m:.0f} m"])]


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.2f}"


def _aircraft(row: Mapping[str, Any]) -> str:
    if row["status"] != "arrived":
        return f"{row['name']}: {row['status']}"
    return (
        f"{row['name']}: arrived at {row['arrival_s']:.2f} s, planned {row['planned_arrival_s']:.2f} s, "
        f"miss {row['miss_m']:.2f} m"
    )
