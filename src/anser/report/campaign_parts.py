"""Parts of a campaign's page, as HTML: the answer first, why flights failed, bounds, the worst flights, provenance."""

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from anser.report.campaign_data import CampaignShown
from anser.report.labels import printed_unit
from anser.report.opening import cards_of, number, scroll_table, text
from anser.report.style import page_color_of
from anser.results.flight_columns import of_this_fleet, worst_of_fleet
from anser.results.separated import NO_SEPARATION, near_warning

_CAUSES = 12
"""Causes of failure that are shown at most."""
_NUMBERS = 12
"""Flights that are named at most where several are alike."""
_HEADLINES = ("miss_m", "arrival_spread_s")
_HEADS = {"miss_m": "Miss<small>m</small>", "arrival_spread_s": "Spread<small>s</small>"}
_WORDS = {"miss_m": "miss by at most", "arrival_spread_s": "arrive within"}


def headline(shown: CampaignShown) -> str:
    """Say how surely, from how many flights; a campaign that is not complete says so first."""
    found = shown.answers
    flown, met, sure = found["flown"], found["met"], f"{100 * found['confidence']:g} %"
    part = _partial(shown)
    if not flown:
        return f'{part}<div class="answer mixed"><p class="head">No flight so far</p></div>'
    share = f"{100 * found['probability']:.2f} %"
    interval = f"{100 * found['low']:.2f} to {100 * found['high']:.2f} %"
    sentences = [f"{share} of the flights; {interval} at {sure} confidence{_alone(found)}."]
    sentences += [
        f"{100 * one['share']:g} % of the flights {_WORDS[one['name']]} {_value(one['value'])}&nbsp;"
        f"{text(printed_unit(one['unit']))} ({_ends(one)})."
        for one in (_main(found, name) for name in _HEADLINES)
        if one is not None
    ]
    warning = near_warning(_least_separation(shown), shown.dataset.attrs)
    if shown.dataset.attrs.get("separation_required") == 0:
        sentences.append(f"{NO_SEPARATION.capitalize()}.")
    if warning:
        sentences.append(f"<b>Warning:</b> {text(warning)}.")
    look, mark = ("good", "✓") if met == flown and not warning else ("mixed", "")
    head = f"{met:,} of {flown:,} flights met every requirement"
    return (
        f'{part}<div class="answer {look}"><p class="head"><span aria-hidden="true">{mark}</span> {head}</p>'
        f"<p>{' '.join(sentences)}</p></div>"
    )


def _least_separation(shown: CampaignShown) -> np.ndarray:
    """Least distance of two aircraft in each flight, m; empty of one aircraft."""
    name = "separation_min_m"
    return shown.dataset[name].values if name in shown.dataset else np.empty(0)


def _partial(shown: CampaignShown) -> str:
    flown, flights = shown.answers["flown"], shown.answers["flights"]
    if flown == flights:
        return ""
    if shown.enough:
        words = f"After {flown:,} of {flights:,} flights the interval was as narrow as the study asks."
        return f'<p class="caption">{words}</p>'
    return (
        f'<p class="lacking"><b>Partial: {flown:,} of {flights:,} flights.</b> '
        "All that stands below comes from these alone.</p>"
    )


def _alone(found: Mapping[str, Any]) -> str:
    if found["independent"] == found["flown"]:
        return ""
    return f", from the {found['independent']:,} flights that are independent of each other"


def _main(found: Mapping[str, Any], name: str) -> Mapping[str, Any] | None:
    """The known quantile nearest to 95 %; None where none is known."""
    of = [one for one in found["quantiles"] if one["name"] == name and one["value"] is not None]
    return min(of, key=lambda one: abs(one["share"] - 0.95)) if of else None


def _ends(one: Mapping[str, Any]) -> str:
    """Interval in words; an end that so few flights do not tell is open."""
    low, high = one["low"], one["high"]
    if low is None and high is None:
        return "interval open"
    if low is None or high is None:
        return f"{_value(low)} or more" if high is None else f"{_value(high)} or less"
    return f"{_value(low)} to {_value(high)}"


