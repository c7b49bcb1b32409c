"""The report of a campaign.

One self-contained page, with its parts as HTML: success rate, failure causes, bounds, influences, worst flights,
provenance.
"""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from anser.report.campaign_data import CampaignReport, campaign_data
from anser.report.campaign_map import campaign_map
from anser.report.flight_overview import cards_html, escape_html, format_number, scroll_table
from anser.report.labels import printed_unit
from anser.report.page_frame import assemble_page, write_page
from anser.report.style import COLORS, page_color_of
from anser.report.svg_charts import influence_strip
from anser.results.flight_rows import applicable_quantities, worst_of_fleet
from anser.results.separation import NO_SEPARATION, proximity_warning

_CAUSES = 12
"""Causes of failure that are shown at most."""
_NUMBERS = 12
"""Flights that are named at most where several are alike."""
_HEADLINES = ("miss_m", "arrival_spread_s")
_HEADS = {"miss_m": "Miss<small>m</small>", "arrival_spread_s": "Spread<small>s</small>"}
_WORDS = {"miss_m": "miss by at most", "arrival_spread_s": "arrive within"}


def headline_html(shown: CampaignReport) -> str:
    """Say how surely, from how many flights; a campaign that is not complete says so first."""
    found = shown.estimates
    flown, met, sure = found["flown"], found["met"], f"{100 * found['confidence']:g} %"
    part = _partial(shown)
    if not flown:
        return f'{part}<div class="answer mixed"><p class="head">No flight so far</p></div>'
    share = f"{100 * found['probability']:.2f} %"
    interval = f"{100 * found['low']:.2f} to {100 * found['high']:.2f} %"
    sentences = [f"{share} of the flights; {interval} at {sure} confidence{_alone(found)}."]
    sentences += [
        f"{100 * one['share']:g} % of the flights {_WORDS[one['name']]} {_value(one['value'])}&nbsp;"
        f"{escape_html(printed_unit(one['unit']))} ({_ends(one)})."
        for one in (_main(found, name) for name in _HEADLINES)
        if one is not None
    ]
    warning = proximity_warning(_least_separation(shown), shown.dataset.attrs)
    if shown.dataset.attrs.get("separation_required") == 0:
        sentences.append(f"{NO_SEPARATION.capitalize()}.")
    if warning:
        sentences.append(f"<b>Warning:</b> {escape_html(warning)}.")
    look, mark = ("good", "✓") if met == flown and not warning else ("mixed", "")
    head = f"{met:,} of {flown:,} flights met every requirement"
    return (
        f'{part}<div class="answer {look}"><p class="head"><span aria-hidden="true">{mark}</span> {head}</p>'
        f"<p>{' '.join(sentences)}</p></div>"
    )


def _least_separation(shown: CampaignReport) -> np.ndarray:
    """Least distance of two aircraft in each flight, m; empty of one aircraft."""
    name = "separation_min_m"
    return shown.dataset[name].values if name in shown.dataset else np.empty(0)


def _partial(shown: CampaignReport) -> str:
    flown, flights = shown.estimates["flown"], shown.estimates["flights"]
    if flown == flights:
        return ""
    if shown.is_converged:
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
        return format_number(None, 0)
    if not value:
        return "0"
    digits = 3 - int(np.floor(np.log10(max(abs(value), 1e-6))))
    return format_number(value, max(0, min(9, digits)))


def number_cards(shown: CampaignReport) -> str:
    """The few numbers that people ask for first."""
    found = shown.estimates
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
            cards.append((escape_html(share), _value(one["value"]), escape_html(printed_unit(one["unit"])), _ends(one)))
    cards.append(("Failed", f"{found['flown'] - found['met']:,}", "", f"{found['flown'] - begun:,} could not begin"))
    return cards_html(cards)


def failure_causes(shown: CampaignReport) -> str:
    """Causes of failure, the most frequent first: a bar of their part of all flights that failed."""
    counted, failed = shown.estimates["causes"], shown.estimates["flown"] - shown.estimates["met"]
    if not counted:
        return '<p class="caption">No flight failed.</p>'
    rows = "".join(
        f'<li class="over"><span class="what">{escape_html(words)}</span>'
        f'<span class="bar"><i style="width:{100 * count / failed:.1f}%"></i></span>'
        f'<span class="share">{100 * count / failed:.0f} %</span>'
        f'<span class="is"><b>{count:,}</b> of {failed:,}</span></li>'
        for words, count in list(counted.items())[:_CAUSES]
    )
    more = len(counted) - _CAUSES
    rest = f'<p class="caption">{more} rarer causes are not shown; all are in flights.parquet.</p>' if more > 0 else ""
    words = "Part of the flights that failed; a flight may fail of several things."
    return f'<p class="caption">{words}</p><ol class="margins">{rows}</ol>{rest}'


