"""First part of a flight's report, as HTML: the verdict, the tightest margins, the aircraft."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from anser.report.flight_margins import Margin, closest_pair
from anser.report.page_templates import MISSING, format_number, render
from anser.results.arrival import arrival_accuracy, format_duration
from anser.results.separation import NO_SEPARATION, is_judged_by_separation

if TYPE_CHECKING:
    from markupsafe import Markup

_CARDS_PER_ROW = 4


def verdict_html(
    summary: Mapping[str, Any], scenario: Mapping[str, Any], margins: Sequence[Margin] = (), warning: str = ""
) -> "Markup":
    """Return the verdict on the flight as HTML.

    It states arrival, accuracy, failed aircraft, requirements not met, and exceeded limits.

    Parameters
    ----------
    summary, scenario
        Summary and scenario of the run; the scenario may be empty.
    margins
        Margins of the requirements and limits.
    warning
        Warning of two aircraft close to each other, or empty.
    """
    fleet, spread_s, accuracy = summary["aircraft"], summary["fleet"]["arrival_spread_s"], arrival_accuracy(summary)
    not_arrived = [aircraft for aircraft in fleet if aircraft["status"] != "arrived" and "left_s" not in aircraft]
    unmet = [entry["name"] for entry in summary["requirements"] if not entry["met"]]
    spread_max_s = next((e["limit"] for e in summary["requirements"] if e["name"] == "arrival_spread_max_s"), None)
    is_together = (
        accuracy.kind == "spread"
        and spread_s is not None
        and (spread_max_s is not None or scenario.get("arrival", {}).get("rule") in ("together", "at"))
    )
    exceeded = [margin for margin in margins if margin.kind == "limit" and not margin.is_met]
    if not_arrived or unmet:
        css_class, mark = "bad", "✗"
    else:
        css_class, mark = ("mixed", "!") if exceeded or warning else ("good", "✓")
    return render(
        "verdict.html",
        css_class=css_class,
        mark=mark,
        fleet_size=len(fleet),
        not_arrived=not_arrived,
        departed=[aircraft for aircraft in fleet if "left_s" in aircraft],
        accuracy=accuracy,
        is_together=is_together,
        spread_s=spread_s,
        spread_max_s=spread_max_s,
        unmet=unmet,
        events=summary.get("events", ()),
        network=summary.get("network"),
        is_judged_by_separation=is_judged_by_separation(summary),
        no_separation=NO_SEPARATION.capitalize(),
        warning=warning,
        exceeded=[_margin_row(margin) for margin in exceeded],
    )


def summary_cards(dataset: xr.Dataset, summary: Mapping[str, Any]) -> "Markup":
    """Return the cards with the main results of the fleet, as HTML."""
    aircraft_rows, fleet = summary["aircraft"], summary["fleet"]
    is_single = len(aircraft_rows) == 1
    arrivals = [aircraft["arrival_s"] for aircraft in aircraft_rows if aircraft["arrival_s"] is not None]
    cards = []
    if arrivals:
        cards.append(("Arrival", format_number(min(arrivals), 2), "s", "" if is_single else "of the first"))
    accuracy = arrival_accuracy(summary)
    if accuracy.value_s is not None:
        name, note = {
            "spread": ("Arrival spread", "first to last"),
            "spacing": ("Spacing error", f"greatest, of {accuracy.required_spacing_s or 0:g} s asked for"),
            "error": ("Off the planned time", "" if is_single else "greatest"),
        }[accuracy.kind]
        value, unit = format_duration(accuracy.value_s).split(" ")
        cards.append((name, value, unit, note))
    misses = [(aircraft["miss_m"], aircraft["name"]) for aircraft in aircraft_rows if "left_s" not in aircraft]
    never_arrived = [name for miss_m, name in misses if miss_m is None]
    if never_arrived:
        others_text = f" and {len(never_arrived) - 1} more" if len(never_arrived) > 1 else ""
        cards.append(("Greatest miss", MISSING, "", f"{never_arrived[0]}{others_text} never arrived"))
    elif misses:
        miss_m, name = max(misses)
        cards.append(("Greatest miss", format_number(miss_m, 2), "m", name))
    ratio = fleet.get("separation_ratio_min")
    if ratio is not None:
        cards.append(("Separation kept", format_number(ratio, 2), "×", "what was asked for, holds included"))
    pair = closest_pair(dataset)
    if pair is not None and fleet["separation_min_m"] is not None:
        pair_arrivals = [
            aircraft["arrival_s"]
            for aircraft in aircraft_rows
            if aircraft["name"] in pair[2:] and aircraft["arrival_s"] is not None
        ]
        phase_text = ", after arriving" if pair_arrivals and pair[1] > min(pair_arrivals) else ""
        note = f"at {format_number(pair[1], 1)} s{phase_text}: {pair[2]}, {pair[3]}"
        cards.append(("Least distance of two", format_number(fleet["separation_min_m"], 0), "m", note))
    return cards_html(cards)


def cards_html(cards: Sequence[tuple[str, str, str, str]]) -> "Markup":
    """Return cards as HTML, each given as heading, value, unit and note."""
    columns = len(cards) if len(cards) <= _CARDS_PER_ROW else -(-len(cards) // 2)  # two rows of almost equal length
    return render("cards.html", cards=cards, columns=columns)


def margins_list(margins: Sequence[Margin]) -> "Markup":
    """Return a list of bars as HTML: the utilization of each requirement and limit, in the given order."""
    return render("margins.html", margins=[_margin_row(margin) for margin in margins])


def aircraft_table(fleet: Sequence[Mapping[str, Any]]) -> "Markup":
    """Return the table of a summary's aircraft as HTML; older summaries lack the column with the type of path."""
    has_paths = all(aircraft.get("path") is not None for aircraft in fleet)
    return render("aircraft.html", fleet=fleet, columns=_COLUMNS, has_paths=has_paths)


