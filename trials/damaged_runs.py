"""Damaged files of every kind, read again.

``python -m trials.damaged_runs flight plan summary store rare --count 1000``

Each mutation of `trials.damaged_files` is drawn from its number. A flight, its summary and a plan must be refused by
one message that names the folder (exit code 2), or read as if nothing had happened. A campaign and a rare event must be
refused when they are read, and be the same to the last bit after a resume; where that is refused, too, the file that
nothing is known without is named. What is read otherwise, ends with another code, or leaves a traceback is a failure:
it is printed, and the exit code is 1. Flights of the campaigns are made up, for here it is their files that matter.
"""

import argparse
import contextlib
import faulthandler
import io
import shutil
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

import anser
from anser import cli
from anser.campaigns import StoreError, campaign, flights, rare, rare_flights, read_rare
from anser.campaigns.store import CampaignStore
from anser.missions import read_plan, write_plan
from anser.missions.first_plan import PlanFileError
from anser.missions.flight_batches import FlightCase
from anser.results.flight_rows import FlightRow
from anser.results.variable_labels import convert_series
from trials.damaged_files import MUTATIONS, OF_ONE_FILE, files_of

_ROOT = Path(__file__).parents[1]
_PATIENCE_S = 120.0
"""Time after which one mutation is taken to hang; the process then ends with the places where it was."""
_CHUNK = 4
_STUDY = """format = 1
name = "damaged"
scenario = "scenario.toml"
seed = 1

[[vary]]
path = "aircraft[0].start.north_m"
distribution = "normal"
mean = 0.0
sigma = 20.0
how = "add"
"""
_CAMPAIGN = """
[sampling]
flights = 12

[keep]
series = ["position_error", "speed_limited", "phase"]
series_every_s = 30.0
"""
_RARE = """
[rare]
statistic = "miss_m"
threshold = 8.0
flights = 300
repetitions = 3
"""


class Trial:
    """Files to damage, in a folder of their own, and how they are read."""

    def __init__(self, place: Path) -> None:
        self.place = place
        scenario = (_ROOT / "scenarios" / "single-aircraft.toml").read_text(encoding="utf-8")
        (place / "scenario.toml").write_text(scenario, encoding="utf-8")
        self.prepare()

    def prepare(self) -> None:
        """Make the whole files, once."""
        raise NotImplementedError

    def damage(self, number: int, draw: np.random.Generator) -> str:
        """Damage a fresh copy of the files; returns which mutation it was."""
        raise NotImplementedError

    def verdict(self, number: int) -> str:
        """What came of it: "refused", "read rightly", "repaired", or, of failures, a text with "FAILED" in front."""
        raise NotImplementedError

    def _mutated(self, number: int, draw: np.random.Generator, names: Sequence[str], files: Sequence[Path]) -> str:
        name = names[number % len(names)]
        changed = MUTATIONS[name](files, draw)
        return f"{name}: {', '.join(path.name for path in changed)}"


class _Run(Trial):
    """A run's folder of which one file is damaged, read by export, and now and then by report and figures."""

    file = ""
    names: Sequence[str] = ()

    def prepare(self) -> None:
        """Make the whole files."""
        self.whole, self.run = self.place / "whole", self.place / "run"
        scenario = anser.load(self.place / "scenario.toml")
        anser.run(scenario).save(self.whole)
        anser.run(scenario.replace("seed", 7, "wind.speed_m_s", 4.0)).save(self.place / "other")
        shutil.copytree(self.whole, self.run)
        code, said = self._export()
        if code:
            raise RuntimeError(said)
        self.expected = self._exported()

    def damage(self, number: int, draw: np.random.Generator) -> str:
        """Damage a fresh copy."""
        for name in ("flight.nc", "summary.json"):
            shutil.copy(self.whole / name, self.run / name)
        if number % 50 == 49:
            shutil.copy(self.place / "other" / self.file, self.run / self.file)
            return "file of another run"
        return self._mutated(number, draw, self.names, [self.run / self.file])

    def verdict(self, number: int) -> str:
        """Read it."""
        code, said = self._export()
        if code == 0:
            return "read rightly" if self._exported() == self.expected else "FAILED: another flight, without a word"
        found = _refusal(code, said, self.file, "run")
        if number % 25 == 0 and found == "refused":
            page = self.place / "page.html"
            others = (("report", self.run, "--out", page), ("figures", self.run, "--out", self.place / "figures"))
            found = max(_refusal(*_command(*words), self.file, "run") for words in others)
        return found

    def _export(self) -> tuple[int, str]:
        shutil.rmtree(self.place / "exported", ignore_errors=True)
        formats = ("--format", "csv,kml", "--period-s", "5")
        return _command("export", self.run, *formats, "--out", self.place / "exported")

    def _exported(self) -> dict[str, bytes]:
        return {path.name: path.read_bytes() for path in (self.place / "exported").iterdir()}