def bounds_table(shown: CampaignReport) -> str:
    """Table of the quantiles with their intervals: a row for each quantity, a column for each part of the flights."""
    quantiles = shown.estimates["quantiles"]
    shares = sorted({one["share"] for one in quantiles})
    heads = '<th class="text">Quantity</th><th class="text">Bound</th>'
    heads += "".join(f"<th>{100 * share:g} % of flights<small>interval</small></th>" for share in shares)
    body = ""
    for name in dict.fromkeys(one["name"] for one in quantiles):
        of = {one["share"]: one for one in quantiles if one["name"] == name}
        first = next(iter(of.values()))
        body += f'<tr><td class="text name">{escape_html(first["words"])}</td>'
        body += f'<td class="text">{"at most" if first["upper"] else "at least"}</td>'
        body += "".join(_cell(of[share]) for share in shares) + "</tr>"
    return scroll_table(heads, body)


def _cell(one: Mapping[str, Any]) -> str:
    if one["value"] is None:
        return "<td>none<small>too many flights have no number</small></td>"
    return f"<td>{_value(one['value'])} {escape_html(printed_unit(one['unit']))}<small>{_ends(one)}</small></td>"


def worst_table(shown: CampaignReport) -> str:
    """The worst flights: what came of them, the values applied, and the command that flies each again."""
    if not len(shown.worst):
        return '<p class="caption">No flight has begun.</p>'
    rows = shown.dataset.sel(flight=list(shown.worst))
    drawn = [one.number for one in shown.replays if one.worst]
    met = rows["met"].values
    columns = {name: worst_of_fleet(rows, name) for name in applicable_quantities(_HEADLINES, rows)}
    heads = (
        "<th>Flight</th>" + "".join(f"<th>{_HEADS[name]}</th>" for name in columns) + '<th class="text">Outcome</th>'
    )
    heads += (
        "".join(f"<th>{escape_html(path)}</th>" for path in shown.varied_paths) + '<th class="text">Fly it again</th>'
    )
    body = ""
    for k, flight in enumerate(shown.worst):
        swatch = (
            f'<span class="swatch" style="background:{page_color_of(drawn.index(flight))}"></span>'
            if flight in drawn
            else ""
        )
        cells = "".join(f"<td>{_applied(rows[path].values[k])}</td>" for path in shown.varied_paths)
        outcome = "met every requirement" if met[k] else _failed(rows, k)
        command = f"anser run --campaign {shown.folder} --flight {flight}"
        body += (
            f'<tr data-flight="{flight}"><td class="name">{swatch}{flight}</td>'
            + "".join(f"<td>{_value(values[k])}</td>" for values in columns.values())
            + f'<td class="text free">{escape_html(outcome)}</td>{cells}'
            f'<td class="text command"><code>{escape_html(command)}</code></td></tr>'
        )
    return scroll_table(heads, body)


def _failed(rows: Any, k: int) -> str:
    statuses = sorted({str(one) for one in rows["status"].values[k]} - {"arrived"})
    return "; ".join([*statuses, *(f"not met: {one}" for one in str(rows["unmet"].values[k]).split(", ") if one)])


def _applied(value: Any) -> str:
    return escape_html(f"{value:.5g}".replace("-", "−")) if isinstance(value, float) else escape_html(value)


