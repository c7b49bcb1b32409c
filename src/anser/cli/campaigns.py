"""Commands for studies: campaign fly, campaign report, campaign compare, rare."""

import contextlib
import statistics
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from anser.cli.app import help_epilog
from anser.cli.console import (
    InputError,
    columns,
    number,
    print_document,
    print_line,
    print_note,
    print_problem,
    print_table,
    progress_bar,
    refuse_on,
)
from anser.cli.folders import Force, open_output_folder
from anser.config.errors import ScenarioError
from anser.scenario.cautions import find_cautions
from anser.scenario.schema import Scenario

if TYPE_CHECKING:
    from anser.campaigns.campaign_folder import Campaign
    from anser.campaigns.comparison import CampaignComparison
    from anser.campaigns.estimates import CampaignEstimates, QuantileEstimate
    from anser.campaigns.rare_events import RareEvent
    from anser.campaigns.store import CampaignStore
    from anser.missions.runs import FlightResult


_KEYS = 12
"""Greatest number of differing scenario keys that are printed."""
_CampaignFolder = Annotated[Path, typer.Argument(help="Folder of a campaign: flights.zarr.", metavar="FOLDER")]


_Processes = Annotated[
    int | None, typer.Option(min=1, help="How many fly at a time; left out: one a core, if memory lasts.")
]


@help_epilog("anser campaign report runs/how-surely", "anser campaign report runs/how-surely --worst 0")
def report(
    folder: _CampaignFolder,
    worst: Annotated[
        int, typer.Option(min=0, max=1000, help="How many of the worst flights are flown again and drawn; 0: no map.")
    ] = 5,
    others: Annotated[
        int, typer.Option(min=0, max=1000, help="How many evenly spaced flights the worst are drawn over.")
    ] = 20,
) -> None:
    """Write the report of a complete or partial campaign: estimates, influences, worst flights; and tables.

    The page report.html works offline. Tables in Parquet format need pyarrow.
    """
    store = read_campaign_store(folder, "FOLDER")
    if not store.flown.size:
        raise InputError(f"FOLDER: arrived {folder}, where no chunk of flights is complete; expected one at least")
    from anser.campaigns.campaign_report import write_campaign
    from anser.campaigns.store_integrity import StoreError
    from anser.report.exports.tables import PARQUET_MISSING, has_parquet

    with refuse_on(StoreError, "FOLDER: "), progress_bar() as tell:
        written = write_campaign(store, worst, others, tell)
    print_document(
        lambda: {"format_version": 1, "flown": int(store.flown.size), "files": [str(path) for path in written]}
    )
    for path in written:
        print_line(f"{path}: written")
    if store.flown.size < store.flights and store.converged_chunks is None:
        print_note(f"partial: {store.flown.size} of {store.flights} flights")
    if not has_parquet():
        print_note(f"no tables: {PARQUET_MISSING}")


@help_epilog(
    "anser campaign compare runs/how-surely runs/windier",
    "anser campaign compare runs/how-surely runs/windier --out compared",
)
def compare(
    folder: _CampaignFolder,
    other: Annotated[Path, typer.Argument(help="Folder of a second campaign with the same seeds.")],
    out: Annotated[Path | None, typer.Option(help="New folder for the figure.")] = None,
    force: Force = False,
) -> None:
    """Compare two campaigns with paired seeds flight by flight: the better campaign, how often and by how much."""
    read_campaign_store(folder, "FOLDER")
    read_campaign_store(other, "OTHER")
    from anser.campaigns.comparison import compare_campaigns
    from anser.report.campaign_figures import draw_paired

    with contextlib.nullcontext() if out is None else open_output_folder(out, force) as into:
        with refuse_on(ValueError, f"{folder}, {other}: "):
            comparison = compare_campaigns(folder, other)
        written = () if into is None else draw_paired(comparison.dataset, into)
    if out is not None:
        print_note(f"{out}: {', '.join(path.name for path in written) or 'nothing'} written")
    print_document(lambda: {"format_version": 1, **comparison.as_dict()})
    _print_comparison(comparison)


