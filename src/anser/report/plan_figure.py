"""Figure of a plan: seen from above, and altitude, airspeed, bank and separation against time with their limits."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from anser.report.aircraft_pens import Pen, pens_of, shared_prefix
from anser.report.plan_map import draw_map, mark_step
from anser.report.plan_panels import draw_altitude, draw_over_time, draw_separation
from anser.report.print_style import LARGE, PRINT_STYLE, new_figure, save_drawings

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_STYLE = {**PRINT_STYLE, "svg.hashsalt": "anser-plan"}


def draw_plan(dataset: xr.Dataset, folder: Path) -> tuple[Path, ...]:
    """Draw a plan into `plan.svg` and `plan.png` of a folder.

    Parameters
    ----------
    dataset
        As `anser.results.plan_dataset` makes it.
    folder
        To write into; returns the paths of its new files.
    """
    return save_drawings({"plan": _plan}, dataset, _STYLE, folder)


def _plan(dataset: xr.Dataset) -> "Figure":
    pens = pens_of(dataset)
    _, figure = new_figure((13.0, 8.6))
    grid = figure.add_gridspec(4, 2, width_ratios=[1.25, 1.0])
    above = figure.add_subplot(grid[:, 0])
    panels = [figure.add_subplot(grid[row, 1]) for row in range(4)]
    draw_map(above, dataset, pens)
    draw_altitude(panels[0], dataset, pens)
    draw_over_time(panels[1], dataset, pens, "airspeed_m_s", ("airspeed_min_m_s", "airspeed_max_m_s"), both=False)
    draw_over_time(panels[2], dataset, pens, "bank_deg", ("bank_max_deg",), both=True)
    draw_separation(panels[3], dataset)
    end = dataset["time"].values[-1]
    for axes in panels:
        axes.set_xlim(dataset["time"].values[0], end)
        axes.tick_params(labelbottom=axes is panels[-1])
    panels[-1].set_xlabel("Time $t$ (s)")
    figure.align_ylabels(panels)
    figure.suptitle("\n".join(_heading(dataset, pens)), fontsize=LARGE)
    return figure


def _heading(dataset: xr.Dataset, pens: list[Pen]) -> list[str]:
    of = dataset.attrs
    arrivals = dataset["arrival_time_s"].values
    first, last = float(np.min(arrivals)), float(np.max(arrivals))
    common = last - first < 5e-3
    when = f"arrival at {last:.2f} s" if common else f"arrivals from {first:.2f} s to {last:.2f} s"
    fleet = "1 aircraft" if len(pens) == 1 else f"{len(pens)} aircraft"
    lines = [f'{of["title"]}: {fleet}, {when} (rule "{of["rule"]}"), {of["planner"]} planner']
    note = f"dots: every {mark_step(dataset):g} s; dashed: limits of the scenario"
    prefix = shared_prefix(dataset)
    if prefix:
        note += f'; names without "{prefix}"'
    lines.append(note)
    problems = of["problems"].split("\n") if of["problems"] else []
    if problems:
        more = f" (and {len(problems) - 1} more)" if len(problems) > 1 else ""
        lines.append(f"not flyable: {problems[0]}{more}")
    return lines
