"""Command sweep: a scenario flown with every combination of several values."""

import itertools
import math
import re
from decimal import Decimal, InvalidOperation
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer

from anser.cli.app import help_epilog
from anser.cli.arguments import ScenarioPath, SurveyFolder
from anser.cli.console import (
    InputError,
    columns,
    print_document,
    print_line,
    print_note,
    print_problem,
    print_table,
    progress_bar,
)
from anser.cli.folders import Force, open_output_folder
from anser.cli.overrides import parse_value, split_assignment
from anser.scenario.files import load

if TYPE_CHECKING:
    import xarray as xr


_RANGE = re.compile(r"[^:]+:[^:]+:[^:]+")
_VALUES_MAX = 10_000
_PRINTED_ROWS = 60
"""Greatest number of flights that are printed."""
_EXPECTED = "PATH=VALUES, such as wind.speed_m_s=0,5,10 or wind.speed_m_s=0:20:5 (first, last, step)"


@help_epilog(
    "anser sweep scenarios/three-aircraft.toml --set wind.speed_m_s=0:20:5 --out sweep",
    "anser sweep mine.toml --set fleet.speed_m_s=140,150,160 --set goal[0].course_deg=0:315:45 --out sweep",
    unmet="a flight does not meet a requirement, or cannot start",
)
def sweep(
    scenario: ScenarioPath,
    out: SurveyFolder,
    set_: Annotated[
        list[str],
        typer.Option(
            "--set",
            help="What is swept: PATH=VALUES, the values with commas or as FIRST:LAST:STEP; several of these make "
            "every combination.",
        ),
    ],
    force: Force = False,
) -> None:
    """Fly a scenario with every combination of several values of its keys."""
    base, sweep_values = load(scenario), parse_sweep_values(set_)
    with open_output_folder(out, force) as into, progress_bar() as tell:
        from anser.missions.sweeps import sweep as fly
        from anser.report.campaign_figures import draw_sweep
        from anser.results.netcdf import write_netcdf

        data = fly(base, sweep_values, tell)
        tell("writing", None)
        write_netcdf(data, into / "sweep.nc")
        figures = draw_sweep(data, into)
    print_document(lambda: _document(data, sweep_values))
    _print_sweep(data, sweep_values)
    print_note(f"{out}: sweep.nc{' and figure' if figures else ''} written")
    failed = int((~data["met"]).sum())
    if failed:
        print_problem(f"{failed} of {data['met'].size} flights did not meet every requirement, or could not begin")
        raise typer.Exit(1)


def parse_sweep_values(texts: list[str]) -> dict[str, list[object]]:
    """Return the values of options --set (PATH=VALUES) by key path.

    VALUES are separated by commas, or are FIRST:LAST:STEP; LAST is included if a whole number of steps leads to LAST.
    Raises InputError if an option is malformed, a path is repeated, or there are more than 10 000 combinations.
    """
    sweep_values: dict[str, list[object]] = {}
    for text in texts:
        path, values = split_assignment(text, _EXPECTED)
        if path in sweep_values:
            raise InputError(f"--set: arrived {path} twice; expected all of its values in one")
        sweep_values[path] = (
            _range(text, values) if _RANGE.fullmatch(values) else [parse_value(value) for value in values.split(",")]
        )
        compared = [(isinstance(value, bool), value) for value in sweep_values[path]]  # true is not 1
        if any(value in compared[:k] for k, value in enumerate(compared)):
            raise InputError(f"--set: arrived {text!r} with a value twice; expected each value once")
    count = math.prod(len(values) for values in sweep_values.values())
    if count > _VALUES_MAX:
        raise InputError(f"--set: arrived {count} combinations; expected {_VALUES_MAX} at most")
    return sweep_values


def _range(text: str, values: str) -> list[object]:
    try:
        start, stop, step = (Decimal(part.strip()) for part in values.split(":"))
    except InvalidOperation:
        raise InputError(f"--set: arrived {text!r}; expected three numbers, FIRST:LAST:STEP") from None
    numbers = start, stop, step
    if not all(bound.is_finite() for bound in numbers) or step == 0 or (stop - start) * step < 0:
        raise InputError(f"--set: arrived {text!r}; expected a step that leads from the first to the last")
    count = int((stop - start) / step) + 1
    if count > _VALUES_MAX:
        raise InputError(f"--set: arrived {text!r}, {count} values; expected {_VALUES_MAX} at most")
    # decimal arithmetic: 3 x 0.1 is 0.3
    return [parse_value(str(start + k * step)) for k in range(count)]


def _flights(data: "xr.Dataset", sweep_values: dict[str, list[object]]) -> list[dict[str, Any]]:
    """Return for each flight the swept values by key path, and results by name; the last key path varies fastest.

    A result of several aircraft is the greatest of their values; None if a value is missing.
    """

    def number_at(name: str, index: tuple[int, ...]) -> float | None:
        values = data[name].values[index] if name in data else np.array(np.nan)
        return None if np.isnan(values).any() else float(np.max(values))

    flights = []
    for index in itertools.product(*(range(len(values)) for values in sweep_values.values())):
        overrides = {path: values[k] for (path, values), k in zip(sweep_values.items(), index, strict=True)}
        keys = {"arrival_last_s": "arrival_s", "arrival_spread_s": "arrival_spread_s", "miss_max_m": "miss_m"}
        numbers = {key: number_at(name, index) for key, name in keys.items()}
        texts = {key: str(data[key].values[index]) for key in ("unmet", "reason")}
        flights.append({**overrides, **numbers, "met": bool(data["met"].values[index]), **texts})
    return flights


def _document(data: "xr.Dataset", sweep_values: dict[str, list[object]]) -> dict[str, Any]:
    from anser.results.documents import plain_attributes

    attributes = {
        key: value
        for key, value in plain_attributes(data.attrs).items()
        if key not in ("scenario", "scenario_written", "swept")
    }
    return {"format_version": 1, "sweep": attributes, "swept": sweep_values, "flights": _flights(data, sweep_values)}


def _print_sweep(data: "xr.Dataset", sweep_values: dict[str, list[object]]) -> None:
    headings = [
        *columns(*sweep_values, justify="right"),
        *columns("last arrival s", justify="right", digits=2),
        *columns("spread s", justify="right", digits=3),
        *columns("greatest miss m", justify="right", digits=2),
        *columns("what failed", overflow="fold"),
    ]
    rows = []
    flights = _flights(data, sweep_values)
    for flight in flights[:_PRINTED_ROWS]:
        values = [flight[path] for path in sweep_values]
        value_cells = [f"{value:g}" if isinstance(value, float) else str(value) for value in values]
        results = [flight[key] for key in ("arrival_last_s", "arrival_spread_s", "miss_max_m")]
        failure = flight["reason"] or flight["unmet"] or ("" if flight["met"] else "not all arrived")
        rows.append([*value_cells, *results, failure])
    print_table(f"sweep of {data.attrs['title']}", headings, rows)
    if len(flights) > _PRINTED_ROWS:
        print_line(f"{len(flights) - _PRINTED_ROWS} more flights are in sweep.nc")
