"""Figures and report page of a flight of one aircraft, and the figure of its specific excess power."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from anser.files import write_file
from anser.report.adaptation_figures import draw_band, draw_fault, estimate_label, set_visible_range
from anser.report.estimates import EFFECTIVENESS, recorded_changes, recorded_estimates, true_effectiveness
from anser.report.labels import display_unit, math_symbol
from anser.report.page_templates import format_number, render_page, svg_markup
from anser.report.style import LARGE, PRINT_STYLE, color_of, draw_for_print, new_figure, series_style
from anser.results.dataset import surface_names, value_range
from anser.results.faults import dataset_fault, format_fault

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_PANELS: tuple[tuple[str, ...], ...] = (
    ("airspeed_m_s",),
    ("altitude_m",),
    ("alpha_deg", "beta_deg"),
    ("roll_deg", "pitch_deg", "yaw_deg"),
    ("roll_rate_deg_s", "pitch_rate_deg_s", "yaw_rate_deg_s"),
    ("load_factor",),
)
_ESTIMATES = (*((name,) for name in EFFECTIVENESS), ("cz_alpha",), ("cm_alpha",), ("cl_beta", "cn_beta"))
_COLUMNS = 3
_RANGE_MIN = {"m s-1": 1.0, "m": 10.0, "degree": 0.2, "degree s-1": 0.2, "1": 0.02, "percent": 2.0}
"""Least range of a panel's axis by unit, so that a constant variable looks constant."""
_TITLE_MAX = 110


def aircraft_flight_figure(dataset: xr.Dataset) -> "Figure":
    """Return the figure of one aircraft's flight: motion, surfaces, engine, and the estimates of an adaptive autopilot.

    Each estimate has a band of two standard deviations. True control effectiveness is dashed. A dotted line marks the
    time at which the autopilot detected a fault.
    """
    return draw_for_print(_draw_flight, dataset)


def _draw_flight(dataset: xr.Dataset) -> "Figure":
    surfaces = tuple(f"{name}_deg" for name in surface_names(dataset))
    panels = (*_PANELS, surfaces, ("throttle",), ("power_percent",))
    recorded = recorded_estimates(dataset)
    estimates = [names for names in _ESTIMATES if set(names) <= set(recorded)]
    rows = -(-(len(panels) + len(estimates)) // _COLUMNS)
    _, figure = new_figure((8.2, 0.5 + 2.3 * rows))
    grid = figure.subplots(rows, _COLUMNS, sharex=True)
    drawn = grid.flat[: len(panels) + len(estimates)]
    for axes, names in zip(drawn, panels, strict=False):
        _draw_panel(axes, dataset, names)
    for axes, names in zip(drawn[len(panels) :], estimates, strict=True):
        _draw_estimates(axes, dataset, names)
    for axes in grid.flat[drawn.size :]:
        axes.remove()
    for axes in drawn[-_COLUMNS:]:
        axes.set_xlabel("Time $t$ (s)")
        axes.tick_params(labelbottom=True)
    figure.suptitle(_title(dataset), fontsize=LARGE)
    figure.align_ylabels()
    return figure


def _draw_panel(axes: Any, dataset: xr.Dataset, names: Sequence[str]) -> None:
    drawn = []
    for index, name in enumerate(names):
        values = dataset[name]
        numbers = np.degrees(np.unwrap(np.radians(values.values))) if values.units == "degree" else values.values
        axes.plot(dataset["time"].values, numbers, **series_style(index), label=math_symbol(values))
        drawn.append(numbers)
    first, unit = dataset[names[0]], display_unit(dataset[names[0]])
    label = str(first.attrs["long_name"]) if len(names) == 1 else ", ".join(math_symbol(dataset[n]) for n in names)
    axes.set_ylabel(f"{label} ({unit})" if unit else label)
    if len(names) > 1:
        axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=len(names), borderaxespad=0.2)
    lowest, highest = float(np.min(drawn)), float(np.max(drawn))
    shortage = _RANGE_MIN.get(first.attrs["units"], 0.0) - (highest - lowest)
    if shortage > 0.0:
        axes.set_ylim(lowest - 0.6 * shortage, highest + 0.6 * shortage)


