"""Command about finished runs: report."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from anser.cli.arguments import RunFolder, complete_run
from anser.cli.console import RefusedError, answer, line
from anser.cli.offering import about

if TYPE_CHECKING:
    import xarray as xr

_FILES = ("flight.nc", "summary.json")


@about(
    "anser report runs/three-aircraft --force",
    "anser report runs/a runs/b --out beside.html",
)
def report(
    run: RunFolder,
    other: Annotated[
        Path | None,
        typer.Argument(
            help="Folder of a second run, to stand beside the first.", show_default=False, autocompletion=complete_run
        ),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="File to write; default RUN/report.html. Needed for two runs.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace the file where it exists.")] = False,
) -> None:
    """Write the report of a run anew, or of two runs side by side, as one page that works offline."""
    if other is not None and out is None:
        raise RefusedError("--out: arrived nothing; expected a file for the report of two runs, such as beside.html")
    target = out if out is not None else run / "report.html"
    folders = [folder for folder in (run, other) if folder is not None]
    for place, folder in zip(("RUN", "OTHER"), folders, strict=False):
        _must_be_run(place, folder)
    if out is None and target.exists() and not force:
        raise RefusedError(f"--out: arrived nothing, and {target} exists; give --force to write it anew, or --out FILE")
    _must_be_writable(target, force)
    from anser.report import write_comparison, write_report  # here: a misspelt folder must not wait for libraries

    runs = [(str(folder), *_read(place, folder)) for place, folder in zip(("RUN", "OTHER"), folders, strict=False)]
    try:
        if other is None:
            write_report(*runs[0][1:], target, overwrite=force)
        else:
            write_comparison(runs, target, overwrite=force)
    except ValueError as error:
        words = f"{error}; expected what one flight of `anser run` wrote"
        raise RefusedError(f"{' and '.join(map(str, folders))}: {words}") from None
    except OSError as error:
        words = f"expected a file that can be written ({error.strerror or error})"
        raise RefusedError(f"--out: arrived {target}; {words}") from None
    answer(lambda: {"format_version": 1, "file": str(target)})
    line(f"{target}: written")


def _must_be_run(place: str, folder: Path) -> None:
    lacking = [name for name in _FILES if not (folder / name).is_file()]
    if not folder.is_dir():
        raise RefusedError(f"{place}: arrived {folder}, which is no folder; expected one that `anser run` wrote")
    if lacking:
        words = f"which holds no {' and no '.join(lacking)}; expected a folder that `anser run` wrote"
        raise RefusedError(f"{place}: arrived {folder}, {words}")


def _must_be_writable(target: Path, force: bool) -> None:
    if target.is_dir():
        raise RefusedError(f"--out: arrived {target}, which is a folder; expected a file")
    if not target.parent.is_dir():
        raise RefusedError(f"--out: arrived {target}; expected a file in a folder that exists")
    if target.exists() and not force:
        raise RefusedError(f"--out: {target} exists; expected a new file, or --force to replace it")
    if target.name in _FILES:
        raise RefusedError(f"--out: arrived {target}, which holds a run; expected another file, such as report.html")


def _read(place: str, folder: Path) -> tuple["xr.Dataset", dict[str, Any]]:
    from anser.results import read_netcdf, read_summary

    read: dict[str, Any] = {}
    for name, reader in zip(_FILES, (read_netcdf, read_summary), strict=True):
        try:
            read[name] = reader(folder / name)
        except (OSError, ValueError, KeyError) as error:
            words = f"arrived a file that cannot be read ({error}); expected what `anser run` wrote"
            raise RefusedError(f"{place}, {folder / name}: {words}") from None
    return read["flight.nc"], read["summary.json"]