def unstarted_flights(shown: CampaignReport) -> str:
    """Flights that could not begin, by their reason; empty where all could."""
    reasons = shown.dataset["reason"].values
    found: dict[str, list[int]] = {}
    for flight, reason in zip(shown.dataset["flight"].values.tolist(), reasons.tolist(), strict=True):
        if reason:
            found.setdefault(reason, []).append(flight)
    if not found:
        return ""
    body = "".join(
        f'<tr><td>{len(flights):,}</td><td class="text free">{escape_html(reason)}</td><td class="text free">'
        f"{', '.join(map(str, flights[:_NUMBERS]))}{', …' if len(flights) > _NUMBERS else ''}</td></tr>"
        for reason, flights in sorted(found.items(), key=lambda item: -len(item[1]))
    )
    heads = '<th>Flights</th><th class="text">Reason</th><th class="text">Their numbers</th>'
    return (
        '<section id="not-begun"><h2>Could not begin</h2><p class="caption">They count as failures, with an infinite '
        f"miss, in all that stands above.</p>{scroll_table(heads, body)}</section>"
    )


def provenance_html(shown: CampaignReport) -> str:
    """Study, scenario, seed, versions."""
    about, study = shown.dataset.attrs, shown.study
    versions = [
        f"{escape_html(key.removeprefix('version_'))} {escape_html(value)}"
        for key, value in about.items()
        if key.startswith("version_")
    ]
    sampling = ", ".join(
        f"{escape_html(key)} {escape_html(value)}" for key, value in study["sampling"].items() if value is not None
    )
    wholes = (("study", study), ("scenario, as far as its file says", json.loads(about["scenario"])))
    details = "".join(
        f'<details class="more"><summary>the {name}</summary>'
        f"<pre>{escape_html(json.dumps(values, indent=2, ensure_ascii=False))}</pre></details>"
        for name, values in wholes
    )
    return (
        f'<div class="facts"><div>Study <b>{escape_html(study["name"])}</b></div>'
        f"<div>Study hash <code>{escape_html(about['study_hash'])}</code></div>"
        f"<div>Scenario hash <code>{escape_html(about['scenario_hash'])}</code></div>"
        f"<div>Seed {escape_html(study.get('seed', 0))}</div><div>Sampling: {sampling}</div>"
        f"<div>{', '.join(versions)}</div></div>{details}"
    )


def missing_index_notes(influences: Mapping[str, Any]) -> Sequence[str]:
    """Why outputs or inputs have no index, a sentence each."""
    outputs = influences["outputs"]
    return [
        f"{escape_html(outputs.get(name, name))}: none, {escape_html(reason)}."
        for name, reason in influences["without"].items()
    ]


_STYLES = ("vendor/uplot.min.css", "page.css", "campaign.css")
_SCRIPTS = ("vendor/uplot.min.js", "theme.js", "store.js", "campaign.js")


def write_campaign_report(shown: CampaignReport, path: Path) -> None:
    """Write the report of a campaign as one HTML page, in place of a former one.

    How surely and why not, bounds, convergence, distributions, what the outputs depend on, the worst flights.

    Parameters
    ----------
    shown
        What it shows.
    path
        Where to write the page.
    """
    write_page(_page(shown), path, overwrite=True)


def _page(shown: CampaignReport) -> str:
    title = escape_html(shown.dataset.attrs["title"])
    sure = f"{100 * shown.estimates['confidence']:g} %"
    alone = "" if shown.independent.all() else " Only flights that are independent of each other count here."
    contents = f"""<main>
<header>
<h1>{title}</h1>
<p class="lead">{escape_html(shown.study.get("description", ""))}</p>
<p id="fault" class="fault" hidden></p>
</header>
<section class="opening"><div>{headline_html(shown)}{number_cards(shown)}</div>
<div><h2 class="tight">Why flights failed</h2>{failure_causes(shown)}</div></section>
<section id="bounds"><h2>Bounds</h2><p class="caption">What part of the flights keeps, with an interval by order
statistics at {sure} confidence. A flight that has no such number counts as infinitely bad.{alone}</p>
{bounds_table(shown)}</section>
<section id="converging"><h2>Convergence</h2><p class="caption">Each estimate and its interval at {sure} against the
number of flights.{alone}</p><div class="plots" data-plots="converging"></div></section>
<section id="distributions"><h2>Distributions</h2><p class="caption">Part of the flights that keeps a bound; bars: the
intervals of the bounds above at {sure}. What is missing to 100 % has no such number.{alone}</p>
<div class="plots" data-plots="distributions"></div></section>
{_series(shown)}
{_influences(shown)}
{_against(shown)}
<section id="worst"><h2>The worst flights</h2>{_map(shown)}{worst_table(shown)}</section>
{unstarted_flights(shown)}
<section id="provenance"><h2>Study, scenario, versions, seed</h2>{provenance_html(shown)}</section>
</main>"""
    return assemble_page(
        f"{title} · anser campaign report",
        body_class="single campaign",
        styles=_STYLES,
        scripts=_SCRIPTS,
        contents=contents,
        data=("campaign", {"colors": len(COLORS), **campaign_data(shown)}),
    )


