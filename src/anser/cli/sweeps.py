"""Command sweep: a scenario flown with every combination of some of its numbers."""

import itertools
import re
from decimal import Decimal, InvalidOperation
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer

from anser.cli.app import help_epilog
from anser.cli.arguments import ScenarioPath, SurveyFolder
from anser.cli.console import (
    RefusedError,
    columns,
    number,
    plain_table,
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
"""Flights that are printed at most."""
_EXPECTED = "PATH=VALUES, such as wind.speed_m_s=0,5,10 or wind.speed_m_s=0:20:5 (first, last, step)"


@help_epilog(
    "anser sweep scenarios/three-aircraft.toml --set wind.speed_m_s=0:20:5 --out sweep",
    "anser sweep mine.toml --set fleet.speed_m_s=140,150,160 --set goal[0].course_deg=0:315:45 --out sweep",
    unmet="a requirement was not met in a flight, or one could not begin",
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
            show_default=False,
        ),
    ],
    force: Force = False,
) -> None:
    """Fly a scenario with every combination of some of its numbers."""
    wanted, swept = load(scenario), parse_sweep_values(set_)
    with open_output_folder(out, force) as into, progress_bar() as tell:
        from anser.missions.sweeps import sweep as fly
        from anser.report.campaign_figures import draw_sweep
        from anser.results.netcdf import write_netcdf

        data = fly(wanted, swept, tell)
        tell("writing", None)
        write_netcdf(data, into / "sweep.nc")
        drawn = draw_sweep(data, into)
    print_document(lambda: _document(data, swept))
    _print_sweep(data, swept)
    print_note(f"{out}: sweep.nc{' and figure' if drawn else ''} written")
    failed = int((~data["met"]).sum())
    if failed:
        print_problem(f"{failed} of {data['met'].size} flights did not meet every requirement, or could not begin")
        raise typer.Exit(1)


def parse_sweep_values(texts: list[str]) -> dict[str, list[object]]:
    """By path, the values of options --set."""
    found: dict[str, list[object]] = {}
    for text in texts:
        path, values = split_assignment(text, _EXPECTED)
        if path in found:
            raise RefusedError(f"--set: arrived {path} twice; expected all of its values in one")
        found[path] = (
            _range(text, values) if _RANGE.fullmatch(values) else [parse_value(one) for one in values.split(",")]
        )
    return found


def _range(text: str, values: str) -> list[object]:
    try:
        first, last, step = (Decimal(part.strip()) for part in values.split(":"))
    except InvalidOperation:
        raise RefusedError(f"--set: arrived {text!r}; expected three numbers, FIRST:LAST:STEP") from None
    numbers = first, last, step
    if not all(one.is_finite() for one in numbers) or step == 0 or (last - first) * step < 0:
        raise RefusedError(f"--set: arrived {text!r}; expected a step that leads from the first to the last")
    count = int((last - first) / step) + 1
    if count > _VALUES_MAX:
        raise RefusedError(f"--set: arrived {text!r}, {count} values; expected {_VALUES_MAX} at most")
    # in decimals: 0.1 three times is 0.3
    return [parse_value(str(first + k * step)) for k in range(count)]


def _flights(data: "xr.Dataset", swept: dict[str, list[object]]) -> list[dict[str, Any]]:
    """Numbers of each flight, the last path's values fastest."""

    def of(name: str, at: tuple[int, ...]) -> float | None:
        values = data[name].values[at] if name in data else np.array(np.nan)
        return None if np.isnan(values).any() else float(np.max(values))

    rows = []
    for at in itertools.product(*(range(len(values)) for values in swept.values())):
        given = {path: values[k] for (path, values), k in zip(swept.items(), at, strict=True)}
        keys = {"arrival_last_s": "arrival_s", "arrival_spread_s": "arrival_spread_s", "miss_max_m": "miss_m"}
        found = {key: of(name, at) for key, name in keys.items()}
        words = {key: str(data[key].values[at]) for key in ("unmet", "reason")}
        rows.append({**given, **found, "met": bool(data["met"].values[at]), **words})
    return rows


def _document(data: "xr.Dataset", swept: dict[str, list[object]]) -> dict[str, Any]:
    from anser.results.documents import plain_attributes

    about_all = {key: value for key, value in plain_attributes(data.attrs).items() if key not in ("scenario", "swept")}
    return {"format_version": 1, "sweep": about_all, "swept": swept, "flights": _flights(data, swept)}


def _print_sweep(data: "xr.Dataset", swept: dict[str, list[object]]) -> None:
    table = plain_table(
        f"sweep of {data.attrs['title']}",
        *columns(*swept, justify="right"),
        *columns("last arrival s", "spread s", "greatest miss m", justify="right"),
        *columns("what failed", overflow="fold"),
    )
    rows = _flights(data, swept)
    for row in rows[:_PRINTED_ROWS]:
        given = [f"{row[path]:g}" if isinstance(row[path], float) else str(row[path]) for path in swept]
        numbers = [
            number(row["arrival_last_s"], 2),
            number(row["arrival_spread_s"], 3),
            number(row["miss_max_m"], 2),
        ]
        table.add_row(*given, *numbers, row["reason"] or row["unmet"] or ("" if row["met"] else "not all arrived"))
    print_table(table)
    if len(rows) > _PRINTED_ROWS:
        print_line(f"{len(rows) - _PRINTED_ROWS} more flights are in sweep.nc")
