"""Opening section of a flight report, as HTML: the verdict, the tightest margins, the aircraft."""

import html
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from anser.report.flight_margins import Margin, closest_pair
from anser.report.style import page_color_of
from anser.results.arrival import arrival_accuracy, format_duration
from anser.results.separation import NO_SEPARATION, is_judged_by_separation

_MISSING = "–"
_CARDS_PER_ROW = 4


def escape_html(value: object) -> str:
    """Escape text from files, so that a browser shows it without interpreting it."""
    return html.escape(str(value))


def format_number(value: float | None, digits: int) -> str:
    """Number with a fixed number of decimals and thousands separators; a dash for None."""
    if value is None or not np.isfinite(value):
        return _MISSING
    return f"{value:,.{digits}f}".replace("-", "−")


def scroll_table(header: str, body: str) -> str:
    """HTML table from header cells and body rows; wider than the page, it scrolls."""
    table = f"<table><thead><tr>{header}</tr></thead><tbody>{body}</tbody></table>"
    return f'<div class="scroll" tabindex="0" role="group" aria-label="Table">{table}</div>'


def verdict_html(
    summary: Mapping[str, Any], scenario: Mapping[str, Any], margins: Sequence[Margin] = (), warning: str = ""
) -> str:
    """Verdict on the flight: arrival, accuracy, failed aircraft, requirements not met, and exceeded limits.

    Parameters
    ----------
    summary, scenario
        Summary and scenario of the run; the scenario may be empty.
    margins
        Margins of the requirements and limits.
    warning
        Warning of two aircraft close to each other, or empty.
    """
    fleet, spread, accuracy = summary["aircraft"], summary["fleet"]["arrival_spread_s"], arrival_accuracy(summary)
    departed = [aircraft for aircraft in fleet if "left_s" in aircraft]
    not_arrived = [aircraft for aircraft in fleet if aircraft["status"] != "arrived" and "left_s" not in aircraft]
    unmet = [entry["name"] for entry in summary["requirements"] if not entry["met"]]
    spread_max = next((e["limit"] for e in summary["requirements"] if e["name"] == "arrival_spread_max_s"), None)
    together = (
        accuracy.kind == "spread"
        and spread is not None
        and (spread_max is not None or scenario.get("arrival", {}).get("rule") in ("together", "at"))
    )
    spread_text = "" if spread is None else _duration(spread)
    is_success = not not_arrived and not unmet
    exceeded = [margin for margin in margins if margin.kind == "limit" and not margin.is_met]
    if not_arrived or departed:
        count = len(fleet) - len(not_arrived) - len(departed)
        head = f"{count} of {len(fleet)} aircraft arrived" if len(fleet) > 1 else "The aircraft failed"
    elif together and "arrival_spread_max_s" in unmet:
        head = f"All {len(fleet)} aircraft arrived, but {spread_text} apart"
    elif together:
        head = f"All {len(fleet)} aircraft arrived together, within {spread_text}"
    elif accuracy.kind == "spacing" and accuracy.value_s is not None:
        head = (
            f"All {len(fleet)} aircraft arrived {accuracy.required_spacing_s:g}&nbsp;s apart, within "
            f"{_duration(accuracy.value_s)}"
        )
    else:
        head = f"All {len(fleet)} aircraft arrived as planned" if len(fleet) > 1 else "The aircraft arrived as planned"
    if not is_success and not not_arrived and "arrival_spread_max_s" not in unmet:
        head += ", but not as required"
    parts = [] if spread_max is None or not together else [f"{format_number(spread_max, 2)} s apart were allowed."]
    parts += [
        f"<b>{escape_html(aircraft['name'])}</b>: {escape_html(aircraft['status'])}."
        for aircraft in (*not_arrived, *departed)
    ]
    parts += [
        f"At {format_number(event['time_s'], 1)} s {escape_html(event['kind'].replace('-', ' '))} "
        f"({escape_html(event['whom'])}): "
        f"{escape_html(event['message'])}."
        for event in summary.get("events", ())
    ]
    network = summary.get("network")
    if network:
        message = escape_html(network["message"])
        message = message if network["condition_met"] else f"<b>{message}</b>"
        parts.append(f"Without a centre: {message}.")
    if unmet:
        parts.append(f"Requirements not met: <b>{escape_html(', '.join(unmet))}</b>.")
    elif is_success:
        parts.append("All requirements met." if not exceeded else "All requirements met, but not all limits kept.")
    if not is_judged_by_separation(summary):
        parts.append(f"{NO_SEPARATION.capitalize()}.")
    if warning:
        parts.append(f"<b>Warning:</b> {escape_html(warning)}.")
    if exceeded:
        parts.append(f"Passed: {_exceeded_limits(exceeded)}.")
    css_class, mark = ("bad", "✗") if not is_success else ("mixed", "!") if exceeded or warning else ("good", "✓")
    return (
        f'<div class="answer {css_class}"><p class="head"><span aria-hidden="true">'
        f"{mark}</span> {head}</p><p>{' '.join(parts)}</p></div>"
    )