class FlightTrial(_Run):
    """`flight.nc`."""

    file, names = "flight.nc", OF_ONE_FILE


class SummaryTrial(_Run):
    """`summary.json`."""

    file, names = "summary.json", (*OF_ONE_FILE, *["edit JSON"] * len(OF_ONE_FILE))


class PlanTrial(Trial):
    """`plan.npz`."""

    def prepare(self) -> None:
        """Make the whole files."""
        self.scenario = anser.load(self.place / "scenario.toml")
        write_plan(anser.plan(self.scenario), self.place / "whole.npz")
        other = self.scenario.replace("wind.speed_m_s", 4.0)
        write_plan(anser.plan(other), self.place / "other.npz")

    def damage(self, number: int, draw: np.random.Generator) -> str:
        """Damage a fresh copy."""
        shutil.copy(self.place / "whole.npz", self.place / "plan.npz")
        if number % 50 == 49:
            shutil.copy(self.place / "other.npz", self.place / "plan.npz")
            return "plan of another scenario"
        return self._mutated(number, draw, OF_ONE_FILE, [self.place / "plan.npz"])

    def verdict(self, number: int) -> str:
        """Read it."""
        if number % 25 == 0:
            words = ("run", self.place / "scenario.toml", "--plan", self.place, "--out", self.place / "flown")
            return _refusal(*_command(*words), "plan.npz")
        try:
            read_plan(self.place, self.scenario)
        except PlanFileError as error:
            return "refused" if "plan.npz" in str(error) else f"FAILED: {error}"
        return "FAILED: read"


class StoreTrial(Trial):
    """The store of a campaign and its checksums."""

    def prepare(self) -> None:
        """Make the whole files."""
        flights.BATCH = _CHUNK
        flights.fly_many = _made_up
        self.study = self.place / "study.toml"
        self.study.write_text(_STUDY + _CAMPAIGN, encoding="utf-8")
        self.whole, self.out = self.place / "whole", self.place / "out"
        campaign(self.study, self.whole, processes=1)
        self.expected = self._contents(self.whole)

    def damage(self, number: int, draw: np.random.Generator) -> str:
        """Damage a fresh copy."""
        shutil.rmtree(self.out, ignore_errors=True)
        shutil.copytree(self.whole, self.out)
        return self._mutated(number, draw, tuple(MUTATIONS), files_of(self.out))

    def verdict(self, number: int) -> str:
        """Read it."""
        try:
            read = self._contents(self.out)
        except StoreError:
            pass
        else:
            return "read rightly" if self._same(read) else "FAILED: another campaign, without a word"
        if number % 10 == 0:
            found = _refusal(*_command("campaign", "report", self.out, "--worst", 0), "out")
            # series are not verified before the page is begun
            if found != "refused":
                return found
        try:
            campaign(self.study, self.out, resume=True, processes=1)
        except StoreError as error:
            return "refused" if "store.json: arrived" in str(error) else f"FAILED: {error}"
        return "repaired" if self._same(self._contents(self.out)) else "FAILED: resumed to something else"

    def _contents(self, folder: Path) -> tuple[xr.Dataset, xr.Dataset, dict[str, bytes]]:
        store = CampaignStore.open(folder)
        files = {str(path.relative_to(folder)): path.read_bytes() for path in files_of(folder)}
        return store.dataset(), store.series().load(), files

    def _same(self, read: tuple[xr.Dataset, xr.Dataset, dict[str, bytes]]) -> bool:
        data, series, files = self.expected
        return read[0].identical(data) and read[1].identical(series) and read[2] == files


