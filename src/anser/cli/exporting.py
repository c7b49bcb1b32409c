"""The command export."""

import math
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import typer

from anser.cli.arguments import RunFolder
from anser.cli.console import RefusedError, answer, line, make_new, writing
from anser.cli.offering import about
from anser.cli.run_folder import must_hold, read_run

_START = "2000-01-01T12:00:00Z"


@about(
    "anser export runs/three-aircraft --format czml,kml",
    "anser export runs/three-aircraft --format csv --period-s 1 --out tables",
)
def export(
    run: RunFolder,
    formats: Annotated[
        list[str],
        typer.Option("--format", help="czml, kml, csv, parquet or mat; several with commas, or given several times."),
    ],
    out: Annotated[
        Path | None, typer.Option(help="New folder for the files; left out: beside flight.nc.", show_default=False)
    ] = None,
    start: Annotated[
        str, typer.Option(help="Date and time (UTC) of the flight's time 0 in CZML and KML, which need one.")
    ] = _START,
    period_s: Annotated[
        float | None, typer.Option(help="Only the recorded times nearest to every so many seconds; left out: all.")
    ] = None,
) -> None:
    """Write a flight for Cesium (czml), Google Earth (kml), tables (csv, parquet), MATLAB and Octave (mat)."""
    began = _started(start)
    if period_s is not None and not (math.isfinite(period_s) and period_s > 0):
        raise RefusedError(f"--period-s: arrived {period_s:g}; expected a number above 0")
    from anser.report.exports import FORMATS, NEEDED_VARIABLES, PARQUET_MISSING, has_parquet, thinned

    wanted = list(dict.fromkeys(part.strip() for entry in formats for part in entry.split(",")))
    for name in wanted:
        if name not in FORMATS:
            raise RefusedError(f"--format: arrived {name!r}; expected one of {', '.join(FORMATS)}")
    if "parquet" in wanted and not has_parquet():
        raise RefusedError(f"--format: {PARQUET_MISSING}; or leave parquet out: all others are written without it")
    dataset, summary = read_run(run)
    must_hold(dataset, NEEDED_VARIABLES, run)
    if out is not None:
        make_new(out)
    files = {name: (out or run) / f"flight.{name}" for name in wanted}
    for path in files.values():
        if path.exists():
            raise RefusedError(
                f"--format: arrived {path.suffix[1:]} for {path}, which exists; expected a new file (nothing is "
                "overwritten): give another folder with --out"
            )
    shown = dataset if period_s is None else thinned(dataset, period_s)
    for name, path in files.items():
        content = FORMATS[name](shown, summary, began)
        with writing("--out", path), path.open("xb") as file:
            file.write(content)
        line(f"{path}: {len(content) / 1e6:.1f} MB")
    answer(lambda: {"format_version": 1, "files": {name: str(path) for name, path in files.items()}})


def _started(start: str) -> datetime:
    try:
        began = datetime.fromisoformat(start)
    except ValueError:
        raise RefusedError(f"--start: arrived {start!r}; expected a date and time such as {_START}") from None
    if not 1900 <= began.year <= 2200:
        raise RefusedError(f"--start: arrived {start!r}; expected a year from 1900 to 2200")
    return began if began.tzinfo is not None else began.replace(tzinfo=UTC)
