"""Commands for surveys of many flights: envelope, robustness."""

import dataclasses
import math
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer

from anser.cli.app import help_epilog
from anser.cli.arguments import AircraftName, Inversion, SurveyFolder, VariantName
from anser.cli.console import (
    columns,
    fail_if_any,
    flight_point,
    must_be_f16,
    must_be_in_range,
    must_be_known_aircraft,
    print_document,
    print_line,
    print_note,
    print_table,
    progress_bar,
    refuse_on,
)
from anser.cli.folders import Force, open_output_folder

if TYPE_CHECKING:
    import xarray as xr

    from anser.analysis.envelope import EnvelopeSurvey
    from anser.analysis.robustness import RobustnessStudy
    from anser.results.robustness_statistics import FailureCorrelation, SuccessRate


@help_epilog(
    "anser envelope --out envelope",
    "anser envelope --coarse --inversion incremental --out coarse",
    unmet="a flight does not succeed",
)
def envelope(
    out: SurveyFolder,
    aircraft: AircraftName = "f16",
    variant: VariantName = "textbook",
    inversion: Inversion = "model",
    coarse: Annotated[
        bool, typer.Option("--coarse", help="A coarse grid (F-16: 3 x 5 instead of 16 x 18 points).")
    ] = False,
    force: Force = False,
) -> None:
    """Survey the flight envelope: trim map, and standard commands flown from every point."""
    must_be_known_aircraft(aircraft, variant)
    with open_output_folder(out, force) as into, progress_bar() as tell:
        from anser.analysis.envelope import survey_envelope
        from anser.report.envelope_figures import draw_envelope
        from anser.results.netcdf import write_netcdf

        surveyed = survey_envelope(aircraft, variant, inversion=inversion, coarse=coarse, progress=tell)
        tell("writing", 1.0)
        write_netcdf(surveyed.dataset, into / "envelope.nc")
        draw_envelope(surveyed.dataset, into)
    print_document(lambda: _envelope_document(surveyed))
    _print_envelope(surveyed)
    print_note(f"{out}: envelope.nc and figures written")
    fail_if_any(f"falls short: {text}" for text in surveyed.shortfalls())


def _totals(surveyed: "EnvelopeSurvey") -> dict[str, int]:
    data = surveyed.dataset
    return {
        "points": int(data["trimmable"].size),
        "trimmable": int(data["trimmable"].sum()),
        "with_reserve": int(data["with_reserve"].sum()),
        "flights": int((data["outcome"] > 0).sum()),
    }


def _envelope_document(surveyed: "EnvelopeSurvey") -> dict[str, Any]:
    from anser.results.documents import plain_attributes

    return {
        "format_version": 1,
        "survey": plain_attributes(surveyed.dataset.attrs),
        **_totals(surveyed),
        "compile_s": round(surveyed.compile_s, 3),
        "run_s": round(surveyed.run_s, 3),
        "counts": surveyed.counts(),
        "counts_with_reserve": surveyed.counts(with_reserve=True),
        "shortfalls": surveyed.shortfalls(),
    }


def _print_envelope(surveyed: "EnvelopeSurvey") -> None:
    names, headings = (surveyed.dataset[key].values.tolist() for key in ("condition", "condition_meaning"))
    rows = []
    with_reserve = surveyed.counts(with_reserve=True)
    for outcome, counts in surveyed.counts().items():
        reserve = sum(with_reserve.get(outcome, {}).values())
        rows.append([outcome.replace("_", " "), *(counts[name] for name in names), sum(counts.values()), reserve])
    numbers = columns(*headings, "all", "with reserve", justify="right")
    print_table("what became of the flights", [*columns("outcome", no_wrap=True), *numbers], rows)
    totals = _totals(surveyed)
    print_line(
        f"{totals['trimmable']} of {totals['points']} points can be flown steadily, {totals['with_reserve']} of them "
        f"with a tenth of power and surfaces left; {totals['flights']} flights, {surveyed.run_s:.1f} s "
        f"(and {surveyed.compile_s:.1f} s compiling)"
    )


_STRONGEST, _REASONS = 5, 2
"""Greatest numbers of factors that correlate with failures, and of failure reasons, that are printed."""
_F16_STUDY_ONLY = (
    "factors and conditions of this study are the F-16's; of another aircraft anser campaign varies "
    "aircraft[0].deviation of a scenario"
)
"""Alternative to the study for an aircraft other than the F-16."""


@help_epilog(
    "anser robustness --out robustness", "anser robustness --flights 200 --spread 30 --at 150,2000 --out thirty-percent"
)
def robustness(
    out: SurveyFolder,
    flights: Annotated[int, typer.Option(help="Flights of each inversion, spread over the conditions.")] = 1000,
    spread: Annotated[float, typer.Option(help="Greatest change of every factor, percent.")] = 20.0,
    seed: Annotated[int, typer.Option(help="What the random draws follow from.")] = 0,
    sweep: Annotated[
        bool, typer.Option("--sweep", help="Fly spreads of 10 to 60 percent and each factor alone, too.")
    ] = False,
    at: Annotated[
        str | None,
        typer.Option(
            help="SPEED,ALTITUDE of the only steady flight to leave, m/s and m; other airspeeds: see anser step."
        ),
    ] = None,
    aircraft: AircraftName = "f16",
    variant: VariantName = "textbook",
    force: Force = False,
) -> None:
    """Fly F-16s that differ from their autopilot's model, with each inversion: success rates and failure causes."""
    must_be_in_range("--flights", flights, 1, 1_000_000)
    must_be_in_range("--spread", spread, 0, 90)
    must_be_in_range("--seed", seed, 0, 2**63 - 1)
    must_be_known_aircraft(aircraft, variant)
    must_be_f16(aircraft, _F16_STUDY_ONLY)
    from anser.analysis.robustness import CONDITIONS, FlightPoint, robustness_study
    from anser.analysis.trim_points import ConditionError
    from anser.report.robustness_figures import draw_robustness
    from anser.results.netcdf import write_netcdf

    conditions = CONDITIONS if at is None else (FlightPoint(*flight_point(at)),)
    with open_output_folder(out, force) as into, progress_bar() as tell:
        options: dict[str, Any] = {"flights": flights, "spread": spread / 100, "seed": seed, "sweep": sweep}
        with refuse_on(ConditionError, f"--at: arrived {at}; "):
            study = robustness_study(variant, **options, conditions=conditions, progress=tell)
        tell("writing", 1.0)
        write_netcdf(study.dataset, into / "robustness.nc")
        draw_robustness(study.dataset, into)
    print_document(lambda: _study_document(study))
    _print_study(study)
    print_note(f"{out}: robustness.nc and figures written")


