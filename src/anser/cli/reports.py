"""Commands for finished runs: report, export, figures."""

import math
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any

import typer

from anser.cli.app import help_epilog
from anser.cli.arguments import RunFolder, complete_run
from anser.cli.console import InputError, activity, fail_if_any, print_document, print_line, refuse_on
from anser.cli.folders import (
    Force,
    check_run_folder,
    must_be_writable,
    open_output_file,
    open_output_folder,
    read_aircraft_flight,
    read_flight,
    read_run,
)
from anser.files import write_file
from anser.missions.saved_flights import RUN_FILES


@help_epilog("anser report runs/three-aircraft --force", "anser report runs/a runs/b --out beside.html")
def report(
    run: RunFolder,
    other: Annotated[
        Path | None,
        typer.Argument(help="Folder of a second run, to stand beside the first.", autocompletion=complete_run),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="File to write; default RUN/report.html. Needed for two runs.")
    ] = None,
    force: Force = False,
) -> None:
    """Write the report of a run again, or of two runs side by side, as one page that works offline."""
    if other is not None and out is None:
        raise InputError("--out: arrived nothing; expected a file for the report of two runs, such as beside.html")
    target = out if out is not None else run / "report.html"
    folders = {argument: folder for argument, folder in (("RUN", run), ("OTHER", other)) if folder is not None}
    for argument, folder in folders.items():
        check_run_folder(folder, argument)
    if out is None and target.exists() and not force:
        raise InputError(f"--out: arrived nothing, and {target} exists; give --force to write it anew, or --out FILE")
    must_be_writable("--out", target, force)
    if target.name in RUN_FILES:
        raise InputError(f"--out: arrived {target}, which holds a run; expected another file, such as report.html")
    from anser.report.flight_page import write_comparison, write_report  # late import: wrong arguments come first

    runs = [(str(folder), *read_run(folder, argument)) for argument, folder in folders.items()]
    try:
        with open_output_file("--out", target, force) as file:
            if other is None:
                write_report(*runs[0][1:], file)
            else:
                write_comparison(runs, file)
    except ValueError as error:
        message = f"{error}; expected what one flight of `anser run` wrote"
        raise InputError(f"{' and '.join(map(str, folders.values()))}: {message}") from None
    print_document(lambda: {"format_version": 1, "file": str(target)})
    print_line(f"{target}: written")


_START = "2000-01-01T12:00:00Z"


@help_epilog(
    "anser export runs/three-aircraft --format czml,kml",
    "anser export runs/three-aircraft --format csv --period-s 1 --out tables",
    unmet=(
        "a format was not written because its library is missing, "
        "the others were written (2 if no other format was requested)"
    ),
)
def export(
    run: RunFolder,
    formats: Annotated[
        list[str],
        typer.Option("--format", help="czml, kml, csv, parquet or mat; several with commas, or given several times."),
    ],
    out: Annotated[Path | None, typer.Option(help="New folder for the files; left out: beside flight.nc.")] = None,
    start: Annotated[
        str, typer.Option(help="Date and time (UTC) of the flight's time 0 in CZML and KML, which need one.")
    ] = _START,
    period_s: Annotated[
        float | None, typer.Option(help="Only the recorded times nearest to every so many seconds; left out: all.")
    ] = None,
    force: Force = False,
) -> None:
    """Write a flight for Cesium (czml), Google Earth (kml), tables (csv, parquet), MATLAB and Octave (mat).

    A flight of one aircraft by `anser simulate` can be written as csv, parquet and mat only.
    """
    start_time = _started(start)
    if period_s is not None and not (math.isfinite(period_s) and period_s > 0):
        raise InputError(f"--period-s: arrived {period_s:g}; expected a number above 0")
    from anser.report.exports.geographic import NEEDED_VARIABLES
    from anser.report.exports.tables import FORMATS, PARQUET_MISSING, TABLES, has_parquet, thin_record

    format_names = list(dict.fromkeys(part.strip() for entry in formats for part in entry.split(",")))
    for name in format_names:
        if name not in FORMATS:
            raise InputError(f"--format: arrived {name!r}; expected one of {', '.join(FORMATS)}")
    unavailable = [] if has_parquet() else [name for name in format_names if name == "parquet"]
    if format_names == unavailable:
        raise InputError(f"--format: {PARQUET_MISSING}; all other formats are written without it")
    folder = run if out is None else out
    files = {name: folder / f"flight.{name}" for name in format_names if name not in unavailable}
    for path in files.values():
        if out is None and path.exists() and not force:
            raise InputError(
                f"--format: arrived {path.suffix[1:]} for {path}, which exists; expected a new file: give another "
                "folder with --out, or --force (nothing is overwritten without it)"
            )
    flight = read_aircraft_flight(run)
    no_tables = [] if flight is None else [name for name in format_names if name not in TABLES]
    if no_tables:
        raise InputError(
            f"--format: arrived {', '.join(no_tables)} for {run}, a flight of one aircraft without goals by `anser "
            f"simulate`; expected {', '.join(TABLES)}"
        )
    dataset, summary = read_flight(run, NEEDED_VARIABLES) if flight is None else (flight, {})
    exported = dataset if period_s is None else thin_record(dataset, period_s)
    with open_output_folder(folder, force or out is None) as into:
        for name, path in files.items():
            content = FORMATS[name](exported, summary, start_time)
            write_file(into / path.name, content)
            print_line(f"{path}: {len(content) / 1e6:.1f} MB")
    left_out = dict.fromkeys(unavailable, PARQUET_MISSING)
    document = {"format_version": 1, "files": {name: str(path) for name, path in files.items()}}
    print_document(lambda: document | ({"left_out": left_out} if left_out else {}))
    fail_if_any(f"{folder / f'flight.{name}'}: not written: {reason}" for name, reason in left_out.items())


