"""Report page of a campaign.

One self-contained HTML page: success rate, failure causes, bounds, influences, worst flights and provenance.
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

_CAUSES_MAX = 12
"""Greatest number of failure causes shown."""
_NUMBERS_MAX = 12
"""Greatest number of flight numbers listed for one reason."""
_HEADLINES = ("miss_m", "arrival_spread_s")
_HEADINGS = {"miss_m": "Miss<small>m</small>", "arrival_spread_s": "Spread<small>s</small>"}
_SENTENCE_PARTS = {"miss_m": "miss by at most", "arrival_spread_s": "arrive within"}


def headline_html(report: CampaignReport) -> str:
    """Success rate with confidence interval, and the main bounds; first a note if the campaign is incomplete."""
    estimates = report.estimates
    flown, succeeded, confidence = estimates["flown"], estimates["met"], f"{100 * estimates['confidence']:g} %"
    completeness = _completeness_note(report)
    if not flown:
        return f'{completeness}<div class="answer mixed"><p class="head">No flight so far</p></div>'
    share = f"{100 * estimates['probability']:.2f} %"
    interval = f"{100 * estimates['low']:.2f} to {100 * estimates['high']:.2f} %"
    sentences = [f"{share} of the flights; {interval} at {confidence} confidence{_independence_note(estimates)}."]
    sentences += [
        f"{100 * estimate['share']:g} % of the flights {_SENTENCE_PARTS[estimate['name']]} "
        f"{_value(estimate['value'])}&nbsp;{escape_html(printed_unit(estimate['unit']))} ({_interval_text(estimate)})."
        for estimate in (_main_quantile(estimates, name) for name in _HEADLINES)
        if estimate is not None
    ]
    warning = proximity_warning(_least_separation(report), report.dataset.attrs)
    if report.dataset.attrs.get("separation_required") == 0:
        sentences.append(f"{NO_SEPARATION.capitalize()}.")
    if warning:
        sentences.append(f"<b>Warning:</b> {escape_html(warning)}.")
    css_class, mark = ("good", "✓") if succeeded == flown and not warning else ("mixed", "")
    head = f"{succeeded:,} of {flown:,} flights met every requirement"
    return (
        f'{completeness}<div class="answer {css_class}"><p class="head"><span aria-hidden="true">'
        f"{mark}</span> {head}</p><p>{' '.join(sentences)}</p></div>"
    )


def _least_separation(report: CampaignReport) -> np.ndarray:
    """Least distance between two aircraft in each flight, m; empty for a single aircraft."""
    name = "separation_min_m"
    return report.dataset[name].values if name in report.dataset else np.empty(0)


def _completeness_note(report: CampaignReport) -> str:
    flown, flights = report.estimates["flown"], report.estimates["flights"]
    if flown == flights:
        return ""
    if report.is_converged:
        note = f"After {flown:,} of {flights:,} flights the interval was as narrow as the study asks."
        return f'<p class="caption">{note}</p>'
    return (
        f'<p class="lacking"><b>Partial: {flown:,} of {flights:,} flights.</b> '
        "All that stands below comes from these alone.</p>"
    )


def _independence_note(estimates: Mapping[str, Any]) -> str:
    if estimates["independent"] == estimates["flown"]:
        return ""
    return f", from the {estimates['independent']:,} flights that are independent of each other"


def _main_quantile(estimates: Mapping[str, Any], name: str) -> Mapping[str, Any] | None:
    """Quantile of a quantity nearest to 95 % with a finite bound; None without such a quantile."""
    bounded = [
        estimate for estimate in estimates["quantiles"] if estimate["name"] == name and estimate["value"] is not None
    ]
    return min(bounded, key=lambda estimate: abs(estimate["share"] - 0.95)) if bounded else None


def _interval_text(estimate: Mapping[str, Any]) -> str:
    """Confidence interval as text; a bound that the number of flights cannot give is left open."""
    low, high = estimate["low"], estimate["high"]
    if low is None and high is None:
        return "interval open"
    if low is None or high is None:
        return f"{_value(low)} or more" if high is None else f"{_value(high)} or less"
    return f"{_value(low)} to {_value(high)}"


def _value(value: float | None) -> str:
    """Format with four significant digits."""
    if value is None or not np.isfinite(value):
        return format_number(None, 0)
    if not value:
        return "0"
    digits = 3 - int(np.floor(np.log10(max(abs(value), 1e-6))))
    return format_number(value, max(0, min(9, digits)))


def number_cards(report: CampaignReport) -> str:
    """Cards with the main figures of the campaign."""
    estimates = report.estimates
    confidence = f"{100 * estimates['confidence']:g} %"
    started = int((report.dataset["reason"].values == "").sum())
    cards = [("Flights", f"{estimates['flown']:,}", "", f"of {estimates['flights']:,}")]
    if estimates["probability"] is not None:
        interval = f"{100 * estimates['low']:.2f} to {100 * estimates['high']:.2f} % at {confidence}"
        cards.append(("Met everything", f"{100 * estimates['probability']:.2f}", "%", interval))
    for name in _HEADLINES:
        estimate = _main_quantile(estimates, name)
        if estimate is not None:
            share = f"{100 * estimate['share']:g} % of flights: {estimate['words']}"
            cards.append(
                (
                    escape_html(share),
                    _value(estimate["value"]),
                    escape_html(printed_unit(estimate["unit"])),
                    _interval_text(estimate),
                )
            )
    cards.append(
        (
            "Failed",
            f"{estimates['flown'] - estimates['met']:,}",
            "",
            f"{estimates['flown'] - started:,} could not begin",
        )
    )
    return cards_html(cards)


def failure_causes(report: CampaignReport) -> str:
    """Causes of failure, the most frequent first, with a bar for the share of the failed flights."""
    causes, failed = report.estimates["causes"], report.estimates["flown"] - report.estimates["met"]
    if not causes:
        return '<p class="caption">No flight failed.</p>'
    items = "".join(
        f'<li class="over"><span class="what">{escape_html(cause)}</span>'
        f'<span class="bar"><i style="width:{100 * count / failed:.1f}%"></i></span>'
        f'<span class="share">{100 * count / failed:.0f} %</span>'
        f'<span class="is"><b>{count:,}</b> of {failed:,}</span></li>'
        for cause, count in list(causes.items())[:_CAUSES_MAX]
    )
    hidden_count = len(causes) - _CAUSES_MAX
    hidden_note = (
        f'<p class="caption">{hidden_count} rarer causes are not shown; all are in flights.parquet.</p>'
        if hidden_count > 0
        else ""
    )
    cause = "Part of the flights that failed; a flight may fail of several things."
    return f'<p class="caption">{cause}</p><ol class="margins">{items}</ol>{hidden_note}'


def bounds_table(report: CampaignReport) -> str:
    """Table of the quantiles with confidence intervals: rows are quantities, columns are shares of the flights."""
    quantiles = report.estimates["quantiles"]
    shares = sorted({estimate["share"] for estimate in quantiles})
    headings = '<th class="text">Quantity</th><th class="text">Bound</th>'
    headings += "".join(f"<th>{100 * share:g} % of flights<small>interval</small></th>" for share in shares)
    body = ""
    for name in dict.fromkeys(estimate["name"] for estimate in quantiles):
        by_share = {estimate["share"]: estimate for estimate in quantiles if estimate["name"] == name}
        sample = next(iter(by_share.values()))
        body += f'<tr><td class="text name">{escape_html(sample["words"])}</td>'
        body += f'<td class="text">{"at most" if sample["upper"] else "at least"}</td>'
        body += "".join(_cell(by_share[share]) for share in shares) + "</tr>"
    return scroll_table(headings, body)


def _cell(estimate: Mapping[str, Any]) -> str:
    if estimate["value"] is None:
        return "<td>none<small>too many flights have no number</small></td>"
    unit = escape_html(printed_unit(estimate["unit"]))
    return f"<td>{_value(estimate['value'])} {unit}<small>{_interval_text(estimate)}</small></td>"


def worst_table(report: CampaignReport) -> str:
    """The worst flights: result, values of the varied inputs, and the command that repeats the flight."""
    if not len(report.worst):
        return '<p class="caption">No flight has begun.</p>'
    flights = report.dataset.sel(flight=list(report.worst))
    mapped = [replay.number for replay in report.replays if replay.worst]
    succeeded = flights["met"].values
    columns = {name: worst_of_fleet(flights, name) for name in applicable_quantities(_HEADLINES, flights)}
    headings = (
        "<th>Flight</th>" + "".join(f"<th>{_HEADINGS[name]}</th>" for name in columns) + '<th class="text">Outcome</th>'
    )
    headings += (
        "".join(f"<th>{escape_html(path)}</th>" for path in report.varied_paths) + '<th class="text">Fly it again</th>'
    )
    body = ""
    for k, flight in enumerate(report.worst):
        swatch = (
            f'<span class="swatch" style="background:{page_color_of(mapped.index(flight))}"></span>'
            if flight in mapped
            else ""
        )
        cells = "".join(f"<td>{_input_text(flights[path].values[k])}</td>" for path in report.varied_paths)
        outcome = "met every requirement" if succeeded[k] else _failure_text(flights, k)
        command = f"anser run --campaign {report.folder} --flight {flight}"
        body += (
            f'<tr data-flight="{flight}"><td class="name">{swatch}{flight}</td>'
            + "".join(f"<td>{_value(values[k])}</td>" for values in columns.values())
            + f'<td class="text free">{escape_html(outcome)}</td>{cells}'
            f'<td class="text command"><code>{escape_html(command)}</code></td></tr>'
        )
    return scroll_table(headings, body)


def _failure_text(flights: Any, k: int) -> str:
    statuses = sorted({str(entry) for entry in flights["status"].values[k]} - {"arrived"})
    return "; ".join(
        [*statuses, *(f"not met: {entry}" for entry in str(flights["unmet"].values[k]).split(", ") if entry)]
    )


def _input_text(value: Any) -> str:
    return escape_html(f"{value:.5g}".replace("-", "−")) if isinstance(value, float) else escape_html(value)


def unstarted_flights(report: CampaignReport) -> str:
    """Flights that could not start, grouped by reason; empty if every flight started."""
    reasons = report.dataset["reason"].values
    by_reason: dict[str, list[int]] = {}
    for flight, reason in zip(report.dataset["flight"].values.tolist(), reasons.tolist(), strict=True):
        if reason:
            by_reason.setdefault(reason, []).append(flight)
    if not by_reason:
        return ""
    body = "".join(
        f'<tr><td>{len(flights):,}</td><td class="text free">{escape_html(reason)}</td><td class="text free">'
        f"{', '.join(map(str, flights[:_NUMBERS_MAX]))}{', …' if len(flights) > _NUMBERS_MAX else ''}</td></tr>"
        for reason, flights in sorted(by_reason.items(), key=lambda item: -len(item[1]))
    )
    headings = '<th>Flights</th><th class="text">Reason</th><th class="text">Their numbers</th>'
    return (
        '<section id="not-begun"><h2>Could not begin</h2><p class="caption">They count as failures, with an infinite '
        f"miss, in all that stands above.</p>{scroll_table(headings, body)}</section>"
    )


def provenance_html(report: CampaignReport) -> str:
    """Study, scenario, seed and software versions."""
    attributes, study = report.dataset.attrs, report.study
    versions = [
        f"{escape_html(key.removeprefix('version_'))} {escape_html(value)}"
        for key, value in attributes.items()
        if key.startswith("version_")
    ]
    sampling = ", ".join(
        f"{escape_html(key)} {escape_html(value)}" for key, value in study["sampling"].items() if value is not None
    )
    documents = (("study", study), ("scenario, as far as its file says", json.loads(attributes["scenario"])))
    details = "".join(
        f'<details class="more"><summary>the {name}</summary>'
        f"<pre>{escape_html(json.dumps(values, indent=2, ensure_ascii=False))}</pre></details>"
        for name, values in documents
    )
    return (
        f'<div class="facts"><div>Study <b>{escape_html(study["name"])}</b></div>'
        f"<div>Study hash <code>{escape_html(attributes['study_hash'])}</code></div>"
        f"<div>Scenario hash <code>{escape_html(attributes['scenario_hash'])}</code></div>"
        f"<div>Seed {escape_html(study.get('seed', 0))}</div><div>Sampling: {sampling}</div>"
        f"<div>{', '.join(versions)}</div></div>{details}"
    )


def missing_index_notes(influences: Mapping[str, Any]) -> Sequence[str]:
    """Sentences that give the reason for each output or input without an index."""
    outputs = influences["outputs"]
    return [
        f"{escape_html(outputs.get(name, name))}: none, {escape_html(reason)}."
        for name, reason in influences["not_computed"].items()
    ]


_STYLES = ("vendor/uplot.min.css", "page.css", "campaign.css")
_SCRIPTS = ("vendor/uplot.min.js", "theme.js", "store.js", "campaign.js")


def write_campaign_report(report: CampaignReport, path: Path) -> None:
    """Write the report of a campaign as one HTML page, replacing an earlier one.

    Parameters
    ----------
    shown
        Content of the page.
    path
        HTML file to write.
    """
    write_page(_page(report), path, overwrite=True)


def _page(report: CampaignReport) -> str:
    title = escape_html(report.dataset.attrs["title"])
    confidence = f"{100 * report.estimates['confidence']:g} %"
    independence_note = (
        "" if report.independent.all() else " Only flights that are independent of each other count here."
    )
    contents = f"""<main>
