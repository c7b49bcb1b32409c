"""The command envelope."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from anser.cli.arguments import AircraftName, Inversion, VariantName
from anser.cli.console import (
    answer,
    line,
    make_new,
    must_be_known,
    plain_table,
    print_table,
    problem,
    progress_bar,
    say,
)
from anser.cli.offering import about

if TYPE_CHECKING:
    from anser.campaign import EnvelopeSurvey


@about(
    "anser envelope --out envelope",
    "anser envelope --coarse --inversion incremental --out coarse",
    unmet="a flight falls short",
)
def envelope(
    out: Annotated[Path, typer.Option(help="New folder for the dataset and the figures.", show_default=False)],
    aircraft: AircraftName = "f16",
    variant: VariantName = "textbook",
    inversion: Inversion = "model",
    coarse: Annotated[bool, typer.Option("--coarse", help="A grid of 3 x 5 instead of 16 x 18 points.")] = False,
) -> None:
    """Survey the envelope: trim map, and standard commands flown from every point of it."""
    must_be_known(aircraft, variant)
    make_new(out)
    from anser.campaign import survey
    from anser.report import draw_envelope
    from anser.results import write_netcdf

    with progress_bar() as tell:
        surveyed = survey(
            aircraft,
            variant,
            inversion=inversion,
            coarse=coarse,
            progress=tell,
        )
        tell("writing", 1.0)
        write_netcdf(surveyed.dataset, out / "envelope.nc")
        draw_envelope(surveyed.dataset, out)
    answer(lambda: _document(surveyed))
    _print(surveyed)
    say(f"{out}: envelope.nc and figures written")
    for text in surveyed.shortfalls():
        problem(f"falls short: {text}")
    if surveyed.shortfalls():
        raise typer.Exit(1)


def _totals(surveyed: "EnvelopeSurvey") -> dict[str, int]:
    data = surveyed.dataset
    return {
        "points": int(data["trimmable"].size),
        "trimmable": int(data["trimmable"].sum()),
        "with_reserve": int(data["with_reserve"].sum()),
        "flights": int((data["outcome"] > 0).sum()),
    }


def _document(surveyed: "EnvelopeSurvey") -> dict[str, Any]:
    return {
        "format_version": 1,
        "survey": {name: getattr(value, "item", lambda v=value: v)() for name, value in surveyed.dataset.attrs.items()},
        **_totals(surveyed),
        "compile_s": round(surveyed.compile_s, 3),
        "run_s": round(surveyed.run_s, 3),
        "counts": surveyed.counts(),
        "counts_with_reserve": surveyed.counts(with_reserve=True),
        "shortfalls": surveyed.shortfalls(),
    }


def _print(surveyed: "EnvelopeSurvey") -> None:
    meanings = dict(
        zip(
            surveyed.dataset["condition"].values.tolist(),
            surveyed.dataset["condition_meaning"].values.tolist(),
            strict=True,
        )
    )
    table = plain_table("what became of the flights")
    table.add_column("outcome", no_wrap=True)
    for name in (*meanings.values(), "all", "with reserve"):
        table.add_column(name, justify="right")
    with_reserve = surveyed.counts(with_reserve=True)
    for what, numbers in surveyed.counts().items():
        reserve = sum(with_reserve.get(what, {}).values())
        table.add_row(
            what.replace("_", " "), *(str(numbers[name]) for name in meanings), str(sum(numbers.values())), str(reserve)
        )
    print_table(table)
    of = _totals(surveyed)
    line(
        f"{of['trimmable']} of {of['points']} points can be flown steadily, {of['with_reserve']} of them with a tenth "
        f"of power and surfaces left; {of['flights']} flights, {surveyed.run_s:.1f} s "
        f"(and {surveyed.compile_s:.1f} s compiling)"
    )