def _rates(data: "xr.Dataset") -> dict[str, dict[str, "SuccessRate"]]:
    from anser.results.robustness_statistics import flights_in_part, success

    spread, condition = (data[name].values for name in ("spread_percent", "condition"))
    dispersed, spread_flights = flights_in_part(data, "dispersed"), flights_in_part(data, "spread")
    masks = {"all": dispersed}
    masks |= {str(meaning): dispersed & (condition == k) for k, meaning in enumerate(data["condition_meaning"].values)}
    levels = np.unique(spread[spread_flights])
    masks |= {f"spread {level:.0f} %": spread_flights & (spread == level) for level in levels}
    inversions = [str(name) for name in data["inversion"].values]
    flown = {name: mask for name, mask in masks.items() if mask.any()}
    return {name: {key: success(data, key, mask) for key in inversions} for name, mask in flown.items()}


def _failure_factors(data: "xr.Dataset") -> dict[str, list["FailureCorrelation"]]:
    from anser.results.robustness_statistics import failure_correlations, flights_in_part

    dispersed = flights_in_part(data, "dispersed")
    return {
        str(inversion): failure_correlations(data, str(inversion), dispersed)[:_STRONGEST]
        for inversion in data["inversion"].values
    }


def _study_document(study: "RobustnessStudy") -> dict[str, Any]:
    from anser.results.documents import plain_attributes
    from anser.results.robustness_statistics import first_breaks

    data = study.dataset
    rates = {
        name: {inversion: _plain(dataclasses.asdict(rate)) for inversion, rate in by_inversion.items()}
        for name, by_inversion in _rates(data).items()
    }
    return {
        "format_version": 1,
        "study": plain_attributes(data.attrs),
        "success": rates,
        "correlation_with_failure": {
            inversion: [dataclasses.asdict(item) for item in strongest]
            for inversion, strongest in _failure_factors(data).items()
        },
        "first_breaks": [dataclasses.asdict(item) for item in first_breaks(data)],
        "compile_s": round(study.compile_s, 3),
        "run_s": round(study.run_s, 3),
    }


def _plain(values: dict[str, Any]) -> dict[str, Any]:
    return {name: None if isinstance(v, float) and math.isnan(v) else v for name, v in values.items()}


def _print_study(study: "RobustnessStudy") -> None:
    data = study.dataset
    rows = []
    for name, by_inversion in _rates(data).items():
        for inversion, rate in by_inversion.items():
            percent, interval = 100 * rate.share, f"{100 * rate.low:.1f} to {100 * rate.high:.1f}"
            success = [f"{rate.reached}/{rate.flown}", percent if rate.flown else None, interval]
            rows.append([name, inversion, *success, str(rate.no_steady_flight), _shortened(rate.reasons)])
    numbers = ("success", "percent", "interval of 95 %", "no steady flight")
    headings = [
        *columns("flown", "inversion", no_wrap=True),
        *columns(*numbers, justify="right", no_wrap=True, digits=1),
        *columns("the others", no_wrap=True),
    ]
    print_table(f"success, everything dispersed by {data.attrs['spread_percent']:g} %", headings, rows)
    for inversion, strongest in _failure_factors(data).items():
        if strongest:
            factors = ", ".join(
                f"{factor.measure} of {factor.factor} {factor.correlation:+.2f}" for factor in strongest
            )
            print_line(f"failures, {inversion}, correlate with: {factors}")
    _print_breaks(data)
    flown = int((data["outcome"].values > 0).sum())
    print_line(f"{flown} flights, {study.run_s:.1f} s (and {study.compile_s:.1f} s compiling)")


def _shortened(reasons: dict[str, int]) -> str:
    """Return the most frequent failure reasons with their numbers, and the number of all other failures, as text."""
    shown = [f"{reason.replace('_', ' ')} {count}" for reason, count in list(reasons.items())[:_REASONS]]
    other_count = sum(list(reasons.values())[_REASONS:])
    return ", ".join([*shown, f"others {other_count}"] if other_count else shown)


def _print_breaks(data: "xr.Dataset") -> None:
    from anser.results.robustness_statistics import first_breaks

    breaks = sorted((b for b in first_breaks(data) if b.reason), key=lambda b: abs(b.change))
    if not breaks:
        return
    rows = []
    for b in breaks:
        texts = [(b.reason or "").replace("_", " "), b.condition or ""]
        rows.append([b.factor.replace("_", " "), b.inversion, f"{100 * b.change:+.0f} %", f"{b.value:.3g}", *texts])
    headings = [
        *columns("factor", "inversion", no_wrap=True),
        *columns("change", "value", justify="right", no_wrap=True),
        *columns("why", "where", no_wrap=True),
    ]
    print_table("one factor alone: smallest change flown that breaks a flight", headings, rows)