def _print_comparison(comparison: "CampaignComparison") -> None:
    confidence = f"{100 * comparison.confidence:g} %"
    print_line(f"{comparison.flights} pairs; first: {comparison.first}; second: {comparison.second}")
    print_line(
        f"every requirement met in both {comparison.both}, in the first alone {comparison.first_only}, "
        f"in the second alone {comparison.second_only}, in neither {comparison.neither}; "
        f"McNemar, exact: p = {comparison.p_value:.3g}"
    )
    for difference in comparison.differences:
        better = "more" if difference.greater_is_better else "less"
        print_line(
            f"{difference.words}: {better} in the second in {difference.second_better} flights, alike in "
            f"{difference.alike}, {better} in the first in {difference.first_better}; {100 * difference.share:.2f} % "
            f"({100 * difference.low:.2f} to {100 * difference.high:.2f} % at {confidence} confidence) "
            "better in the second"
        )
    print_table(
        f"second less first, bounds that part of the pairs stay below; interval at {confidence} confidence",
        [
            *columns("", overflow="fold"),
            *columns("of pairs", "below", "from", "to", justify="right", digits=4),
            *columns("unit"),
        ],
        [
            (difference.words, f"{100 * share:g} %", *values, difference.unit)
            for difference in comparison.differences
            for share, *values in difference.quantiles
        ],
    )
    if comparison.precision[0] != comparison.precision[1]:
        print_line(f"flown in {comparison.precision[0]} in the first, in {comparison.precision[1]} in the second")
    for path, count in comparison.applied.items():
        print_line(f"applied otherwise in {count} of {comparison.flights} pairs: {path}")
    for path, first_value, second_value in comparison.scenario[:_KEYS]:
        print_line(f"scenario, {path}: {first_value} in the first, {second_value} in the second")
    if len(comparison.scenario) > _KEYS:
        print_line(f"and {len(comparison.scenario) - _KEYS} more keys of the scenario")


def read_campaign_store(folder: Path, argument: str) -> "CampaignStore":
    """Open the store of a campaign folder; `argument` is the name of the command-line argument, for messages.

    Raises InputError if the folder has no campaign or a file is damaged.
    """
    from anser.campaigns.store import CampaignStore
    from anser.campaigns.store_integrity import StoreError

    with refuse_on(StoreError, f"{argument}: "):
        return CampaignStore.open(folder)


_CAUSES = 8
"""Greatest number of failure causes that are printed."""
_MILLISECONDS_BELOW_S = 0.01


@help_epilog(
    "anser campaign studies/how-surely.toml --out runs/how-surely",
    "anser campaign studies/how-surely.toml --out runs/how-surely --resume",
    unmet="a flight does not meet a requirement, or cannot start",
)
def fly(
    study: Annotated[Path, typer.Argument(help="Study file (TOML).")],
    out: Annotated[Path, typer.Option(help="Folder of the campaign; new, unless --resume.")],
    resume: Annotated[
        bool, typer.Option("--resume", help="Fly what is missing or damaged of the campaign in the folder.")
    ] = False,
    processes: _Processes = None,
    cluster: Annotated[str | None, typer.Option(help="Address of a dask scheduler, whose workers fly instead.")] = None,
    precision: Annotated[
        str | None, typer.Option(help="In which flights are flown, float64 or float32; left out: as the study says.")
    ] = None,
) -> None:
    """Fly a study: one scenario many times with dispersed values, to estimate how reliably the requirements are met.

    The word fly may be omitted: anser campaign STUDY --out FOLDER.
    """
    from anser.campaigns.campaign_folder import open_campaign_store
    from anser.campaigns.store_integrity import StoreError

    with refuse_on(StoreError), _refuse_old_folder(out):
        store = open_campaign_store(study, out, resume=resume, precision=precision)
    with _locked(store):
        _fly(store, out, processes, cluster)


@contextlib.contextmanager
def _refuse_old_folder(out: Path) -> Iterator[None]:
    try:
        yield
    except FileExistsError:
        raise InputError(f"--out: arrived {out}, which exists; expected a new folder, or --resume") from None


@contextlib.contextmanager
def _locked(store: "CampaignStore") -> Iterator[None]:
    """Lock a campaign's folder in the `with` block, and print which flights are flown again because of damaged files.

    Raises InputError if another process flies the campaign.
    """
    from anser.campaigns.store_integrity import StoreError

    with contextlib.ExitStack() as lock:
        with refuse_on(StoreError):
            lock.enter_context(store.locked())
        for message in store.damages:
            print_note(message)
        yield


