"""Reading the folder that `anser run` wrote."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from anser.cli.console import RefusedError

if TYPE_CHECKING:
    import xarray as xr

FLIGHT, SUMMARY = RUN_FILES = ("flight.nc", "summary.json")
PLAN = "plan.npz"


def must_be_run(folder: Path, place: str = "RUN") -> None:
    """Refuse a folder that holds no run; `place` is the argument that names it."""
    if not folder.is_dir():
        raise RefusedError(f"{place}: arrived {folder}, which is no folder; expected one that `anser run` wrote")
    lacking = [name for name in RUN_FILES if not (folder / name).is_file()]
    if lacking:
        words = f"which holds no {' and no '.join(lacking)}; expected a folder that `anser run` wrote"
        raise RefusedError(f"{place}: arrived {folder}, {words}")


def read_run(folder: Path, place: str = "RUN") -> tuple["xr.Dataset", dict[str, Any]]:
    """Read a flight and its summary; refuse a folder that does not hold both."""
    must_be_run(folder, place)
    from anser.results import read_netcdf, read_summary

    read: list[Any] = []
    for name, reader in ((FLIGHT, read_netcdf), (SUMMARY, read_summary)):
        try:
            read.append(reader(folder / name))
        except (OSError, ValueError, KeyError) as error:
            words = f"arrived a file that cannot be read ({error}); expected what `anser run` wrote"
            raise RefusedError(f"{place}, {folder / name}: {words}") from None
    return read[0], read[1]


def read_flight(folder: Path, names: tuple[str, ...]) -> tuple["xr.Dataset", dict[str, Any]]:
    """As `read_run`; refuse a flight that lacks variables, and a summary of other aircraft."""
    dataset, summary = read_run(folder)
    missing = [name for name in ("aircraft", *names) if name not in dataset.variables]
    if missing:
        raise RefusedError(
            f"{folder / FLIGHT}: arrived without {', '.join(missing)}; expected a flight of this version of anser"
        )
    flown, summarized = dataset["aircraft"].values.tolist(), [row["name"] for row in summary.get("aircraft", ())]
    if flown != summarized:
        raise RefusedError(
            f"{folder}: arrived {FLIGHT} of {', '.join(flown)} with {SUMMARY} of {', '.join(map(str, summarized))}; "
            "expected both of the same flight"
        )
    return dataset, summary