def _value(value: float | None) -> str:
    """Four significant digits."""
    if value is None or not np.isfinite(value):
        return number(None, 0)
    if not value:
        return "0"
    digits = 3 - int(np.floor(np.log10(max(abs(value), 1e-6))))
    return number(value, max(0, min(9, digits)))


def numbers(shown: CampaignShown) -> str:
    """The few numbers that people ask for first."""
    found = shown.answers
    sure = f"{100 * found['confidence']:g} %"
    begun = int((shown.dataset["reason"].values == "").sum())
    cards = [("Flights", f"{found['flown']:,}", "", f"of {found['flights']:,}")]
    if found["probability"] is not None:
        ends = f"{100 * found['low']:.2f} to {100 * found['high']:.2f} % at {sure}"
        cards.append(("Met everything", f"{100 * found['probability']:.2f}", "%", ends))
    for name in _HEADLINES:
        one = _main(found, name)
        if one is not None:
            share = f"{100 * one['share']:g} % of flights: {one['words']}"
            cards.append((text(share), _value(one["value"]), text(printed_unit(one["unit"])), _ends(one)))
    cards.append(("Failed", f"{found['flown'] - found['met']:,}", "", f"{found['flown'] - begun:,} could not begin"))
    return cards_of(cards)


def causes(shown: CampaignShown) -> str:
    """Causes of failure, the most frequent first: a bar of their part of all flights that failed."""
    counted, failed = shown.answers["causes"], shown.answers["flown"] - shown.answers["met"]
    if not counted:
        return '<p class="caption">No flight failed.</p>'
    rows = "".join(
        f'<li class="over"><span class="what">{text(words)}</span>'
        f'<span class="bar"><i style="width:{100 * count / failed:.1f}%"></i></span>'
        f'<span class="share">{100 * count / failed:.0f} %</span>'
        f'<span class="is"><b>{count:,}</b> of {failed:,}</span></li>'
        for words, count in list(counted.items())[:_CAUSES]
    )
    more = len(counted) - _CAUSES
    rest = f'<p class="caption">{more} rarer causes are not shown; all are in flights.parquet.</p>' if more > 0 else ""
    words = "Part of the flights that failed; a flight may fail of several things."
    return f'<p class="caption">{words}</p><ol class="margins">{rows}</ol>{rest}'


def bounds(shown: CampaignShown) -> str:
    """Table of the quantiles with their intervals: a row for each quantity, a column for each part of the flights."""
    quantiles = shown.answers["quantiles"]
    shares = sorted({one["share"] for one in quantiles})
    heads = '<th class="text">Quantity</th><th class="text">Bound</th>'
    heads += "".join(f"<th>{100 * share:g} % of flights<small>interval</small></th>" for share in shares)
    body = ""
    for name in dict.fromkeys(one["name"] for one in quantiles):
        of = {one["share"]: one for one in quantiles if one["name"] == name}
        first = next(iter(of.values()))
        body += f'<tr><td class="text name">{text(first["words"])}</td>'
        body += f'<td class="text">{"at most" if first["upper"] else "at least"}</td>'
        body += "".join(_cell(of[share]) for share in shares) + "</tr>"
    return scroll_table(heads, body)


def _cell(one: Mapping[str, Any]) -> str:
    if one["value"] is None:
        return "<td>none<small>too many flights have no number</small></td>"
    return f"<td>{_value(one['value'])} {text(printed_unit(one['unit']))}<small>{_ends(one)}</small></td>"


