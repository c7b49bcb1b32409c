"""Damaged files of every kind, read again.

``python -m trials.damaged_runs flight plan summary store rare --count 1000``

Each mutation of `trials.damaged_files` is drawn by its number. A damaged flight, summary or plan must be refused with
one message that names the folder (exit code 2), or read without any effect of the damage. A damaged campaign or rare
event must be refused on reading and be identical to the last bit after a resume; if the resume is refused too, the
message names the indispensable file. Any other result, exit code or traceback is a failure: it is printed, and the exit
code is 1. The campaigns contain synthetic flights, because only their files matter here.
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
"""Timeout of one mutation, s; the process then ends with a traceback of its threads."""
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
    """Files to damage, in a separate folder, and the procedure to read them."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        scenario = (_ROOT / "scenarios" / "single-aircraft.toml").read_text(encoding="utf-8")
        (folder / "scenario.toml").write_text(scenario, encoding="utf-8")
        self.prepare()

    def prepare(self) -> None:
        """Create the undamaged files, once."""
        raise NotImplementedError

    def damage(self, number: int, draw: np.random.Generator) -> str:
        """Damage a fresh copy of the files; return the name of the mutation."""
        raise NotImplementedError

    def verdict(self, number: int) -> str:
        """The result: "refused", "read rightly", "repaired", or, for failures, a text that begins with "FAILED"."""
        raise NotImplementedError

    def _mutated(self, number: int, draw: np.random.Generator, names: Sequence[str], files: Sequence[Path]) -> str:
        name = names[number % len(names)]
        changed = MUTATIONS[name](files, draw)
        return f"{name}: {', '.join(path.name for path in changed)}"


class _Run(Trial):
    """Folder of a run with one damaged file, read by export, and sometimes by report and figures."""

    file = ""
    names: Sequence[str] = ()

    def prepare(self) -> None:
        """Create the undamaged files."""
        self.whole, self.run = self.folder / "whole", self.folder / "run"
        scenario = anser.load(self.folder / "scenario.toml")
        anser.run(scenario).save(self.whole)
        anser.run(scenario.replace("seed", 7, "wind.speed_m_s", 4.0)).save(self.folder / "other")
        shutil.copytree(self.whole, self.run)
        code, messages = self._export()
        if code:
            raise RuntimeError(messages)
        self.expected = self._exported()

    def damage(self, number: int, draw: np.random.Generator) -> str:
        """Damage a fresh copy."""
        for name in ("flight.nc", "summary.json"):
            shutil.copy(self.whole / name, self.run / name)
        if number % 50 == 49:
            shutil.copy(self.folder / "other" / self.file, self.run / self.file)
            return "file of another run"
        return self._mutated(number, draw, self.names, [self.run / self.file])

    def verdict(self, number: int) -> str:
        """Export the run; sometimes also make its report and figures."""
        code, messages = self._export()
        if code == 0:
            return "read rightly" if self._exported() == self.expected else "FAILED: another flight, without a word"
        verdict = _refusal(code, messages, self.file, "run")
        if number % 25 == 0 and verdict == "refused":
            page = self.folder / "page.html"
            commands = (("report", self.run, "--out", page), ("figures", self.run, "--out", self.folder / "figures"))
            verdict = max(_refusal(*_command(*arguments), self.file, "run") for arguments in commands)
        return verdict

    def _export(self) -> tuple[int, str]:
        shutil.rmtree(self.folder / "exported", ignore_errors=True)
        formats = ("--format", "csv,kml", "--period-s", "5")
        return _command("export", self.run, *formats, "--out", self.folder / "exported")

    def _exported(self) -> dict[str, bytes]:
        return {path.name: path.read_bytes() for path in (self.folder / "exported").iterdir()}


class FlightTrial(_Run):
    """`flight.nc`."""

    file, names = "flight.nc", OF_ONE_FILE


class SummaryTrial(_Run):
    """`summary.json`."""

    file, names = "summary.json", (*OF_ONE_FILE, *["edit JSON"] * len(OF_ONE_FILE))


class PlanTrial(Trial):
    """`plan.npz`."""

    def prepare(self) -> None:
        """Create the undamaged files."""
        self.scenario = anser.load(self.folder / "scenario.toml")
        write_plan(anser.plan(self.scenario), self.folder / "whole.npz")
        other_scenario = self.scenario.replace("wind.speed_m_s", 4.0)
        write_plan(anser.plan(other_scenario), self.folder / "other.npz")

    def damage(self, number: int, draw: np.random.Generator) -> str:
        """Damage a fresh copy."""
        shutil.copy(self.folder / "whole.npz", self.folder / "plan.npz")
        if number % 50 == 49:
            shutil.copy(self.folder / "other.npz", self.folder / "plan.npz")
            return "plan of another scenario"
        return self._mutated(number, draw, OF_ONE_FILE, [self.folder / "plan.npz"])

    def verdict(self, number: int) -> str:
        """Read the plan; sometimes also fly it."""
        if number % 25 == 0:
            arguments = ("run", self.folder / "scenario.toml", "--plan", self.folder, "--out", self.folder / "flown")
            return _refusal(*_command(*arguments), "plan.npz")
        try:
            read_plan(self.folder, self.scenario)
        except PlanFileError as error:
            return "refused" if "plan.npz" in str(error) else f"FAILED: {error}"
        return "FAILED: read"


