"""Reading the folder that `anser run` wrote."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from anser.cli.console import RefusedError

if TYPE_CHECKING:
    import xarray as xr

FLIGHT, SUMMARY, PLAN = "flight.nc", "summary.json", "plan.npz"


def read_run(folder: Path) -> tuple["xr.Dataset", dict[str, Any]]:
    """Read a flight and its summary; refuse a folder that does not hold both, of the same aircraft."""
    missing = [name for name in (FLIGHT, SUMMARY) if not (folder / name).is_file()]
    if missing:
        found = "a folder without " + " and ".join(missing) if folder.is_dir() else "no folder"
        raise RefusedError(f"{folder}: arrived {found}; expected a folder that anser run wrote")
    from anser.results import read_netcdf

    try:
        dataset = read_netcdf(folder / FLIGHT)
        names = [str(name) for name in dataset["aircraft"].values]
    except (OSError, ValueError, KeyError) as error:
        raise RefusedError(
            f"{folder / FLIGHT}: arrived a file that cannot be read ({error}); expected a flight that anser run wrote"
        ) from None
    try:
        summary = json.loads((folder / SUMMARY).read_text(encoding="utf-8"))
        summarized = [row["name"] for row in summary["aircraft"]]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise RefusedError(
            f"{folder / SUMMARY}: arrived a file that cannot be read ({error}); expected a summary that anser run wrote"
        ) from None
    if names != summarized:
        raise RefusedError(
            f"{folder}: arrived {FLIGHT} of {', '.join(names)} with {SUMMARY} of {', '.join(map(str, summarized))}; "
            "expected both of the same flight"
        )
    return dataset, summary


def must_hold(dataset: "xr.Dataset", names: tuple[str, ...], folder: Path) -> None:
    """Refuse a flight that lacks variables."""
    missing = [name for name in names if name not in dataset.data_vars]
    if missing:
        raise RefusedError(
            f"{folder / FLIGHT}: arrived without {', '.join(missing)}; expected a flight of this version of anser"
        )
