"""Summary of a flight as a few lines of text, and as an HTML table."""

from collections.abc import Mapping, Sequence
from typing import Any

from anser.results.arrival import AS_PLANNED, arrival_accuracy
from anser.results.documents import notebook_table
from anser.results.faults import fault_lines
from anser.results.separation import NO_SEPARATION, is_judged_by_separation

_AIRCRAFT_LINES_MAX = 6  # in the text
_TABLE_ROWS_MAX = 40  # in the HTML table


def format_summary(summary: Mapping[str, Any]) -> str:
    """Return a summary as text: verdict, a line for each of the first aircraft (up to six), results of the fleet."""
    entries = summary["aircraft"]
    shown = entries if len(entries) <= _AIRCRAFT_LINES_MAX else entries[: _AIRCRAFT_LINES_MAX - 1]
    lines = [
        format_verdict(summary),
        *(f"  {_aircraft_line(entry)}" for entry in shown),
        *(f"  {line}" for line in _omitted_aircraft(entries, shown)),
    ]
    return "\n".join([*lines, *(f"  {line}" for line in _fleet_lines(summary))])


def format_summary_html(summary: Mapping[str, Any]) -> str:
    """Return a summary as HTML for a notebook: verdict, a table of the first aircraft (up to 40), fleet results."""
    entries = summary["aircraft"]
    shown = entries if len(entries) <= _TABLE_ROWS_MAX else entries[: _TABLE_ROWS_MAX - 1]
    cells = [
        {
            "aircraft": entry["name"],
            "status": entry["status"],
            "arrived, s": _format_number(entry["arrival_s"]),
            "planned, s": _format_number(entry["planned_arrival_s"]),
            "miss, m": _format_number(entry["miss_m"]),
        }
        for entry in shown
    ]
    return notebook_table(format_verdict(summary), cells, [*_omitted_aircraft(entries, shown), *_fleet_lines(summary)])


def format_verdict(summary: Mapping[str, Any]) -> str:
    """Return the verdict on a flight in one line: number of arrivals, and names of the requirements not met."""
    entries = summary["aircraft"]
    arrived = sum(entry["status"] == "arrived" for entry in entries)
    unmet = [requirement["name"] for requirement in summary["requirements"] if not requirement["met"]]
    verdict = f"not met: {', '.join(unmet)}" if unmet else "all requirements met"
    if not unmet and not is_judged_by_separation(summary):
        verdict += f", {NO_SEPARATION}"
    departed = sum("left_s" in entry for entry in entries)
    if arrived + departed < len(entries) and not unmet:
        # an aircraft that crashes or breaks off after the arrival still meets every requirement
        verdict = "the flight failed"
    return f"{summary['scenario']['name']}: {arrived} of {len(entries)} aircraft arrived, {verdict}"


def _omitted_aircraft(entries: Sequence[Mapping[str, Any]], shown: Sequence[Mapping[str, Any]]) -> list[str]:
    if len(entries) == len(shown):
        return []
    failed = sum(entry["status"] not in AS_PLANNED for entry in entries[len(shown) :])
    return [f"and {len(entries) - len(shown)} more, of which {failed or 'none'} failed"]


def _fleet_lines(summary: Mapping[str, Any]) -> list[str]:
    fleet = summary["fleet"]
    lines = [", ".join([*format_fleet(summary), f"{fleet['simulated_s']:g} s flown"])]
    faults = fault_lines(summary)
    lines += faults[:_AIRCRAFT_LINES_MAX]
    if len(faults) > _AIRCRAFT_LINES_MAX:
        lines.append(f"and {len(faults) - _AIRCRAFT_LINES_MAX} more aircraft with a fault")
    if "network" in summary:
        lines.append(f"without a centre: {summary['network']['message']}")
    return lines


def format_fleet(summary: Mapping[str, Any]) -> list[str]:
    """Return accuracy of the arrivals and least distance of two aircraft as texts, if available."""
    separation_m = summary["fleet"]["separation_min_m"]
    arrivals = arrival_accuracy(summary).describe(len(summary["aircraft"]))
    return [
        *([arrivals] if arrivals else []),
        *([] if separation_m is None else [f"least separation {separation_m:.0f} m"]),
    ]


def _format_number(value: float | None) -> str:
    return "–" if value is None else f"{value:.2f}"


def _aircraft_line(entry: Mapping[str, Any]) -> str:
    if entry["status"] != "arrived":
        return f"{entry['name']}: {entry['status']}"
    return (
        f"{entry['name']}: arrived at {entry['arrival_s']:.2f} s, planned {entry['planned_arrival_s']:.2f} s, "
        f"miss {entry['miss_m']:.2f} m"
    )