class StoreTrial(Trial):
    """The store of a campaign and its checksums."""

    def prepare(self) -> None:
        """Create the undamaged files."""
        flights.BATCH = _CHUNK
        flights.fly_many = _made_up
        self.study = self.folder / "study.toml"
        self.study.write_text(_STUDY + _CAMPAIGN, encoding="utf-8")
        self.whole, self.out = self.folder / "whole", self.folder / "out"
        campaign(self.study, self.whole, processes=1)
        self.expected = self._contents(self.whole)

    def damage(self, number: int, draw: np.random.Generator) -> str:
        """Damage a fresh copy."""
        shutil.rmtree(self.out, ignore_errors=True)
        shutil.copytree(self.whole, self.out)
        return self._mutated(number, draw, tuple(MUTATIONS), files_of(self.out))

    def verdict(self, number: int) -> str:
        """Read the campaign, then resume it."""
        try:
            contents = self._contents(self.out)
        except StoreError:
            pass
        else:
            return "read rightly" if self._same(contents) else "FAILED: another campaign, without a word"
        if number % 10 == 0:
            verdict = _refusal(*_command("campaign", "report", self.out, "--worst", 0), "out")
            # the series are not verified before the page is started
            if verdict != "refused":
                return verdict
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
        """Create the undamaged files."""
        rare_flights.fly_many = _made_up
        self.study = self.folder / "study.toml"
        self.study.write_text(_STUDY + _RARE, encoding="utf-8")
        self.whole, self.out = self.folder / "whole", self.folder / "out"
        rare(self.study, self.whole, processes=1)
        self.expected = read_rare(self.whole).document

    def damage(self, number: int, draw: np.random.Generator) -> str:
        """Damage a fresh copy."""
        shutil.rmtree(self.out, ignore_errors=True)
        shutil.copytree(self.whole, self.out)
        files = sorted(path for part in ("flown", "checksums") for path in (self.out / part).iterdir())
        return self._mutated(number, draw, tuple(MUTATIONS), files)

    def verdict(self, number: int) -> str:
        """Read the rare event, then resume it."""
        try:
            document = read_rare(self.out).document
        except StoreError:
            pass
        else:
            return "read rightly" if document == self.expected else "FAILED: another event, without a word"
        try:
            result = rare(self.study, self.out, resume=True, processes=1)
        except StoreError as error:
            return "refused" if "store.json: arrived" in str(error) else f"FAILED: {error}"
        return "repaired" if result.document == self.expected else "FAILED: resumed to something else"


TRIALS: dict[str, Callable[[Path], Trial]] = {
    "flight": FlightTrial,
    "plan": PlanTrial,
    "summary": SummaryTrial,
    "store": StoreTrial,
    "rare": RareTrial,
}
"""Trials by kind of file."""


def tried(trial: Trial, numbers: Iterable[int]) -> tuple[Counter[str], list[str]]:
    """Apply mutations by number; return the counts of the verdicts and a line for each failure."""
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


def _refusal(code: int, messages: str, *names: str) -> str:
    """Verdict on a command that must refuse with one message containing one of the names."""
    lines = [line for line in messages.splitlines() if line.strip()]
    refused = code == 2 and len(lines) == 1 and any(name in lines[0] for name in names) and "Traceback" not in messages
    return "refused" if refused else f"FAILED: exit code {code}: {messages[-600:]}"


def _command(*arguments: object) -> tuple[int, str]:
    """Exit code and standard error of a command, run in this process."""
    sys.argv, messages = ["anser", *map(str, arguments)], io.StringIO()
    with contextlib.redirect_stderr(messages), contextlib.redirect_stdout(io.StringIO()):
        try:
            cli.main()
        except SystemExit as end:
            return int(end.code or 0), messages.getvalue()
    raise RuntimeError("the command did not end")


def _made_up(
    cases: Sequence[FlightCase], *_: Any, series: Any = None, precision: str = "float64", **__: Any
) -> list[FlightRow]:
    """Synthetic rows determined by each scenario alone; one in ten cannot start."""
    flight_rows = []
    for case in cases:
        north = case.scenario.aircraft[0].start.north_m
        if abs(north) < 2.5:
            flight_rows.append(FlightRow.failed_start("made up: could not begin"))
            continue
        aircraft = [{"name": "aircraft-1", "arrival_s": 60.0, "miss_m": abs(north) / 5.0, "status": "arrived"}]
        recorded = {}
        if series is not None:
            times = series.times_s(case.scenario)
            recorded = {key: convert_series(key, north + 0.01 * times[None, :]) for key in series.keys}
        is_met = abs(north) < 30.0
        flight_rows.append(FlightRow(aircraft, {}, [{"name": "miss_max_m", "met": is_met}], is_met, series=recorded))
    return flight_rows


def main() -> int:
    """Try the named kinds of file; return 1 after a failure."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("kinds", nargs="+", choices=tuple(TRIALS))
    parser.add_argument("--count", type=int, default=1000, help="mutations of each kind")
    parser.add_argument("--first", type=int, default=0, help="number of the first")
    options = parser.parse_args()
    failed = 0
    for kind in options.kinds:
        with tempfile.TemporaryDirectory() as folder:
            start_time = time.perf_counter()
            counts, failures = tried(TRIALS[kind](Path(folder)), range(options.first, options.first + options.count))
        failed += len(failures)
        counts_text = ", ".join(f"{count} {verdict}" for verdict, count in sorted(counts.items()))
        lines = [f"{kind}: {counts_text}, in {time.perf_counter() - start_time:.0f} s", *failures]
        sys.stdout.write("\n".join(lines) + "\n")
        sys.stdout.flush()
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())
