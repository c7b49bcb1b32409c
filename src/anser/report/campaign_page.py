"""Report page of a campaign, one HTML file.

A function that returns a dictionary returns values to be inserted into the page's template.
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from anser.files import write_file
from anser.report.campaign_data import CampaignReport, campaign_data
from anser.report.flight_page import cards_html
from anser.report.labels import printed_unit
from anser.report.page_templates import MISSING, format_number, render_page
from anser.report.style import COLORS
from anser.report.svg_charts import campaign_map, influence_strip
from anser.results.arrival import AS_PLANNED
from anser.results.flight_rows import applicable_quantities, worst_of_fleet
from anser.results.separation import NO_SEPARATION, proximity_warning

_CAUSES_MAX = 12
"""Greatest number of failure causes shown."""
_NUMBERS_MAX = 12
"""Greatest number of flights listed by number for one reason of a failed start."""
_HEADLINES = {"miss_m": ("Miss", "m", "miss by at most"), "arrival_spread_s": ("Spread", "s", "arrive within")}
"""Main quantities of a flight by name: heading and unit in the table of the worst flights, and phrase in a sentence."""
_STYLES = ("vendor/uplot.min.css", "page.css", "campaign.css")
_SCRIPTS = ("vendor/uplot.min.js", "theme.js", "store.js", "campaign.js")


def write_campaign_report(report: CampaignReport, path: Path) -> None:
    """Write the report of a campaign as one HTML page; an existing file at `path` is replaced."""
    page = render_page(
        "campaign.html",
        body_class="single campaign",
        styles=_STYLES,
        scripts=_SCRIPTS,
        data=("campaign", {"colors": len(COLORS), **campaign_data(report)}),
        title=report.dataset.attrs["title"],
        fleet_size=report.dataset.sizes["aircraft"],
        input_paths=report.varied_paths,
        folder=report.folder,
        study=report.study,
        series_aircraft=report.bands[0].aircraft if report.bands else (),
        **_success(report),
        **_failures(report),
        **_bounds(report),
        **_influences(report),
        **_worst_flights(report),
        **_provenance(report),
    )
    write_file(path, page, overwrite=True)


def _success(report: CampaignReport) -> dict[str, Any]:
    estimates, dataset = report.estimates, report.dataset
    warning = proximity_warning(np.asarray(dataset.get("separation_min_m", ())), dataset.attrs)
    return {
        "flights": estimates["flights"],
        "flown": estimates["flown"],
        "succeeded": estimates["met"],
        "is_converged": report.is_converged,
        "is_success": estimates["met"] == estimates["flown"] and not warning,
        "success": _success_rate(estimates),
        "confidence": _percent(estimates["confidence"]),
        "independent_count": estimates["independent"],
        "independence_note": (
            "" if report.independent.all() else " Only flights that are independent of each other count here."
        ),
        "main_bounds": [
            _bound(estimate) | {"sentence_part": _HEADLINES[estimate["name"]][2]}
            for estimate in _main_quantiles(estimates)
        ],
        "without_separation": dataset.attrs.get("separation_required") == 0,
        "no_separation": NO_SEPARATION.capitalize(),
        "warning": warning,
        "cards": _cards(report),
    }


def _success_rate(estimates: Mapping[str, Any]) -> dict[str, str] | None:
    if estimates["probability"] is None:
        return None
    low, high = (f"{100 * estimates[end]:.2f}" for end in ("low", "high"))
    return {"share": f"{100 * estimates['probability']:.2f} %", "interval": f"{low} to {high} %"}


def _cards(report: CampaignReport) -> str:
    estimates, success = report.estimates, _success_rate(report.estimates)
    started = int((report.dataset["reason"].values == "").sum())
    cards = [("Flights", f"{estimates['flown']:,}", "", f"of {estimates['flights']:,}")]
    if success is not None:
        share, unit = success["share"].split(" ")
        cards.append(("Met everything", share, unit, f"{success['interval']} at {_percent(estimates['confidence'])}"))
    for estimate in _main_quantiles(estimates):
        bound = _bound(estimate)
        heading = f"{bound['share']} of flights: {estimate['words']}"
        cards.append((heading, bound["value"], bound["unit"], bound["interval"]))
    failed_count = estimates["flown"] - estimates["met"]
    cards.append(("Failed", f"{failed_count:,}", "", f"{estimates['flown'] - started:,} could not begin"))
    return cards_html(cards)


def _main_quantiles(estimates: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """Return, for the miss and for the arrival spread, the quantile nearest to 95 % that has a value, if any."""
    quantiles = []
    for name in _HEADLINES:
        candidates = [estimate for estimate in estimates["quantiles"] if estimate["name"] == name]
        bounded = [estimate for estimate in candidates if estimate["value"] is not None]
        quantiles += sorted(bounded, key=lambda estimate: abs(estimate["share"] - 0.95))[:1]
    return quantiles


def _bound(estimate: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "share": _percent(estimate["share"]),
        "is_missing": estimate["value"] is None,
        "value": _value(estimate["value"]),
        "unit": printed_unit(estimate["unit"]),
        "interval": _interval_text(estimate["low"], estimate["high"]),
    }


def _interval_text(low: float | None, high: float | None) -> str:
    """Return a confidence interval as text: "3 to 5", "3 or more", "5 or less"; "interval open" if both are None."""
    if low is None and high is None:
        return "interval open"
    if low is None or high is None:
        return f"{_value(low)} or more" if high is None else f"{_value(high)} or less"
    return f"{_value(low)} to {_value(high)}"


def _percent(share: float) -> str:
    return f"{100 * share:g} %"


def _value(value: float | None) -> str:
    """Format a number with four significant digits, at most nine decimals; a dash if None or not finite."""
    if value is None or not np.isfinite(value):
        return MISSING
    if not value:
        return "0"
    digits = 3 - int(np.floor(np.log10(max(abs(value), 1e-6))))
    return format_number(value, max(0, min(9, digits)))


def _failures(report: CampaignReport) -> dict[str, Any]:
    causes = list(report.estimates["causes"].items())
    reasons = report.dataset["reason"].values.tolist()
    by_reason: dict[str, list[int]] = {}
    for flight, reason in zip(report.dataset["flight"].values.tolist(), reasons, strict=True):
        if reason:
            by_reason.setdefault(reason, []).append(flight)
    return {
        "causes": causes[:_CAUSES_MAX],
        "hidden_cause_count": len(causes) - _CAUSES_MAX,
        "failed_count": report.estimates["flown"] - report.estimates["met"],
        "unstarted_flights": sorted(by_reason.items(), key=lambda item: -len(item[1])),
        "numbers_max": _NUMBERS_MAX,
    }


def _bounds(report: CampaignReport) -> dict[str, Any]:
    quantiles = report.estimates["quantiles"]
    shares = sorted({estimate["share"] for estimate in quantiles})
    by_name: dict[str, dict[float, Mapping[str, Any]]] = {}
    for estimate in quantiles:
        by_name.setdefault(estimate["name"], {})[estimate["share"]] = estimate
    bounds = []
    for by_share in by_name.values():
        words, is_upper = (by_share[shares[0]][key] for key in ("words", "upper"))
        row = [_bound(by_share[share]) for share in shares]
        bounds.append({"name": words, "is_upper": is_upper, "bounds": row})
    return {"bound_shares": [_percent(share) for share in shares], "bounds": bounds}


def _influences(report: CampaignReport) -> dict[str, Any]:
    influences: Mapping[str, Any] = report.influences if report.varied_paths else {"outputs": {}}
    charts = [
        (label, influence_strip(influences["entries"], output)) for output, label in influences["outputs"].items()
    ]
    return {"influences": influences, "influence_charts": [(label, chart) for label, chart in charts if chart]}


def _worst_flights(report: CampaignReport) -> dict[str, Any]:
    flights = report.dataset.sel(flight=list(report.worst))
    mapped = [replay.number for replay in report.replays if replay.worst]
    names = applicable_quantities(tuple(_HEADLINES), flights)
    columns = [worst_of_fleet(flights, name) for name in names] if len(report.worst) else []
    return {
        "map": campaign_map(report),
        "background_count": sum(not replay.worst for replay in report.replays),
        "replay_differences": report.replay_differences,
        "worst_columns": [_HEADLINES[name][:2] for name in names],
        "worst_flights": [
            {
                "number": number,
                "map_index": mapped.index(number) if number in mapped else None,
                "numbers": [_value(values[k]) for values in columns],
                "outcome": "met every requirement" if flights["met"].values[k] else _failure_text(flights, k),
                "inputs": [_input_text(flights[path].values[k]) for path in report.varied_paths],
            }
            for k, number in enumerate(report.worst)
        ],
    }


def _failure_text(flights: Any, k: int) -> str:
    statuses = sorted({str(status) for status in flights["status"].values[k]} - AS_PLANNED)
    unmet = [name for name in str(flights["unmet"].values[k]).split(", ") if name]
    return "; ".join([*statuses, *(f"not met: {name}" for name in unmet)])


def _input_text(value: Any) -> str:
    return f"{value:.5g}".replace("-", "−") if isinstance(value, float) else str(value)


def _provenance(report: CampaignReport) -> dict[str, Any]:
    attributes, prefix = report.dataset.attrs, "version_"
    documents = {"study": report.study, "scenario, as far as its file says": json.loads(attributes["scenario"])}
    return {
        "study_hash": attributes["study_hash"],
        "scenario_hash": attributes["scenario_hash"],
        "sampling": [(key, value) for key, value in report.study["sampling"].items() if value is not None],
        "versions": [(key.removeprefix(prefix), value) for key, value in attributes.items() if key.startswith(prefix)],
        "documents": [(name, json.dumps(values, indent=2, ensure_ascii=False)) for name, values in documents.items()],
    }
