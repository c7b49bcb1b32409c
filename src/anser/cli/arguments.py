"""Arguments that several commands take, and what the shell offers for them."""

import itertools
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Annotated, Literal

import typer

from anser.aircraft_files.sources import AIRFRAMES, VARIANTS
from anser.files import read_file
from anser.missions.saved_flights import RUN_FILES

_ENTRIES_MAX = 500
"""Entries that a completion looks at: it must not take long in a large folder."""
_DEPTH = 2
"""Folders below the one named so far that a completion looks into."""


def complete_scenario(incomplete: str) -> list[str]:
    """Scenario files that begin so, in this folder and two below; nothing where there is none: the shell's own turn."""
    return _matching_paths(incomplete, _is_scenario)


def complete_run(incomplete: str) -> list[str]:
    """Folders of runs that begin so, in this folder and two below."""
    return _matching_paths(incomplete, lambda path: all((path / name).is_file() for name in RUN_FILES))


def complete_aircraft(incomplete: str) -> list[str]:
    """Airframes that begin so, and aircraft files in this folder and two below."""
    names = [name for name in AIRFRAMES if name.startswith(incomplete)]
    return names + _matching_paths(incomplete, _is_airframe)


def complete_variant(context: typer.Context, incomplete: str) -> list[str]:
    """Variants, that begin so, of the aircraft given before; of all aircraft where none is."""
    known = VARIANTS.get(context.params.get("aircraft") or "")
    names = known if known is not None else dict.fromkeys(itertools.chain(*VARIANTS.values()))
    return [name for name in names if name.startswith(incomplete)]


def _is_airframe(path: Path) -> bool:
    return path.suffix == ".toml" and path.is_file() and b"[[surface]]" in read_file(path)


def _is_scenario(path: Path) -> bool:
    return path.suffix == ".toml" and path.is_file() and b"[[aircraft]]" in read_file(path)


def _matching_paths(incomplete: str, wanted: Callable[[Path], bool]) -> list[str]:
    """Paths that begin with what was typed, written as it was typed."""
    typed_folder, _, name = incomplete.rpartition("/")
    folder = Path("/" if incomplete.startswith("/") and not typed_folder else typed_folder or ".")
    begun = incomplete[: len(incomplete) - len(name)]
    found = []
    for path in itertools.islice(_below(folder, name, _DEPTH), _ENTRIES_MAX):
        try:
            if wanted(path):
                found.append(begun + path.relative_to(folder).as_posix())
        except OSError:
            continue
    return sorted(found)


def _below(folder: Path, begun: str, deep: int) -> Iterator[Path]:
    """Entries of a folder that begin so, and below them; hidden ones only where asked for."""
    try:
        entries = sorted(folder.iterdir())
    except OSError:
        return
    for entry in entries:
        if not entry.name.startswith(begun) or (entry.name.startswith(".") and not begun):
            continue
        yield entry
        if deep and entry.is_dir():
            yield from _below(entry, "", deep - 1)


ScenarioPath = Annotated[
    Path, typer.Argument(help="Scenario file (TOML).", show_default=False, autocompletion=complete_scenario)
]
RunFolder = Annotated[
    Path,
    typer.Argument(help="Folder of a run: flight.nc, summary.json.", show_default=False, autocompletion=complete_run),
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
        help="Published set of tables of the F-16: textbook, s119, founding or tp1538.", autocompletion=complete_variant
    ),
]
CentreOfGravity = Annotated[
    float | None,
    typer.Option(
        "--cg", "--x-cg", help="Centre of gravity, fraction of the mean aerodynamic chord; left out: the variant's own."
    ),
]
TrueAirspeed = Annotated[float, typer.Option(help="True airspeed.", show_default=False)]
Altitude = Annotated[float, typer.Option(help="Geometric altitude.", show_default=False)]
PathAngle = Annotated[float, typer.Option(help="Climb angle.")]
TurnRate = Annotated[float, typer.Option(help="Rate of the course, right positive.")]
Inversion = Annotated[
    Literal["model", "incremental"], typer.Option(help="What the autopilot inverts: the model, or measured changes.")
]
SurveyFolder = Annotated[
    Path, typer.Option("--out", help="New folder for the dataset and the figures.", show_default=False)
]