def _draw_estimates(axes: Any, dataset: xr.Dataset, names: Sequence[str]) -> None:
    time = dataset["time"].values
    lines: list[np.ndarray] = []
    bands: list[np.ndarray] = []
    for index, name in enumerate(names):
        estimate, sigma = (dataset[f"{name}_{kind}"].values for kind in ("estimate", "sigma"))
        truth = true_effectiveness(time, name, recorded_changes(dataset)) if name in EFFECTIVENESS else None
        draw_band(axes, time, estimate, sigma, color_of(index), truth)
        axes.plot(time, estimate, **series_style(index))
        lines += [estimate] if truth is None else [estimate, truth]
        bands += [estimate - 2.0 * sigma, estimate + 2.0 * sigma]
    draw_fault(axes, time, dataset["fault"].values)
    set_visible_range(axes, lines, bands)
    axes.set_ylabel(", ".join(estimate_label(dataset, name) for name in names))


def _title(dataset: xr.Dataset) -> str:
    attributes = dataset.attrs
    texts = [attributes["controls"] or f"controller {attributes['controller']}", attributes["command"]]
    text = "; ".join(filter(None, texts))
    text = text if len(text) <= _TITLE_MAX else text[: _TITLE_MAX - 1] + "…"
    return f"{attributes['aircraft']}: {text}"


def write_aircraft_report(
    dataset: xr.Dataset, path: Path, figure: "Figure | None" = None, *, overwrite: bool = False
) -> None:
    """Write the HTML page of one aircraft's flight; if `figure` is None, the figure is drawn from `dataset`.

    Raises FileExistsError if `path` exists and `overwrite` is False.
    """
    rows = [
        {
            "label": str(values.attrs["long_name"]),
            "unit": display_unit(values),
            "numbers": [format_number(number, 3) for number in value_range(values)],
        }
        for values in dataset.data_vars.values()
        if values.dims == ("time",) and values.dtype.kind == "f" and np.all(np.isfinite(values.values))
    ]
    keys = (
        *("controls", "controller", "command", "excitation", "change", "air"),
        *("step_s", "actuator_lag", "engine_lag", "end"),
    )
    labels = {"step_s": "step (s)", "actuator_lag": "actuator lag", "engine_lag": "engine lag"}
    conditions = {key: dataset.attrs[key] for key in keys if key in dataset.attrs}
    fault = dataset_fault(dataset)
    if fault is not None:
        conditions["fault found"] = format_fault(fault.as_dict())
    versions = {key.removeprefix("version_"): dataset.attrs[key] for key in dataset.attrs if key.startswith("version_")}
    page = render_page(
        "aircraft_flight.html",
        body_class="aircraft-flight",
        styles=["page.css"],
        scripts=[],
        data=("conditions", {key: str(value) for key, value in conditions.items()}),
        title=_title(dataset),
        figure=svg_markup(figure or aircraft_flight_figure(dataset)),
        rows=rows,
        conditions={labels.get(key, key): str(value) for key, value in conditions.items() if value != ""},
        versions=versions,
    )
    write_file(path, page, overwrite=overwrite)


def excess_power_figure(dataset: xr.Dataset, title: str) -> "Figure":
    """Return a figure of specific excess power (m/s) at full power: contours over Mach number and altitude (m)."""
    mpl, figure = new_figure((6.4, 4.6))
    with mpl.rc_context(PRINT_STYLE):
        axes = figure.subplots()
        mach, excess = dataset["mach"].values, np.ma.masked_invalid(dataset["specific_excess_power_m_s"].values)
        altitude = np.broadcast_to(dataset["altitude"].values[:, None], excess.shape)
        if excess.count():
            filled = axes.contourf(mach, altitude, excess, levels=16, cmap="cividis")
            figure.colorbar(filled, label="Specific excess power (m/s)")
            if excess.min() < 0.0 < excess.max():
                axes.contour(mach, altitude, excess, levels=[0.0], colors="white", linewidths=1.6)
                axes.plot([], [], color="white", label="0: level flight at full power")
                axes.legend(loc="best", facecolor="#8a8a8a")
            shown = ~np.ma.getmaskarray(excess)
            axes.set_xlim(mach[shown].min(), mach[shown].max())
            axes.set_ylim(altitude[shown].min(), altitude[shown].max())
        axes.set_xlabel("Mach number")
        axes.set_ylabel("Altitude (m)")
        axes.set_title(title, fontsize=LARGE)
    return figure
