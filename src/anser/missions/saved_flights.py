"""Saved flights: dataset and summary of a flight, from a run in this process or from the folder of an earlier run."""

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
    """The folder contains no recorded flight, files that cannot be read, or files of different flights."""


@dataclass(frozen=True, repr=False)
class SavedFlight:
    """A recorded flight; the printed form lists the arrivals."""

    #: Samples at the scenario's record period; dimensions time and aircraft, every variable with unit, frame and name.
    dataset: "xr.Dataset"
    summary: dict[str, Any]  #: Content of `summary.json`.

    @property
    def met(self) -> bool:
        """Whether every aircraft that stayed in the fleet arrived, and every requirement of the scenario is met."""
        arrived = all(entry["status"] == "arrived" or "left_s" in entry for entry in self.summary["aircraft"])
        return arrived and all(entry["met"] for entry in self.summary["requirements"])

    def __repr__(self) -> str:
        from anser.results.summary_format import format_summary

        return format_summary(self.summary)

    def _repr_html_(self) -> str:
        from anser.results.summary_format import format_summary_html

        return format_summary_html(self.summary)

    @property
    def plot(self) -> "FlightPlots":
        """Figures of the flight: `flight.plot.tracks()`, `.profile()`, `.separation()` and more."""
        from anser.report.flight_figures import FlightPlots

        return FlightPlots(self.dataset)

    def show(self) -> Path:
        """Write the interactive report to a new temporary file, open the file in the browser, and return its path."""
        page = self.report(Path(tempfile.mkdtemp(prefix="anser-")) / "report.html")
        webbrowser.open(page.as_uri())
        return page

    def report(self, path: Path | str) -> Path:
        """Write the interactive HTML report to `path`; returns the path. Raises FileExistsError if the file exists."""
        from anser.report.flight_page import write_report

        write_report(self.dataset, self.summary, Path(path))
        return Path(path)


def load_flight(folder: str | os.PathLike[str]) -> SavedFlight:
    """Read a flight from a folder of `anser run` or `FlightResult.save`.

    Parameters
    ----------
    folder
        Folder with `flight.nc` and `summary.json`.

    Raises
    ------
    ValueError
        If the folder contains no run, a damaged file, or files of different flights; the message names file or folder.
    """
    path = Path(folder)
    check_run_folder(path)
    return SavedFlight(*_read(path))


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
        received = f"arrived files that cannot be read ({error}); expected what `anser run` wrote"
        raise RunFolderError(f"{folder}: {received}") from None
    flown, summarized = dataset["aircraft"].values.tolist(), [entry["name"] for entry in summary["aircraft"]]
    if flown != summarized:
        received = f"{FLIGHT} of {', '.join(flown)} with {SUMMARY} of {', '.join(summarized)}"
        raise RunFolderError(f"{folder}: arrived {received}; expected both of the same flight")
    hashes = dataset.attrs.get("scenario_hash"), summary["scenario"].get("hash")
    if None not in hashes and hashes[0] != hashes[1]:
        received = f"{FLIGHT} of scenario {hashes[0]} with {SUMMARY} of scenario {hashes[1]}"
        raise RunFolderError(f"{folder}: arrived {received}; expected both of the same flight")
    return dataset, summary


def check_run_folder(folder: Path) -> None:
    """Raise RunFolderError if `folder` is no folder, or lacks `flight.nc` or `summary.json`."""
    expected = "one that `anser run` wrote"
    if not folder.is_dir():
        if folder.name in RUN_FILES and folder.is_file():
            expected = f"its folder, {folder.parent}"
        raise RunFolderError(f"arrived {folder}, which is no folder; expected {expected}")
    lacking = [name for name in RUN_FILES if not (folder / name).is_file()]
    if lacking:
        missing = f"which holds no {' and no '.join(lacking)}; expected a folder that `anser run` wrote"
        raise RunFolderError(f"arrived {folder}, {missing}")
