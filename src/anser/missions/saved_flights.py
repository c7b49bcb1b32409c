"""A flight without what flew it: what was recorded and its summary, of this run or read back from its folder."""

import os
import tempfile
import webbrowser
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import xarray as xr

    from anser.report.flight_figures import FlightPlots


FLIGHT, SUMMARY = RUN_FILES = ("flight.nc", "summary.json")
PLAN = "plan.npz"


class RunFolderError(ValueError):
    """A folder that holds no run, or one that cannot be read."""


@dataclass(frozen=True, repr=False)
class SavedFlight:
    """A recorded flight; printed, it is who arrived when.

    Attributes
    ----------
    dataset
        Recorded at the scenario's record period; dimensions time and aircraft, every variable with unit, frame, name.
    summary
        The contract of `summary.json`.
    """

    dataset: "xr.Dataset"
    summary: dict[str, Any]

    @property
    def met(self) -> bool:
        """Whether every aircraft arrived that did not leave the fleet, and every requirement is met."""
        arrived = all(row["status"] == "arrived" or "left_s" in row for row in self.summary["aircraft"])
        return arrived and all(row["met"] for row in self.summary["requirements"])

    def __repr__(self) -> str:
        from anser.results.summary_format import format_summary

        return format_summary(self.summary)

    def _repr_html_(self) -> str:
        from anser.results.summary_format import format_summary_html

        return format_summary_html(self.summary)

    @property
    def plot(self) -> "FlightPlots":
        """Its figures: `flown.plot.tracks()`, `.profile()`, `.separation()` and others."""
        from anser.report.flight_figures import FlightPlots

        return FlightPlots(self.dataset)

    def show(self) -> Path:
        """Write the interactive report into a new temporary folder and open it in the browser; returns its path."""
        page = self.report(Path(tempfile.mkdtemp(prefix="anser-")) / "report.html")
        webbrowser.open(page.as_uri())
        return page

    def report(self, path: Path | str) -> Path:
        """Write the interactive HTML report; refuses to overwrite (FileExistsError)."""
        from anser.report.flight_page import write_report

        write_report(self.dataset, self.summary, Path(path))
        return Path(path)


def load_flight(folder: str | os.PathLike[str]) -> SavedFlight:
    """Read a flight back from the folder that `anser run` or `Flown.save` wrote.

    Parameters
    ----------
    folder
        With `flight.nc` and `summary.json`.

    Raises
    ------
    ValueError
        The folder holds no run, or one that cannot be read; the message says which of its files.
    """
    place = Path(folder)
    check_run_folder(place)
    return SavedFlight(*_read(place))


def _read(folder: Path) -> tuple["xr.Dataset", dict[str, Any]]:
    from anser.results.checksums import DamagedFileError
    from anser.results.netcdf import flight_problem, read_netcdf
    from anser.results.summary import read_summary

    try:
        dataset = read_netcdf(folder / FLIGHT)
        problem = flight_problem(dataset)
        if problem is not None:
            raise RunFolderError(f"{folder / FLIGHT}: {problem}")
        summary = read_summary(folder / SUMMARY)
    except DamagedFileError as error:
        raise RunFolderError(str(error)) from None
    except OSError as error:
        words = f"arrived files that cannot be read ({error}); expected what `anser run` wrote"
        raise RunFolderError(f"{folder}: {words}") from None
    flown, summarized = dataset["aircraft"].values.tolist(), [row["name"] for row in summary["aircraft"]]
    if flown != summarized:
        words = f"{FLIGHT} of {', '.join(flown)} with {SUMMARY} of {', '.join(summarized)}"
        raise RunFolderError(f"{folder}: arrived {words}; expected both of the same flight")
    hashes = dataset.attrs.get("scenario_hash"), summary["scenario"].get("hash")
    if None not in hashes and hashes[0] != hashes[1]:
        words = f"{FLIGHT} of scenario {hashes[0]} with {SUMMARY} of scenario {hashes[1]}"
        raise RunFolderError(f"{folder}: arrived {words}; expected both of the same flight")
    return dataset, summary


def check_run_folder(folder: Path) -> None:
    """Refuse a folder that holds no run (RunFolderError)."""
    wanted = "one that `anser run` wrote"
    if not folder.is_dir():
        if folder.name in RUN_FILES and folder.is_file():
            wanted = f"its folder, {folder.parent}"
        raise RunFolderError(f"arrived {folder}, which is no folder; expected {wanted}")
    lacking = [name for name in RUN_FILES if not (folder / name).is_file()]
    if lacking:
        words = f"which holds no {' and no '.join(lacking)}; expected a folder that `anser run` wrote"
        raise RunFolderError(f"arrived {folder}, {words}")