def _exceeded_limits(margins: Sequence[Margin]) -> str:
    """Exceeded limits, with a note if exceeded only in the hold."""
    time_note = {True: ", after the arrival", False: ""}
    return "; ".join(
        f"<b>{escape_html(margin.description)}</b> ({_utilization_text(margin)} of its limit"
        f"{time_note[margin.after_arrival]})"
        for margin in margins
    )


def summary_cards(dataset: xr.Dataset, summary: Mapping[str, Any]) -> str:
    """Cards with the main figures of the fleet."""
    fleet_table, fleet = summary["aircraft"], summary["fleet"]
    arrivals = [aircraft["arrival_s"] for aircraft in fleet_table if aircraft["arrival_s"] is not None]
    cards = []
    if arrivals:
        cards.append(
            ("Arrival", f"{format_number(min(arrivals), 2)}", "s", "" if len(fleet_table) == 1 else "of the first")
        )
    accuracy = arrival_accuracy(summary)
    if accuracy.value_s is not None:
        name, note = {
            "spread": ("Arrival spread", "first to last"),
            "spacing": ("Spacing error", f"greatest, of {accuracy.required_spacing_s or 0:g} s asked for"),
            "error": ("Off the planned time", "" if len(fleet_table) == 1 else "greatest"),
        }[accuracy.kind]
        cards.append((name, *_duration(accuracy.value_s).split("&nbsp;"), note))
    misses = [(aircraft["miss_m"], aircraft["name"]) for aircraft in fleet_table if "left_s" not in aircraft]
    never_arrived = [name for miss_m, name in misses if miss_m is None]
    if never_arrived:
        others_text = f" and {len(never_arrived) - 1} more" if len(never_arrived) > 1 else ""
        cards.append(("Greatest miss", _MISSING, "", f"{escape_html(never_arrived[0])}{others_text} never arrived"))
    elif misses:
        worst = max(misses)
        cards.append(("Greatest miss", format_number(worst[0], 2), "m", escape_html(worst[1])))
    if fleet.get("separation_ratio_min") is not None:
        cards.append(
            (
                "Separation kept",
                format_number(fleet["separation_ratio_min"], 2),
                "×",
                "what was asked for, holds included",
            )
        )
    pair = closest_pair(dataset)
    if pair is not None and fleet["separation_min_m"] is not None:
        pair_arrivals = [
            aircraft["arrival_s"]
            for aircraft in fleet_table
            if aircraft["name"] in pair[2:] and aircraft["arrival_s"] is not None
        ]
        phase_text = ", after arriving" if pair_arrivals and pair[1] > min(pair_arrivals) else ""
        note_text = f"at {format_number(pair[1], 1)} s{phase_text}: {escape_html(pair[2])}, {escape_html(pair[3])}"
        cards.append(("Least distance of two", format_number(fleet["separation_min_m"], 0), "m", note_text))
    return cards_html(cards)