<header>
<h1>{title}</h1>
<p class="lead">{escape_html(report.study.get("description", ""))}</p>
<p id="fault" class="fault" hidden></p>
</header>
<section class="opening"><div>{headline_html(report)}{number_cards(report)}</div>
<div><h2 class="tight">Why flights failed</h2>{failure_causes(report)}</div></section>
<section id="bounds"><h2>Bounds</h2><p class="caption">What part of the flights keeps, with an interval by order
statistics at {confidence} confidence. A flight that has no such number counts as infinitely bad.{independence_note}</p>
{bounds_table(report)}</section>
<section id="converging"><h2>Convergence</h2><p class="caption">Each estimate and its interval at {confidence} against
the number of flights.{independence_note}</p><div class="plots" data-plots="converging"></div></section>
<section id="distributions"><h2>Distributions</h2><p class="caption">Part of the flights that keeps a bound; bars: the
intervals of the bounds above at {confidence}. What is missing to 100 % has no such number.{independence_note}</p>
<div class="plots" data-plots="distributions"></div></section>
{_series(report)}
{_influences(report)}
{_scatter(report)}
<section id="worst"><h2>The worst flights</h2>{_map(report)}{worst_table(report)}</section>
{unstarted_flights(report)}
<section id="provenance"><h2>Study, scenario, versions, seed</h2>{provenance_html(report)}</section>
</main>"""
    return assemble_page(
        f"{title} · anser campaign report",
        body_class="single campaign",
        styles=_STYLES,
        scripts=_SCRIPTS,
        contents=contents,
        data=("campaign", {"colors": len(COLORS), **campaign_data(report)}),
    )


def _series(report: CampaignReport) -> str:
    """Section with the quantiles over time; empty if no variable with numeric values was recorded."""
    if not report.bands:
        return ""
    band = report.bands[0]
    fleet = report.dataset.sizes["aircraft"]
    legend = " ".join(
        f'<span class="swatch" style="background:{page_color_of(k)}"></span>{escape_html(name)}'
        for k, name in enumerate(band.aircraft)
    )
    selection_note = f" The first {len(band.aircraft)} of {fleet} aircraft." if len(band.aircraft) < fleet else ""
    return (
        '<section id="series"><h2>Over time</h2><p class="caption">Of each aircraft the median over the flights (line) '
        "and the band from 5 to 95 % of them, at each time by itself; flights that could not begin are not among "
        f'them.{selection_note}</p><p class="caption">{legend}</p>'
        '<div class="plots" data-plots="series"></div></section>'
    )


def _influences(report: CampaignReport) -> str:
    """Section with the Sobol indices or rank correlations; empty without varied inputs."""
    if not report.varied_paths:
        return ""
    influences = report.influences
    sobol = influences["kind"] == "Sobol indices"
    strips = "".join(
        f'<div><p class="run-name"><b>{escape_html(label)}</b></p>{influence_strip(influences["entries"], name)}</div>'
        for name, label in influences["outputs"].items()
        if any(entry["output"] == name for entry in influences["entries"])
    )
    explanation = (
        "Sobol indices: the part of the variance that an input makes by itself (first) and in whatever combination "
        "(total). What the first ones leave of 1 is combinations, and what is random in each flight."
        if sobol
        else "Spearman rank correlations, −1 to 1: how monotonically an output goes with an input; no parts of a "
        "variance, and blind to what rises and falls. Texts rank in the order of the study."
    )
    body = "".join(
        f'<tr><td class="text">{escape_html(influences["outputs"][entry["output"]])}</td>'
        f'<td class="text name">{escape_html(entry["path"])}</td>'
        f'<td class="text">{escape_html(entry["measure"])}</td>'
        + "".join(f"<td>{format_number(entry[key], 3)}</td>" for key in ("value", "low", "high"))
        + "</tr>"
        for entry in influences["entries"]
    )
    headings = '<th class="text">Output</th><th class="text">Input</th><th class="text">Measure</th>'
    headings += "<th>Value</th><th>From</th><th>To</th>"
    without = "".join(f'<p class="caption">{label}</p>' for label in missing_index_notes(influences))
    return (
        f'<section id="influences"><h2>What it depends on</h2><p class="caption">{explanation} Lines: intervals at '
        f"{100 * influences['confidence']:g} %; from {influences['flights']:,} flights.</p>"
        f'<div class="strips">{strips}</div>{without}'
        f'<details class="more"><summary>the numbers</summary>{scroll_table(headings, body)}</details></section>'
    )


def _scatter(report: CampaignReport) -> str:
    """Section with scatter plots of the outputs over each input; empty without varied inputs."""
    if not report.varied_paths:
        return ""
    return (
        '<section id="against"><h2>Every flight against each input</h2><div class="toolbar"><label class="group">'
        'Quantity <select id="quantity"></select></label><span class="caption">A dot met every requirement, a '
        'cross did not; crosses at the edge have no number. <span id="drawn"></span></span></div>'
        '<div class="plots" data-plots="against"></div></section>'
    )


def _map(report: CampaignReport) -> str:
    svg = campaign_map(report)
    if not svg:
        caption = "Flights that began, the worst first. None was flown again for this report: there is no map."
        return f'<p class="caption">{caption}</p>'
    background_count = sum(not replay.worst for replay in report.replays)
    caption = (
        f"Flights that began, the worst first, in colour over {background_count} others, evenly spaced; from above, "
        "each aircraft until it has arrived. A dot is where one began, a square where it was at the end."
    )
    if report.replay_differences:
        numbers = ", ".join(map(str, report.replay_differences))
        caption += f" Flown again, these did not come out as in the campaign: {numbers}."
    return f'<p class="caption">{caption}</p>{svg}'
