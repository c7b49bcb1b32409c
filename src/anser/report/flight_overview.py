"""The opening page of a flight report, as HTML: the answer first, then what was tight, then each aircraft."""

import html
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from anser.report.flight_margins import Margin, closest_pair
from anser.report.style import page_color_of
from anser.results.arrival import arrival_accuracy, format_duration
from anser.results.separation import NO_SEPARATION, is_judged_by_separation

_NOTHING = "–"
_CARDS_IN_ROW = 4


def escape_html(value: object) -> str:
    """Escape for HTML: what comes from files is shown, never interpreted."""
    return html.escape(str(value))


def format_number(value: float | None, digits: int) -> str:
    """Number with so many decimals and thousands apart; a dash where there is none."""
    if value is None or not np.isfinite(value):
        return _NOTHING
    return f"{value:,.{digits}f}".replace("-", "−")


def scroll_table(heads: str, body: str) -> str:
    """Table that scrolls where it is wider than the page, from its cells of the head and its rows."""
    table = f"<table><thead><tr>{heads}</tr></thead><tbody>{body}</tbody></table>"
    return f'<div class="scroll" tabindex="0" role="group" aria-label="Table">{table}</div>'


def verdict_html(
    summary: Mapping[str, Any], scenario: Mapping[str, Any], margins: Sequence[Margin] = (), warning: str = ""
) -> str:
    """Say whether they arrived as was asked and by how much, and name what was not met and what limits were passed.

    Parameters
    ----------
    summary, scenario
        As the run holds them; the scenario may be empty.
    margins
        What was left to requirements and limits.
    warning
        Of two aircraft that came near each other; empty: none.
    """
    rows, spread, fits = summary["aircraft"], summary["fleet"]["arrival_spread_s"], arrival_accuracy(summary)
    left = [row for row in rows if "left_s" in row]
    stray = [row for row in rows if row["status"] != "arrived" and "left_s" not in row]
    unmet = [entry["name"] for entry in summary["requirements"] if not entry["met"]]
    allowed = next((e["limit"] for e in summary["requirements"] if e["name"] == "arrival_spread_max_s"), None)
    together = (
        fits.kind == "spread"
        and spread is not None
        and (allowed is not None or scenario.get("arrival", {}).get("rule") in ("together", "at"))
    )
    apart = "" if spread is None else _duration(spread)
    good = not stray and not unmet
    passed = [margin for margin in margins if margin.kind == "limit" and not margin.is_met]
    if stray or left:
        count = len(rows) - len(stray) - len(left)
        head = f"{count} of {len(rows)} aircraft arrived" if len(rows) > 1 else "The aircraft failed"
    elif together and "arrival_spread_max_s" in unmet:
        head = f"All {len(rows)} aircraft arrived, but {apart} apart"
    elif together:
        head = f"All {len(rows)} aircraft arrived together, within {apart}"
    elif fits.kind == "spacing" and fits.value_s is not None:
        head = (
            f"All {len(rows)} aircraft arrived {fits.required_spacing_s:g}&nbsp;s apart, within "
            f"{_duration(fits.value_s)}"
        )
    else:
        head = f"All {len(rows)} aircraft arrived as planned" if len(rows) > 1 else "The aircraft arrived as planned"
    if not good and not stray and "arrival_spread_max_s" not in unmet:
        head += ", but not as required"
    parts = [] if allowed is None or not together else [f"{format_number(allowed, 2)} s apart were allowed."]
    parts += [f"<b>{escape_html(row['name'])}</b>: {escape_html(row['status'])}." for row in (*stray, *left)]
    parts += [
        f"At {format_number(event['time_s'], 1)} s {escape_html(event['kind'].replace('-', ' '))} "
        f"({escape_html(event['whom'])}): "
        f"{escape_html(event['message'])}."
        for event in summary.get("events", ())
    ]
    network = summary.get("network")
    if network:
        words = escape_html(network["message"])
        words = words if network["condition_met"] else f"<b>{words}</b>"
        parts.append(f"Without a centre: {words}.")
    if unmet:
        parts.append(f"Requirements not met: <b>{escape_html(', '.join(unmet))}</b>.")
    elif good:
        parts.append("All requirements met." if not passed else "All requirements met, but not all limits kept.")
    if not is_judged_by_separation(summary):
        parts.append(f"{NO_SEPARATION.capitalize()}.")
    if warning:
        parts.append(f"<b>Warning:</b> {escape_html(warning)}.")
    if passed:
        parts.append(f"Passed: {_passed(passed)}.")
    look, mark = ("bad", "✗") if not good else ("mixed", "!") if passed or warning else ("good", "✓")
    return (
        f'<div class="answer {look}"><p class="head"><span aria-hidden="true">'
        f"{mark}</span> {head}</p><p>{' '.join(parts)}</p></div>"
    )


def _passed(margins: Sequence[Margin]) -> str:
    """Limits that were passed, and whether before the arrivals or only in the hold after them."""
    when = {True: ", after the arrival", False: ""}
    return "; ".join(
        f"<b>{escape_html(margin.description)}</b> ({_share(margin)} of its limit{when[margin.after_arrival]})"
        for margin in margins
    )