def worst_table(shown: CampaignShown) -> str:
    """The worst flights: what came of them, the values applied, and the command that flies each again."""
    if not len(shown.worst):
        return '<p class="caption">No flight has begun.</p>'
    rows = shown.dataset.sel(flight=list(shown.worst))
    drawn = [one.number for one in shown.again if one.worst]
    met = rows["met"].values
    columns = {name: worst_of_fleet(rows, name) for name in of_this_fleet(_HEADLINES, rows)}
    heads = (
        "<th>Flight</th>" + "".join(f"<th>{_HEADS[name]}</th>" for name in columns) + '<th class="text">Outcome</th>'
    )
    heads += "".join(f"<th>{text(path)}</th>" for path in shown.varied) + '<th class="text">Fly it again</th>'
    body = ""
    for k, flight in enumerate(shown.worst):
        swatch = (
            f'<span class="swatch" style="background:{page_color_of(drawn.index(flight))}"></span>'
            if flight in drawn
            else ""
        )
        cells = "".join(f"<td>{_applied(rows[path].values[k])}</td>" for path in shown.varied)
        outcome = "met every requirement" if met[k] else _failed(rows, k)
        command = f"anser run --campaign {shown.place} --flight {flight}"
        body += (
            f'<tr data-flight="{flight}"><td class="name">{swatch}{flight}</td>'
            + "".join(f"<td>{_value(values[k])}</td>" for values in columns.values())
            + f'<td class="text free">{text(outcome)}</td>{cells}'
            f'<td class="text command"><code>{text(command)}</code></td></tr>'
        )
    return scroll_table(heads, body)


def _failed(rows: Any, k: int) -> str:
    statuses = sorted({str(one) for one in rows["status"].values[k]} - {"arrived"})
    return "; ".join([*statuses, *(f"not met: {one}" for one in str(rows["unmet"].values[k]).split(", ") if one)])


def _applied(value: Any) -> str:
    return text(f"{value:.5g}".replace("-", "−")) if isinstance(value, float) else text(value)


def not_begun(shown: CampaignShown) -> str:
    """Flights that could not begin, by their reason; empty where all could."""
    reasons = shown.dataset["reason"].values
    found: dict[str, list[int]] = {}
    for flight, reason in zip(shown.dataset["flight"].values.tolist(), reasons.tolist(), strict=True):
        if reason:
            found.setdefault(reason, []).append(flight)
    if not found:
        return ""
    body = "".join(
        f'<tr><td>{len(flights):,}</td><td class="text free">{text(reason)}</td><td class="text free">'
        f"{', '.join(map(str, flights[:_NUMBERS]))}{', …' if len(flights) > _NUMBERS else ''}</td></tr>"
        for reason, flights in sorted(found.items(), key=lambda item: -len(item[1]))
    )
    heads = '<th>Flights</th><th class="text">Reason</th><th class="text">Their numbers</th>'
    return (
        '<section id="not-begun"><h2>Could not begin</h2><p class="caption">They count as failures, with an infinite '
        f"miss, in all that stands above.</p>{scroll_table(heads, body)}</section>"
    )


def provenance(shown: CampaignShown) -> str:
    """Study, scenario, seed, versions."""
    about, study = shown.dataset.attrs, shown.study
    versions = [
        f"{text(key.removeprefix('version_'))} {text(value)}"
        for key, value in about.items()
        if key.startswith("version_")
    ]
    sampling = ", ".join(f"{text(key)} {text(value)}" for key, value in study["sampling"].items() if value is not None)
    wholes = (("study", study), ("scenario, as far as its file says", json.loads(about["scenario"])))
    details = "".join(
        f'<details class="more"><summary>the {name}</summary>'
        f"<pre>{text(json.dumps(values, indent=2, ensure_ascii=False))}</pre></details>"
        for name, values in wholes
    )
    return (
        f'<div class="facts"><div>Study <b>{text(study["name"])}</b></div>'
        f"<div>Study hash <code>{text(about['study_hash'])}</code></div>"
        f"<div>Scenario hash <code>{text(about['scenario_hash'])}</code></div>"
        f"<div>Seed {text(study.get('seed', 0))}</div><div>Sampling: {sampling}</div>"
        f"<div>{', '.join(versions)}</div></div>{details}"
    )


def input_words(influences: Mapping[str, Any]) -> Sequence[str]:
    """Why outputs or inputs have no index, a sentence each."""
    outputs = influences["outputs"]
    return [f"{text(outputs.get(name, name))}: none, {text(reason)}." for name, reason in influences["without"].items()]
