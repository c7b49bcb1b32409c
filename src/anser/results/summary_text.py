"""The summary of a flight in a few lines of text."""

from collections.abc import Mapping
from typing import Any

_AIRCRAFT_MOST = 6  # with a line each


def summary_text(summary: Mapping[str, Any]) -> str:
    """Say who arrived when, how far they missed, and what was not met; of a large fleet the first aircraft only."""
    rows, fleet = summary["aircraft"], summary["fleet"]
    arrived = sum(row["status"] == "arrived" for row in rows)
    unmet = [entry["name"] for entry in summary["requirements"] if not entry["met"]]
    judged = f"not met: {', '.join(unmet)}" if unmet else "all requirements met"
    left = sum("left_s" in row for row in rows)
    if arrived + left < len(rows) and not unmet:
        # one that ends on the ground or breaks off after its arrival has kept every number that is required of it
        judged = "the flight failed"
    lines = [f"{summary['scenario']['name']}: {arrived} of {len(rows)} aircraft arrived, {judged}"]
    shown = rows if len(rows) <= _AIRCRAFT_MOST else rows[: _AIRCRAFT_MOST - 1]
    lines += [f"  {_aircraft(row)}" for row in shown]
    if len(rows) > len(shown):
        stray = sum(row["status"] != "arrived" for row in rows[len(shown) :])
        lines.append(f"  and {len(rows) - len(shown)} more, of which {stray or 'none'} failed")
    words = (("arrival_spread_s", "arrival spread {:.4f} s"), ("separation_min_m", "least separation {:.0f} m"))
    known = [form.format(fleet[key]) for key, form in words if fleet[key] is not None and len(rows) > 1]
    lines.append("  " + ", ".join([*known, f"{fleet['simulated_s']:g} s flown"]))
    if "network" in summary:
        lines.append(f"  without a centre: {summary['network']['message']}")
    return "\n".join(lines)


def _aircraft(row: Mapping[str, Any]) -> str:
    if row["status"] != "arrived":
        return f"{row['name']}: {row['status']}"
    return (
        f"{row['name']}: arrived at {row['arrival_s']:.2f} s, planned {row['planned_arrival_s']:.2f} s, "
        f"miss {row['miss_m']:.2f} m"
    )
