"""Arguments that several commands share, and their completion in the shell."""

import itertools
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Annotated, Literal

import typer

from anser.aircraft_files.sources import AIRFRAMES, VARIANTS
from anser.config.shipped_files import shipped_files
from anser.files import read_file
from anser.missions.saved_flights import RUN_FILES

_ENTRIES_MAX = 500
"""Greatest number of folder entries that a completion examines, to stay fast."""
_DEPTH = 2
"""Number of folder levels that a completion searches."""


def complete_scenario(incomplete: str) -> list[str]:
    """Return the scenario files in the typed folder, or two levels below, that match the typed path."""
    return _matching_paths(incomplete, _is_scenario)


def complete_run(incomplete: str) -> list[str]:
    """Return the run folders in the typed folder, or two levels below, that match the typed path."""
    return _matching_paths(incomplete, lambda path: all((path / name).is_file() for name in RUN_FILES))


def complete_aircraft(incomplete: str) -> list[str]:
    """Return the names of aircraft, and the aircraft files in the typed folder or two levels below, that match."""
    names = [name for name in AIRFRAMES if name.startswith(incomplete)]
    return names + _matching_paths(incomplete, _is_airframe)


def complete_shipped(incomplete: str) -> list[str]:
    """Return the names of scenarios, studies and aircraft of anser that start with the typed text."""
    return [name for name in shipped_files() if name.startswith(incomplete)]


def complete_variant(context: typer.Context, incomplete: str) -> list[str]:
    """Return the names of table sets (variants) that start with the typed text.

    If the aircraft on the command line has variants, only variants of this aircraft are returned.
    """
    variants = VARIANTS.get(context.params.get("aircraft") or "")
    names = variants if variants is not None else dict.fromkeys(itertools.chain(*VARIANTS.values()))
    return [name for name in names if name.startswith(incomplete)]


def _is_airframe(path: Path) -> bool:
    return path.suffix == ".toml" and path.is_file() and b"[[surface]]" in read_file(path)


def _is_scenario(path: Path) -> bool:
    return path.suffix == ".toml" and path.is_file() and b"[[aircraft]]" in read_file(path)


def _matching_paths(incomplete: str, accepts: Callable[[Path], bool]) -> list[str]:
    """Return the paths that `accepts` selects and that start with the typed text, sorted."""
    typed_folder, _, name = incomplete.rpartition("/")
    folder = Path("/" if incomplete.startswith("/") and not typed_folder else typed_folder or ".")
    typed_prefix = incomplete[: len(incomplete) - len(name)]
    matches = []
    for path in itertools.islice(_below(folder, name, _DEPTH), _ENTRIES_MAX):
        try:
            if accepts(path):
                matches.append(typed_prefix + path.relative_to(folder).as_posix())
        except OSError:
            continue
    return sorted(matches)


def _below(folder: Path, prefix: str, depth: int) -> Iterator[Path]:
    """Yield the entries of a folder whose names start with `prefix`, and the contents of these entries, `depth` deep.

    Hidden entries are yielded only if they lie directly in `folder` and `prefix` starts with a dot.
    """
    try:
        entries = sorted(folder.iterdir())
    except OSError:
        return
    for entry in entries:
        if not entry.name.startswith(prefix) or (entry.name.startswith(".") and not prefix):
            continue
        yield entry
        if depth and entry.is_dir():
            yield from _below(entry, "", depth - 1)


ScenarioPath = Annotated[Path, typer.Argument(help="Scenario file (TOML).", autocompletion=complete_scenario)]
RunFolder = Annotated[
    Path, typer.Argument(help="Folder of a run: flight.nc, summary.json.", autocompletion=complete_run)
]
AircraftName = Annotated[
    str,
    typer.Option(
        help=f"Airframe: {', '.join(AIRFRAMES)}, the name of an entry point, or the path of an aircraft file.",
        autocompletion=complete_aircraft,
    ),
]
VariantName = Annotated[
    str,
    typer.Option(
        help="Published set of tables of the F-16: textbook, s119, founding, tp1538, or the smooth model global.",
        autocompletion=complete_variant,
    ),
]
CentreOfGravity = Annotated[
    float | None,
    typer.Option(
        "--cg", "--x-cg", help="Centre of gravity, fraction of the mean aerodynamic chord; left out: the variant's own."
    ),
]
TrueAirspeed = Annotated[float | None, typer.Option(help="True airspeed; or one of the three options below.")]
CalibratedAirspeed = Annotated[float | None, typer.Option(help="Calibrated airspeed.")]
EquivalentAirspeed = Annotated[float | None, typer.Option(help="Equivalent airspeed.")]
MachNumber = Annotated[float | None, typer.Option("--mach", help="Mach number.")]
Altitude = Annotated[float, typer.Option(help="Geometric altitude.")]
PathAngle = Annotated[float, typer.Option(help="Climb angle.")]
TurnRate = Annotated[float, typer.Option(help="Rate of the course, right positive.")]
Inversion = Annotated[
    Literal["model", "incremental"], typer.Option(help="What the autopilot inverts: the model, or measured changes.")
]
SurveyFolder = Annotated[Path, typer.Option("--out", help="New folder for the dataset and the figures.")]