def _started(start: str) -> datetime:
    try:
        start_time = datetime.fromisoformat(start)
    except ValueError:
        raise InputError(f"--start: arrived {start!r}; expected a date and time such as {_START}") from None
    if not 1900 <= start_time.year <= 2200:
        raise InputError(f"--start: arrived {start!r}; expected a year from 1900 to 2200")
    return start_time if start_time.tzinfo is not None else start_time.replace(tzinfo=UTC)


_AIRCRAFT, _VARIANT = "f16", "textbook"
_STEP_POINT: dict[str, Any] = {"speed_m_s": 150.0, "altitude_m": 1000.0}


@help_epilog(
    "anser figures --out figures",
    "anser figures runs/three-aircraft --out figures",
    "anser figures runs/three-aircraft --out column --only bank,tracks --width 88 --no-title",
)
def figures(
    out: Annotated[Path, typer.Option(help="New folder for the figures.")],
    run: Annotated[
        Path | None,
        typer.Argument(help="Folder that anser run wrote; left out: the published cases.", autocompletion=complete_run),
    ] = None,
    only: Annotated[
        str | None, typer.Option(help="Figures of the flight to draw, with commas: bank,tracks; left out: all.")
    ] = None,
    width: Annotated[
        float | None, typer.Option(help="Width in mm: 88 for one column, 180 for two; left out: 165.")
    ] = None,
    no_title: Annotated[bool, typer.Option("--no-title", help="Leave the title above each figure out.")] = False,
    force: Force = False,
) -> None:
    """Draw figures for a paper as PDF, SVG and PNG: of a flight, or of all published cases.

    The published cases are the step responses, the climb-and-turn, the families of paths with the shape parameters b4
    and c4, and the flights of one and three aircraft; computing them takes a few minutes the first time.
    """
    if run is not None:
        check_run_folder(run)
        from anser.report.flight_figures import NEEDED_VARIABLES, available_figures, draw_flight, select_figures
        from anser.report.flight_sheet import FigureFormat

        with refuse_on(ValueError, "--width: "):
            figure_format = FigureFormat(title=not no_title) if width is None else FigureFormat(width, not no_title)
        dataset, _ = read_flight(run, NEEDED_VARIABLES)
        with refuse_on(ValueError, "--only: "):
            names = available_figures(dataset) if only is None else [name.strip() for name in only.split(",")]
            selection = select_figures(dataset, names)
        with open_output_folder(out, force) as into, activity("drawing"):
            paths = draw_flight(dataset, "flight", into, selection=selection, figure_format=figure_format)
            written = [path.name for path in paths]
    else:
        if only is not None or width is not None or no_title:
            raise InputError(
                "RUN: arrived nothing; expected the folder of a run: --only, --width and --no-title are of its figures"
            )
        with open_output_folder(out, force) as into:
            written = [path.name for path in _published(into)]
    kinds = sorted({Path(name).suffix for name in written})
    count = len(written) // len(kinds)
    count_text = "1 figure" if count == 1 else f"{count} figures, each"
    print_document(lambda: {"format_version": 1, "files": [str(out / name) for name in written]})
    print_line(f"{out}: {count_text} as {', '.join(kinds)}")


def _published(out: Path) -> Iterator[Path]:
    from anser.analysis.step_flights import fly_climb_and_turn, fly_steps
    from anser.analysis.step_tests import PUBLISHED_STEPS
    from anser.report.aircraft_figures import draw_overview, draw_step, draw_tracking
    from anser.report.flight_figures import draw_flight
    from anser.report.plan_figures import draw_shapes
    from anser.report.style import FIGURE_SUFFIXES
    from anser.verification.missions import published_flights
    from anser.verification.polynomial_paths import shape_families

    def paths(name: str) -> list[Path]:
        return [out / f"{name}{suffix}" for suffix in FIGURE_SUFFIXES]

    with activity("computing the paths bent by b4 and c4") as tell:
        for family, dataset in shape_families().items():
            yield from draw_shapes(dataset, family, out)
        tell("flying the step responses")
        flown = fly_steps(PUBLISHED_STEPS, aircraft=_AIRCRAFT, variant=_VARIANT, **_STEP_POINT, inversion="model")
        tell("drawing the step responses")
        for flight in flown:
            draw_step(flight.dataset, files := paths(f"step-{flight.test.key}"))
            yield from files
        draw_overview([flight.dataset for flight in flown], files := paths("step-overview"))
        yield from files
        tell("flying the climb-and-turn")
        tracked = fly_climb_and_turn(_VARIANT)
        draw_tracking(tracked.dataset, "Climb and turn on velocity commands alone", files := paths("climb-and-turn"))
        yield from files
        tell("flying one and three aircraft")
        for name, flight in published_flights().items():
            tell(f"drawing the flight: {name}")
            yield from draw_flight(flight.dataset, name, out)