class RareTrial(Trial):
    """The folder of a rare event."""

    def prepare(self) -> None:
        """Make the whole files."""
        rare_flights.fly_many = _made_up
        self.study = self.place / "study.toml"
        self.study.write_text(_STUDY + _RARE, encoding="utf-8")
        self.whole, self.out = self.place / "whole", self.place / "out"
        rare(self.study, self.whole, processes=1)
        self.expected = read_rare(self.whole).document

    def damage(self, number: int, draw: np.random.Generator) -> str:
        """Damage a fresh copy."""
        shutil.rmtree(self.out, ignore_errors=True)
        shutil.copytree(self.whole, self.out)
        files = [*sorted((self.out / "flown").iterdir()), self.out / "rare-asked.json"]
        return self._mutated(number, draw, tuple(MUTATIONS), files)

    def verdict(self, number: int) -> str:
        """Read it."""
        try:
            read = read_rare(self.out).document
        except StoreError:
            pass
        else:
            return "read rightly" if read == self.expected else "FAILED: another event, without a word"
        try:
            found = rare(self.study, self.out, resume=True, processes=1)
        except StoreError as error:
            return "refused" if "rare-asked.json" in str(error) else f"FAILED: {error}"
        return "repaired" if found.document == self.expected else "FAILED: resumed to something else"


TRIALS: dict[str, Callable[[Path], Trial]] = {
    "flight": FlightTrial,
    "plan": PlanTrial,
    "summary": SummaryTrial,
    "store": StoreTrial,
    "rare": RareTrial,
}
"""By kind of file."""


def tried(trial: Trial, numbers: Iterable[int]) -> tuple[Counter[str], list[str]]:
    """Try mutations by their numbers; how often each verdict came, and a line of each failure."""
    counts, failures = Counter[str](), list[str]()
    for number in numbers:
        faulthandler.dump_traceback_later(_PATIENCE_S, exit=True)
        mutation = trial.damage(number, np.random.default_rng(number))
        try:
            verdict = trial.verdict(number)
        except Exception as error:  # noqa: BLE001 - whatever comes out is what the trial is for
            verdict = f"FAILED: {type(error).__name__}: {error}"
        faulthandler.cancel_dump_traceback_later()
        counts[verdict.split(":")[0]] += 1
        if verdict.startswith("FAILED"):
            failures.append(f"{number}, {mutation}: {verdict}")
    return counts, failures


def _refusal(code: int, said: str, *names: str) -> str:
    """Verdict on a command that must refuse with one message that has one of the names."""
    lines = [line for line in said.splitlines() if line.strip()]
    good = code == 2 and len(lines) == 1 and any(name in lines[0] for name in names) and "Traceback" not in said
    return "refused" if good else f"FAILED: exit code {code}: {said[-600:]}"


def _command(*words: object) -> tuple[int, str]:
    """Exit code and standard error of a command, run in this process."""
    sys.argv, said = ["anser", *map(str, words)], io.StringIO()
    with contextlib.redirect_stderr(said), contextlib.redirect_stdout(io.StringIO()):
        try:
            cli.main()
        except SystemExit as end:
            return int(end.code or 0), said.getvalue()
    raise RuntimeError("the command did not end")


def _made_up(
    cases: Sequence[FlightCase], *_: Any, series: Any = None, precision: str = "float64", **__: Any
) -> list[FlightRow]:
    """Rows that follow from each scenario alone; one in ten cannot begin."""
    rows = []
    for case in cases:
        north = case.scenario.aircraft[0].start.north_m
        if abs(north) < 2.5:
            rows.append(FlightRow.failed_start("made up: could not begin"))
            continue
        aircraft = [{"name": "aircraft-1", "arrival_s": 60.0, "miss_m": abs(north) / 5.0, "status": "arrived"}]
        kept = {}
        if series is not None:
            times = series.times_s(case.scenario)
            kept = {key: convert_series(key, north + 0.01 * times[None, :]) for key in series.keys}
        met = abs(north) < 30.0
        rows.append(FlightRow(aircraft, {}, [{"name": "miss_max_m", "met": met}], met, series=kept))
    return rows


def main() -> int:
    """Try each kind that is named; 1 where one failed."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("kinds", nargs="+", choices=tuple(TRIALS))
    parser.add_argument("--count", type=int, default=1000, help="mutations of each kind")
    parser.add_argument("--first", type=int, default=0, help="number of the first")
    asked = parser.parse_args()
    failed = 0
    for kind in asked.groups:
        with tempfile.TemporaryDirectory() as place:
            began = time.perf_counter()
            counts, failures = tried(TRIALS[kind](Path(place)), range(asked.first, asked.first + asked.count))
        failed += len(failures)
        told = ", ".join(f"{count} {verdict}" for verdict, count in sorted(counts.items()))
        lines = [f"{kind}: {told}, in {time.perf_counter() - began:.0f} s", *failures]
        sys.stdout.write("\n".join(lines) + "\n")
        sys.stdout.flush()
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())