def _series(shown: CampaignReport) -> str:
    """Section of what was kept over time; empty where nothing was, or codes alone."""
    if not shown.bands:
        return ""
    first = shown.bands[0]
    fleet = shown.dataset.sizes["aircraft"]
    legend = " ".join(
        f'<span class="swatch" style="background:{page_color_of(k)}"></span>{escape_html(name)}'
        for k, name in enumerate(first.aircraft)
    )
    some = f" The first {len(first.aircraft)} of {fleet} aircraft." if len(first.aircraft) < fleet else ""
    return (
        '<section id="series"><h2>Over time</h2><p class="caption">Of each aircraft the median over the flights (line) '
        "and the band from 5 to 95 % of them, at each time by itself; flights that could not begin are not among "
        f'them.{some}</p><p class="caption">{legend}</p><div class="plots" data-plots="series"></div></section>'
    )


def _influences(shown: CampaignReport) -> str:
    """Section of the indices or rank correlations; empty where nothing varied."""
    if not shown.varied_paths:
        return ""
    found = shown.influences
    sobol = found["kind"] == "Sobol indices"
    strips = "".join(
        f'<div><p class="run-name"><b>{escape_html(words)}</b></p>{influence_strip(found["found"], name)}</div>'
        for name, words in found["outputs"].items()
        if any(one["output"] == name for one in found["found"])
    )
    how = (
        "Sobol indices: the part of the variance that an input makes by itself (first) and in whatever combination "
        "(total). What the first ones leave of 1 is combinations, and what is random in each flight."
        if sobol
        else "Spearman rank correlations, −1 to 1: how monotonically an output goes with an input; no parts of a "
        "variance, and blind to what rises and falls. Texts rank in the order of the study."
    )
    rows = "".join(
        f'<tr><td class="text">{escape_html(found["outputs"][one["output"]])}</td>'
        f'<td class="text name">{escape_html(one["path"])}</td>'
        f'<td class="text">{escape_html(one["measure"])}</td>'
        + "".join(f"<td>{format_number(one[key], 3)}</td>" for key in ("value", "low", "high"))
        + "</tr>"
        for one in found["found"]
    )
    heads = '<th class="text">Output</th><th class="text">Input</th><th class="text">Measure</th>'
    heads += "<th>Value</th><th>From</th><th>To</th>"
    without = "".join(f'<p class="caption">{words}</p>' for words in missing_index_notes(found))
    return (
        f'<section id="influences"><h2>What it depends on</h2><p class="caption">{how} Lines: intervals at '
        f'{100 * found["confidence"]:g} %; from {found["flights"]:,} flights.</p><div class="strips">{strips}</div>'
        f'{without}<details class="more"><summary>the numbers</summary>{scroll_table(heads, rows)}</details></section>'
    )


def _against(shown: CampaignReport) -> str:
    """Section of the flights against each input; empty where nothing varied."""
    if not shown.varied_paths:
        return ""
    return (
        '<section id="against"><h2>Every flight against each input</h2><div class="toolbar"><label class="group">'
        'Quantity <select id="quantity"></select></label><span class="caption">A dot met every requirement, a '
        'cross did not; crosses at the edge have no number. <span id="drawn"></span></span></div>'
        '<div class="plots" data-plots="against"></div></section>'
    )


def _map(shown: CampaignReport) -> str:
    drawn = campaign_map(shown)
    if not drawn:
        words = "Flights that began, the worst first. None was flown again for this report: there is no map."
        return f'<p class="caption">{words}</p>'
    others = sum(not one.worst for one in shown.replays)
    words = (
        f"Flights that began, the worst first, in colour over {others} others, evenly spaced; from above, each "
        "aircraft until it has arrived. A dot is where one began, a square where it was at the end."
    )
    if shown.replay_differences:
        numbers = ", ".join(map(str, shown.replay_differences))
        words += f" Flown again, these did not come out as in the campaign: {numbers}."
    return f'<p class="caption">{words}</p>{drawn}'