def summary_cards(dataset: xr.Dataset, summary: Mapping[str, Any]) -> str:
    """The few numbers of a fleet that people ask for first."""
    rows, fleet = summary["aircraft"], summary["fleet"]
    arrivals = [row["arrival_s"] for row in rows if row["arrival_s"] is not None]
    found = []
    if arrivals:
        found.append(("Arrival", f"{format_number(min(arrivals), 2)}", "s", "" if len(rows) == 1 else "of the first"))
    fits = arrival_accuracy(summary)
    if fits.value_s is not None:
        name, note = {
            "spread": ("Arrival spread", "first to last"),
            "spacing": ("Spacing error", f"greatest, of {fits.required_spacing_s or 0:g} s asked for"),
            "error": ("Off the planned time", "" if len(rows) == 1 else "greatest"),
        }[fits.kind]
        found.append((name, *_duration(fits.value_s).split("&nbsp;"), note))
    misses = [(row["miss_m"], row["name"]) for row in rows if "left_s" not in row]
    never_arrived = [name for miss_m, name in misses if miss_m is None]
    if never_arrived:
        more = f" and {len(never_arrived) - 1} more" if len(never_arrived) > 1 else ""
        found.append(("Greatest miss", _NOTHING, "", f"{escape_html(never_arrived[0])}{more} never arrived"))
    elif misses:
        worst = max(misses)
        found.append(("Greatest miss", format_number(worst[0], 2), "m", escape_html(worst[1])))
    if fleet.get("separation_ratio_min") is not None:
        found.append(
            (
                "Separation kept",
                format_number(fleet["separation_ratio_min"], 2),
                "×",
                "what was asked for, holds included",
            )
        )
    apart = closest_pair(dataset)
    if apart is not None and fleet["separation_min_m"] is not None:
        ends = [row["arrival_s"] for row in rows if row["name"] in apart[2:] and row["arrival_s"] is not None]
        later = ", after arriving" if ends and apart[1] > min(ends) else ""
        where = f"at {format_number(apart[1], 1)} s{later}: {escape_html(apart[2])}, {escape_html(apart[3])}"
        found.append(("Least distance of two", format_number(fleet["separation_min_m"], 0), "m", where))
    return cards_html(found)


def cards_html(cards: Sequence[tuple[str, str, str, str]]) -> str:
    """Numbers that stand out: of each the heading, the value, its unit and a note; HTML."""
    columns = len(cards) if len(cards) <= _CARDS_IN_ROW else -(-len(cards) // 2)  # none alone in a row
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
    """One bar for each requirement and limit, the tightest first: full where the limit is reached."""
    if not margins:
        return '<p class="caption">The run names no requirement and no limit.</p>'
    return '<ol class="margins">' + "".join(_bar(margin) for margin in margins) + "</ol>"


def aircraft_table(rows: Sequence[Mapping[str, Any]]) -> str:
    """One row for each aircraft of the summary; a row is chosen by its button.

    How a path goes stands there where the summary says it (older ones do not).
    """
    has_paths = all(row.get("path") is not None for row in rows)
    heads = "".join(f"<th>{heading}<small>{unit}</small></th>" for _, heading, unit, _ in _COLUMNS)
    heads += '<th class="text">Path</th>' if has_paths else ""
    body = "".join(_aircraft_row(index, row, has_paths) for index, row in enumerate(rows))
    left, right = '<th class="text">Aircraft</th><th class="text">Goal</th>', '<th class="text">Status</th>'
    return scroll_table(left + heads + right, body)


# Key of the summary's row of an aircraft: heading, unit, decimals.
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


def _aircraft_row(index: int, row: Mapping[str, Any], has_paths: bool) -> str:
    numbers = "".join(f"<td>{format_number(row[key], digits)}</td>" for key, _, _, digits in _COLUMNS)
    path = f'<td class="text">{escape_html(row["path"])}</td>' if has_paths else ""
    fine = "good-text" if row["status"] == "arrived" else "bad-text"
    return (
        f'<tr><td class="text name"><span class="swatch" style="background:{page_color_of(index)}"></span>'
        f'{escape_html(row["name"])}</td><td class="text">{escape_html(row["goal"])}</td>{numbers}'
        f'{path}<td class="text free {fine}">{escape_html(row["status"])}</td></tr>'
    )


def _bar(margin: Margin) -> str:
    used, share = margin.utilization, _share(margin)
    width = 0.0 if used is None else min(100.0, 100.0 * used)
    near = margin.after_arrival or (margin.is_met and used is not None and used > 0.9)
    state = "near" if near else ("kept" if margin.is_met else "over")
    where = ", ".join(
        part
        for part in (
            escape_html(margin.aircraft),
            "" if margin.time_s is None else f"{format_number(margin.time_s, 1)} s",
        )
        if part
    )
    unit = f" {margin.unit}" if margin.unit not in ("", "°") else margin.unit
    value = _NOTHING if margin.value is None else f"{_significant(margin.value)}{unit}"
    remark = "" if margin.is_met else ("passed after the arrival" if margin.after_arrival else "not met")
    return (
        f'<li class="{state}"><span class="what">{escape_html(margin.description)}'
        f"<small>{'' if margin.kind == 'requirement' else 'limit; '}{'at most' if margin.is_upper else 'at least'} "
        f"{f'{margin.limit:,g}'.replace('-', '−')}{unit}</small></span>"
        f'<span class="bar"><i style="width:{width:.1f}%"></i></span>'
        f'<span class="share">{share}</span><span class="is"><b>{value}</b>'
        f"<small>{f'<em>{remark}</em> ' if remark else ''}{where}</small></span></li>"
    )


def _share(margin: Margin) -> str:
    used = margin.utilization
    return _NOTHING if used is None else (">999 %" if used > 9.99 else f"{100 * used:.0f} %")


def _significant(value: float | None) -> str:
    if value is None or not np.isfinite(value):
        return _NOTHING
    return format_number(
        value, 0 if abs(value) >= 1000 else max(0, min(5, 2 - int(np.floor(np.log10(max(abs(value), 1e-4))))))
    )


def _duration(seconds: float) -> str:
    return format_duration(seconds).replace(" ", "&nbsp;")