def cards_html(cards: Sequence[tuple[str, str, str, str]]) -> str:
    """Cards as HTML: heading, value, unit and note."""
    columns = len(cards) if len(cards) <= _CARDS_PER_ROW else -(-len(cards) // 2)  # two rows of almost equal length
    return (
        f'<div class="cards" style="--columns:{columns}">'
        + "".join(
            f'<div class="card"><p>{name}</p><p class="value">{value}<small>{unit}</small></p>'
            f'<p class="note">{note}</p></div>'
            for name, value, unit, note in cards
        )
        + "</div>"
    )


def margins_list(margins: Sequence[Margin]) -> str:
    """A bar for the utilization of each requirement and limit, the tightest first."""
    if not margins:
        return '<p class="caption">The run names no requirement and no limit.</p>'
    return '<ol class="margins">' + "".join(_bar(margin) for margin in margins) + "</ol>"


def aircraft_table(fleet: Sequence[Mapping[str, Any]]) -> str:
    """Table of the aircraft of a summary; older summaries do not have the column with the type of path."""
    has_paths = all(aircraft.get("path") is not None for aircraft in fleet)
    number_heads = "".join(f"<th>{heading}<small>{unit}</small></th>" for _, heading, unit, _ in _COLUMNS)
    number_heads += '<th class="text">Path</th>' if has_paths else ""
    body = "".join(_aircraft_row(index, aircraft, has_paths) for index, aircraft in enumerate(fleet))
    name_heads, status_head = '<th class="text">Aircraft</th><th class="text">Goal</th>', '<th class="text">Status</th>'
    return scroll_table(name_heads + number_heads + status_head, body)


# Key of the aircraft's summary, heading, unit, decimals.
_COLUMNS: tuple[tuple[str, str, str, int], ...] = (
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


def _aircraft_row(index: int, aircraft: Mapping[str, Any], has_paths: bool) -> str:
    numbers = "".join(f"<td>{format_number(aircraft[key], digits)}</td>" for key, _, _, digits in _COLUMNS)
    path = f'<td class="text">{escape_html(aircraft["path"])}</td>' if has_paths else ""
    css_class = "good-text" if aircraft["status"] == "arrived" else "bad-text"
    return (
        f'<tr><td class="text name"><span class="swatch" style="background:{page_color_of(index)}"></span>'
        f'{escape_html(aircraft["name"])}</td><td class="text">{escape_html(aircraft["goal"])}</td>{numbers}'
        f'{path}<td class="text free {css_class}">{escape_html(aircraft["status"])}</td></tr>'
    )


def _bar(margin: Margin) -> str:
    utilization, share = margin.utilization, _utilization_text(margin)
    width = 0.0 if utilization is None else min(100.0, 100.0 * utilization)
    is_near = margin.after_arrival or (margin.is_met and utilization is not None and utilization > 0.9)
    state = "near" if is_near else ("kept" if margin.is_met else "over")
    context = ", ".join(
        part
        for part in (
            escape_html(margin.aircraft),
            "" if margin.time_s is None else f"{format_number(margin.time_s, 1)} s",
        )
        if part
    )
    unit = f" {margin.unit}" if margin.unit not in ("", "°") else margin.unit
    value = _MISSING if margin.value is None else f"{_significant(margin.value)}{unit}"
    remark = "" if margin.is_met else ("passed after the arrival" if margin.after_arrival else "not met")
    return (
        f'<li class="{state}"><span class="what">{escape_html(margin.description)}'
        f"<small>{'' if margin.kind == 'requirement' else 'limit; '}{'at most' if margin.is_upper else 'at least'} "
        f"{f'{margin.limit:,g}'.replace('-', '−')}{unit}</small></span>"
        f'<span class="bar"><i style="width:{width:.1f}%"></i></span>'
        f'<span class="share">{share}</span><span class="is"><b>{value}</b>'
        f"<small>{f'<em>{remark}</em> ' if remark else ''}{context}</small></span></li>"
    )


def _utilization_text(margin: Margin) -> str:
    used = margin.utilization
    return _MISSING if used is None else (">999 %" if used > 9.99 else f"{100 * used:.0f} %")


def _significant(value: float | None) -> str:
    if value is None or not np.isfinite(value):
        return _MISSING
    return format_number(
        value, 0 if abs(value) >= 1000 else max(0, min(5, 2 - int(np.floor(np.log10(max(abs(value), 1e-4))))))
    )


def _duration(seconds: float) -> str:
    return format_duration(seconds).replace(" ", "&nbsp;")