def _fly(store: "CampaignStore", out: Path, processes: int | None, cluster: str | None) -> None:
    """Fly the missing flights of a campaign, then print the estimates and write the report, even after Ctrl-C.

    Exits with code 1 if a flight does not meet a requirement or cannot start.
    """
    from anser.campaigns.campaign_folder import Campaign
    from anser.campaigns.flights import campaign_process_limit, find_bound_cautions, fly_campaign
    from anser.campaigns.replay import archive_worst
    from anser.campaigns.store_integrity import StoreError

    for caution in (*find_cautions(store.scenario), *find_bound_cautions(store.study, store.scenario)):
        print_note(f"caution: {caution}")
    flown, flown_before = Campaign(store), store.flown.size
    if processes is None and cluster is None:
        limit = campaign_process_limit(store)
        processes = limit.processes
        if limit.message:
            print_note(limit.message)
    try:
        with progress_bar() as tell:
            fly_campaign(store, processes or 1, tell, cluster)
            archive_worst(store, tell)
    except KeyboardInterrupt:
        _print_estimates(flown.estimates(), flown)
        _write(store, flown_before)
        print_note(_resume_note(store))
        raise
    except StoreError as error:
        _write(store, flown_before)
        print_note(_resume_note(store))
        raise InputError(str(error)) from None
    except OSError:
        print_note(_resume_note(store))
        raise
    estimates = flown.estimates()
    print_document(lambda: {"format_version": 1, "study": store.study.name, **estimates.as_dict()})
    _print_estimates(estimates, flown)
    written = ["flights.zarr", *_write(store, flown_before)]
    print_note(f"{out}: {', '.join(written)} written; anser campaign report {out} draws the worst flights, too")
    if estimates.met < estimates.flown:
        print_problem(
            f"{estimates.flown - estimates.met} of {estimates.flown} flights did not meet every requirement, "
            "or could not begin"
        )
        raise typer.Exit(1)


def _resume_note(store: "CampaignStore") -> str:
    return f"{store.folder}: {store.flown.size} of {store.flights} flights; --resume flies the others"


def _write(store: "CampaignStore", flown_before: int) -> list[str]:
    """Write the report of a campaign, without the map of the worst flights; return the names of the written files.

    Nothing is written if no flight is complete, or if a report exists and only `flown_before` flights are complete.
    """
    from anser.campaigns.campaign_report import REPORT, write_campaign

    # the existing report may show the worst flights on a map
    if not store.flown.size or (store.flown.size == flown_before and (store.folder / REPORT).exists()):
        return []
    return [path.name for path in write_campaign(store, worst=0)]


def campaign_flight(folder: Path, number: int) -> "tuple[CampaignStore, Scenario]":
    """Return the store of a campaign folder and the scenario of flight `number`.

    Raises InputError if the folder has no campaign or the number is out of range. Raises ScenarioError if the flight's
    scenario is invalid.
    """
    from anser.campaigns.flights import flight_scenario

    store = read_campaign_store(folder, "--campaign")
    try:
        return store, flight_scenario(store, number)
    except ScenarioError:
        raise
    except ValueError as error:
        raise InputError(f"--{error}") from None


def report_replay(store: "CampaignStore", number: int, flown: "FlightResult") -> None:
    """Print whether flight `number`, flown again, has the result that the campaign stored."""
    from anser.campaigns.replay import replay_differences

    if number not in store.flown:
        print_note(f"flight {number} has not been flown in the campaign yet")
        return
    differences = replay_differences(store, number, flown.summary, met=flown.met)
    if not differences:
        print_note(f"flight {number}: as in the campaign")
    for name, deviation in differences.items():
        text = (
            f"differs by {deviation:.2g} of its scale"
            if isinstance(deviation, float)
            else f"is {deviation} in the campaign"
        )
        print_problem(f"flight {number}: {name} {text}: another version, or rounding that led to another decision")


def _bound_cells(quantile: "QuantileEstimate") -> list[str]:
    """Return the table cells of a quantile: value, confidence interval and unit (ms for times below 10 ms)."""
    values = quantile.value, quantile.low, quantile.high
    magnitudes = [abs(value) for value in values if value is not None]
    if quantile.unit == "s" and max(magnitudes, default=1.0) < _MILLISECONDS_BELOW_S:
        return [*(number(None if value is None else 1000.0 * value, 3) for value in values), "ms"]
    return [*(number(value, 3) for value in values), "" if quantile.unit == "1" else quantile.unit]


