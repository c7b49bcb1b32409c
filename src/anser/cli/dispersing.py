"""The robustness study."""

import dataclasses
import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer

from anser.cli.arguments import VariantName
from anser.cli.console import (
    RefusedError,
    answer,
    flight_point,
    line,
    make_new,
    must_be_known,
    must_lie,
    number,
    plain_table,
    print_table,
    progress_bar,
    say,
)
from anser.cli.offering import about

if TYPE_CHECKING:
    import xarray as xr

    from anser.campaign import RobustnessStudy
    from anser.results import FailureCorrelation, Success

_AIRCRAFT = "f16"
_STRONGEST, _REASONS = 5, 2
"""How many factors and reasons are printed."""


@about(
    "anser robustness --out robustness",
    "anser robustness --flights 200 --spread 30 --at 150,2000 --out thirty-percent",
)
def robustness(
    out: Annotated[Path, typer.Option(help="New folder for the dataset and the figures.", show_default=False)],
    flights: Annotated[int, typer.Option(help="Flights of each inversion, spread over the conditions.")] = 1000,
    spread: Annotated[float, typer.Option(help="Greatest change of every factor, percent.")] = 20.0,
    seed: Annotated[int, typer.Option(help="What the random draws follow from.")] = 0,
    sweep: Annotated[
        bool, typer.Option("--sweep", help="Fly spreads of 10 to 60 percent and each factor alone, too.")
    ] = False,
    at: Annotated[
        str | None, typer.Option(help="SPEED,ALTITUDE of the only steady flight to leave, m/s and m.")
    ] = None,
    variant: VariantName = "textbook",
) -> None:
    """Fly F-16s that differ from what their autopilot believes, with both inversions: who succeeds, what breaks."""
    must_lie("--flights", flights, 1, 1_000_000)
    must_lie("--spread", spread, 0, 90)
    must_lie("--seed", seed, 0, 2**63 - 1)
    must_be_known(_AIRCRAFT, variant)
    from anser.campaign import ConditionError, FlightPoint, robustness_study
    from anser.campaign.dispersion import CONDITIONS
    from anser.report import draw_robustness
    from anser.results import write_netcdf

    conditions = CONDITIONS if at is None else (FlightPoint(*flight_point(at)),)
    make_new(out)
    with progress_bar() as tell:
        try:
            study = robustness_study(
                variant,
                flights=flights,
                spread=spread / 100,
                seed=seed,
                sweep=sweep,
                conditions=conditions,
                progress=tell,
            )
        except ConditionError as error:
            out.rmdir()
            raise RefusedError(f"--at: arrived {at}; {error}") from None
        tell("writing", 1.0)
        write_netcdf(study.dataset, out / "robustness.nc")
        draw_robustness(study.dataset, out)
    answer(lambda: _document(study))
    _print(study)
    say(f"{out}: robustness.nc and figures written")


def _rates(data: "xr.Dataset") -> dict[str, dict[str, "Success"]]:
    """Success by what was flown and by inversion."""
    from anser.results import flights_of, success

    spread, condition = (data[name].values for name in ("spread_percent", "condition"))
    main, swept = flights_of(data, "dispersed"), flights_of(data, "spread")
    chosen = {"all": main}
    chosen |= {str(place): main & (condition == k) for k, place in enumerate(data["condition_meaning"].values)}
    chosen |= {f"spread {level:.0f} %": swept & (spread == level) for level in np.unique(spread[swept])}
    inversions = [str(name) for name in data["inversion"].values]
    return {name: {of: success(data, of, mask) for of in inversions} for name, mask in chosen.items() if mask.any()}


def _culprits(data: "xr.Dataset") -> dict[str, list["FailureCorrelation"]]:
    """Factors that failures go with most, by inversion."""
    from anser.results import failure_correlations, flights_of

    main = flights_of(data, "dispersed")
    return {str(of): failure_correlations(data, str(of), main)[:_STRONGEST] for of in data["inversion"].values}


def _document(study: "RobustnessStudy") -> dict[str, Any]:
    from anser.results import first_breaks

    data = study.dataset
    of = {name: getattr(value, "item", lambda v=value: v)() for name, value in data.attrs.items()}
    rates = {
        name: {inversion: _plain(dataclasses.asdict(rate)) for inversion, rate in by_inversion.items()}
        for name, by_inversion in _rates(data).items()
    }
    return {
        "format_version": 1,
        "study": of,
        "success": rates,
        "correlation_with_failure": {
            inversion: [dataclasses.asdict(one) for one in strongest]
            for inversion, strongest in _culprits(data).items()
        },
        "first_breaks": [dataclasses.asdict(one) for one in first_breaks(data)],
        "compile_s": round(study.compile_s, 3),
        "run_s": round(study.run_s, 3),
    }


def _plain(values: dict[str, Any]) -> dict[str, Any]:
    """The same with None for a number that is none."""
    return {name: None if isinstance(v, float) and math.isnan(v) else v for name, v in values.items()}


def _print(study: "RobustnessStudy") -> None:
    data = study.dataset
    table = plain_table(f"success, everything dispersed by {data.attrs['spread_percent']:g} %")
    for name in ("flown", "inversion"):
        table.add_column(name, no_wrap=True)
    for name in ("success", "percent", "interval of 95 %", "no steady flight"):
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("the others", no_wrap=True)
    for name, by_inversion in _rates(data).items():
        for inversion, rate in by_inversion.items():
            table.add_row(
                name,
                inversion,
                f"{rate.reached}/{rate.flown}",
                number(100 * rate.share if rate.flown else None, 1),
                f"{100 * rate.low:.1f} to {100 * rate.high:.1f}",
                str(rate.no_steady_flight),
                _shortened(rate.reasons),
            )
    print_table(table)
    for inversion, strongest in _culprits(data).items():
        if strongest:
            words = ", ".join(f"{one.of} of {one.factor} {one.correlation:+.2f}" for one in strongest)
            line(f"failures, {inversion}, correlate with: {words}")
    _print_breaks(data)
    flown = int((data["outcome"].values > 0).sum())
    line(f"{flown} flights, {study.run_s:.1f} s (and {study.compile_s:.1f} s compiling)")


def _shortened(reasons: dict[str, int]) -> str:
    """The most frequent reasons with their numbers, and how many flights have another."""
    named = [f"{why.replace('_', ' ')} {count}" for why, count in list(reasons.items())[:_REASONS]]
    rest = sum(list(reasons.values())[_REASONS:])
    return ", ".join([*named, f"others {rest}"] if rest else named)


def _print_breaks(data: "xr.Dataset") -> None:
    """What breaks first of the factors alone: the smallest change, in the order of size."""
    from anser.results import first_breaks

    found = sorted((b for b in first_breaks(data) if b.reason), key=lambda b: abs(b.change))
    if not found:
        return
    table = plain_table("one factor alone: smallest change flown that breaks a flight")
    for name in ("factor", "inversion"):
        table.add_column(name, no_wrap=True)
    for name in ("change", "value"):
        table.add_column(name, justify="right", no_wrap=True)
    for name in ("why", "where"):
        table.add_column(name, no_wrap=True)
    for b in found:
        why, where = (b.reason or "").replace("_", " "), b.condition or ""
        table.add_row(b.factor.replace("_", " "), b.inversion, f"{100 * b.change:+.0f} %", f"{b.value:.3g}", why, where)
    print_table(table)
