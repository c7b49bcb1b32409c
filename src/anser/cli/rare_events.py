"""Command rare: how probable a rare event of a study is."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from anser.cli.console import (
    RefusedError,
    answer,
    columns,
    line,
    number,
    plain_table,
    print_table,
    problem,
    progress_bar,
    say,
)
from anser.cli.offering import about

if TYPE_CHECKING:
    from anser.campaigns import RareEvent


@about(
    "anser rare studies/how-rarely.toml --out runs/how-rarely",
    "anser rare studies/how-rarely.toml --out runs/how-rarely --resume",
    unmet="the levels end short of the threshold: the event is rarer than could be found",
)
def rare(
    study: Annotated[Path, typer.Argument(help="Study file (TOML) with a table [rare].", show_default=False)],
    out: Annotated[Path, typer.Option(help="Folder of the event; new, unless --resume.", show_default=False)],
    resume: Annotated[bool, typer.Option("--resume", help="Fly what is missing of the event in the folder.")] = False,
    processes: Annotated[
        int | None,
        typer.Option(min=1, help="How many fly at a time; left out: one a core, if memory lasts.", show_default=False),
    ] = None,
) -> None:
    """Find how probable a rare breach of a study is, by flying towards it level by level."""
    from anser.campaigns import RareStore, StoreError
    from anser.campaigns import rare as flown_event

    try:
        with progress_bar() as tell:

            def told(what: str, part: float | None) -> None:
                tell(what, part)
                if part is None:
                    say(what)

            found = flown_event(study, out, resume=resume, processes=processes, progress=told)
    except FileExistsError:
        raise RefusedError(f"--out: arrived {out}, which exists; expected a new folder, or --resume") from None
    except StoreError as error:
        raise RefusedError(str(error)) from None
    except KeyboardInterrupt:
        if out.exists():
            say(f"{out}: {RareStore.open(out).flown} flights; --resume goes on")
        raise
    answer(lambda: found.document)
    _print(found)
    say(f"{out}: rare.json and figure written")
    if found.estimate.probability is None:
        words = f"more levels than {found.flights.asked.levels_max}, or a threshold that is nearer"
        problem(f"the levels end short of the threshold; expected {words}")
        raise typer.Exit(1)


def _print(found: "RareEvent") -> None:
    """Probability and levels."""
    document, estimate = found.document, found.estimate
    sure = f"at {100 * document['confidence']:g} % confidence"
    event = f"{document['statistic']} {document['breached']} {document['threshold']:g}"
    if estimate.probability is None:
        line(f"{document['study']}: {event}: probability below {estimate.high:.2g} {sure}")
    else:
        interval = f"{estimate.low:.2g} to {estimate.high:.2g} {sure}"
        line(f"{document['study']}: {event}: probability {estimate.probability:.2g} ({interval})")
    table = plain_table(
        f"levels of {document['repetitions']} repetitions, {document['flights']} flights; medians",
        *columns("level", "flights", f"from {document['statistic']}", "leading on", "accepted", justify="right"),
    )
    for k, level in enumerate(document["levels"]):
        medians = [_median(level[key]) for key in ("bounds", "shares", "acceptances")]
        table.add_row(str(k + 1), str(level["flights"]), *[number(value, 3) for value in medians])
    print_table(table)


def _median(values: list[float | None]) -> float | None:
    known = sorted(value for value in values if value is not None)
    return known[len(known) // 2] if known else None