_COLUMNS = [
    dict(zip(("key", "heading", "unit", "digits"), column, strict=True))
    for column in (
        ("planned_arrival_s", "Planned", "s", 2),
        ("arrival_s", "Arrived", "s", 2),
        ("miss_m", "Miss", "m", 2),
        ("speed_min_m_s", "Slowest", "m/s", 1),
        ("speed_mean_m_s", "Mean", "m/s", 1),
        ("speed_max_m_s", "Fastest", "m/s", 1),
        ("clearance_min_m", "Nearest to goal", "m", 1),
        ("position_error_max_m", "Off the plan", "m", 1),
        ("tables_left_s", "Outside tables", "s", 2),
    )
]
"""Columns of numbers in the table of the aircraft; each key is a key of an aircraft's entry in the summary."""


def _margin_row(margin: Margin) -> dict[str, Any]:
    """Return the texts of a margin for the template."""
    utilization = margin.utilization
    is_near = margin.after_arrival or (margin.is_met and utilization is not None and utilization > 0.9)
    unit = f" {margin.unit}" if margin.unit not in ("", "°") else margin.unit
    limit = f"{'at most' if margin.is_upper else 'at least'} {margin.limit:,g}".replace("-", "−") + unit
    time = "" if margin.time_s is None else f"{format_number(margin.time_s, 1)} s"
    return {
        "description": margin.description,
        "after_arrival": margin.after_arrival,
        "state": "near" if is_near else "kept" if margin.is_met else "over",
        "limit_text": limit if margin.kind == "requirement" else f"limit; {limit}",
        "value_text": MISSING if margin.value is None else f"{_significant(margin.value)}{unit}",
        "utilization_text": _percent(utilization),
        "bar_percent": 0.0 if utilization is None else min(100.0, 100.0 * utilization),
        "remark": "" if margin.is_met else "passed after the arrival" if margin.after_arrival else "not met",
        "context": ", ".join(text for text in (margin.aircraft, time) if text),
    }


def _percent(share: float | None) -> str:
    return MISSING if share is None else ">999 %" if share > 9.99 else f"{100 * share:.0f} %"


def _significant(value: float) -> str:
    """Format with three significant digits; integers from 1000 on, at most five decimals."""
    if not np.isfinite(value) or abs(value) >= 1000:
        return format_number(value, 0)
    return format_number(value, max(0, min(5, 2 - int(np.floor(np.log10(max(abs(value), 1e-4)))))))