def _print_estimates(estimates: "CampaignEstimates", flown: "Campaign") -> None:
    from anser.results.separation import NO_SEPARATION, proximity_warning

    name, data = flown.store.study.name, flown.dataset
    if not estimates.flown:
        print_line(f"{name}: no flight so far")
        return
    confidence, share = f"{100 * estimates.confidence:g} %", 100 * (estimates.probability or 0.0)
    interval = f"{100 * estimates.low:.2f} to {100 * estimates.high:.2f} % at {confidence} confidence"
    if estimates.independent < estimates.flown:
        interval += f", from {estimates.independent} that are independent of each other"
    separation_note = f"; {NO_SEPARATION}" if data.attrs.get("separation_required") == 0 else ""
    print_line(
        f"{name}: {estimates.met} of {estimates.flown} flights meet every requirement, {share:.2f} % "
        f"({interval}){separation_note}"
    )
    warning = proximity_warning(data["separation_min_m"].values, data.attrs)
    if warning:
        print_note(f"warning: {warning}")
    print_table(
        f"bounds that part of the flights keep; interval at {confidence} confidence",
        [
            *columns("", overflow="fold"),
            *columns("of flights", "bound", "from", "to", justify="right"),
            *columns("unit"),
        ],
        [(quantile.words, f"{100 * quantile.share:g} %", *_bound_cells(quantile)) for quantile in estimates.quantiles],
    )
    for cause, count in list(estimates.causes.items())[:_CAUSES]:
        print_line(f"{count} flights: {cause}")
    print_line(f"worst flights: {', '.join(map(str, estimates.worst))}")


@help_epilog(
    "anser rare studies/how-rarely.toml --out runs/how-rarely",
    "anser rare studies/how-rarely.toml --out runs/how-rarely --resume",
    unmet="the levels end before the threshold: the event is too rare for this method and its budget",
)
def rare(
    study: Annotated[Path, typer.Argument(help=r"Study file (TOML) with a table \[rare].")],
    out: Annotated[Path, typer.Option(help="Folder of the event; new, unless --resume.")],
    resume: Annotated[bool, typer.Option("--resume", help="Fly what is missing of the event in the folder.")] = False,
    processes: _Processes = None,
) -> None:
    """Estimate the probability of a rare event of a study by subset simulation (level by level)."""
    from anser.campaigns.rare_events import rare as flown_event
    from anser.campaigns.rare_flights import RareStore
    from anser.campaigns.store_integrity import StoreError

    try:
        with refuse_on(StoreError), _refuse_old_folder(out), progress_bar() as tell:

            def told(activity: str, fraction: float | None) -> None:
                tell(activity, fraction)
                if fraction is None:
                    print_note(activity)

            event = flown_event(study, out, resume=resume, processes=processes, progress=told)
    except KeyboardInterrupt:
        if out.exists():
            print_note(f"{out}: {RareStore.open(out, verify_chunks=False).flown} flights; --resume goes on")
        raise
    print_document(lambda: event.document)
    _print_rare_event(event)
    print_note(f"{out}: rare.json and figure written")
    if event.estimate.probability is None:
        expected = f"more levels than {event.flights.config.levels_max}, or a threshold that is nearer"
        print_problem(f"the levels end short of the threshold; expected {expected}")
        raise typer.Exit(1)


def _print_rare_event(rare_event: "RareEvent") -> None:
    document, estimate = rare_event.document, rare_event.estimate
    confidence = f"at {100 * document['confidence']:g} % confidence"
    event = f"{document['statistic']} {document['breached']} {document['threshold']:g}"
    if estimate.probability is None:
        print_line(f"{document['study']}: {event}: probability below {estimate.high:.2g} {confidence}")
    else:
        interval = f"{estimate.low:.2g} to {estimate.high:.2g} {confidence}"
        print_line(f"{document['study']}: {event}: probability {estimate.probability:.2g} ({interval})")
    print_table(
        f"levels of {document['repetitions']} repetitions, {document['flights']} flights; medians",
        [
            *columns("level", "flights", justify="right"),
            *columns(f"from {document['statistic']}", "leading on", "accepted", justify="right", digits=3),
        ],
        [
            (k + 1, level["flights"], *(_median(level[key]) for key in ("bounds", "shares", "acceptances")))
            for k, level in enumerate(document["levels"])
        ],
    )


def _median(values: list[float | None]) -> float | None:
    numbers = [value for value in values if value is not None]
    return statistics.median(numbers) if numbers else None
