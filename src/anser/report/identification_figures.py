"""Figures and report page of an identification: responses, residuals, and the correlation of the parameters."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from anser.files import write_file
from anser.report.page_templates import render_page, svg_markup
from anser.report.style import LARGE, SMALL, color_of, draw_for_print, new_figure, save_figure, series_style

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_SYMBOLS = {"alpha": r"$\alpha$ (rad)", "beta": r"$\beta$ (rad)", **{k: f"${k.upper()}$ (rad/s)" for k in "pqr"}}
_COLUMNS = 3


def response_figure(dataset: xr.Dataset, prefix: str = "") -> "Figure":
    """Return a figure of measured and modelled responses; prefix "validation_" selects the validation flight."""
    return draw_for_print(lambda data: _draw_responses(data, prefix), dataset)


def _draw_responses(dataset: xr.Dataset, prefix: str) -> "Figure":
    time, names = dataset[f"{prefix}time"].values, dataset[f"{prefix}response"].values
    figure, panels = _panels(len(names))
    for axes, name in zip(panels, names, strict=True):
        for index, variable in enumerate(("measured", "modelled")):
            values = dataset[f"{prefix}{variable}"].sel({f"{prefix}response": name})
            axes.plot(time, values, label=variable, **series_style(index), linewidth=1.6 - 0.6 * index)
        axes.set_ylabel(_SYMBOLS.get(str(name), str(name)))
        axes.set_xlabel("Time (s)")
    panels[0].legend(loc="best")
    figure.suptitle("Another manoeuvre, predicted" if prefix else "Responses", fontsize=LARGE)
    return figure


def _panels(count: int) -> tuple["Figure", list[Any]]:
    rows = -(-count // _COLUMNS)
    _, figure = new_figure((8.2, 2.2 * rows + 0.4))
    grid = np.ravel(figure.subplots(rows, min(count, _COLUMNS), squeeze=False))
    for axes in grid[count:]:
        axes.set_visible(False)
    return figure, list(grid[:count])


def residual_figure(dataset: xr.Dataset) -> "Figure":
    """Return a figure of the residuals over time, and of their autocorrelation with the 95 % bounds of white noise."""
    return draw_for_print(_draw_residuals, dataset)


def _draw_residuals(dataset: xr.Dataset) -> "Figure":
    names = dataset["response"].values
    bound = 1.96 / np.sqrt(dataset.sizes["time"])
    _, figure = new_figure((8.2, 1.5 * len(names) + 0.5))
    for axes, name in zip(figure.subplots(len(names), 2, squeeze=False), names, strict=True):
        chosen = dataset.sel(response=name)
        axes[0].plot(chosen["time"], chosen["measured"] - chosen["modelled"], color=color_of(0), linewidth=0.7)
        axes[0].set_ylabel(_SYMBOLS.get(str(name), str(name)))
        axes[1].axhspan(-bound, bound, color="#e1e4e8")
        axes[1].plot(chosen["lag"], chosen["autocorrelation"], color=color_of(0), linewidth=1.0)
    for axes, label in zip(figure.axes[-2:], ("Time (s)", "Lag (s)"), strict=True):
        axes.set_xlabel(label)
    title = "Residuals, and their autocorrelation (grey: 95 % of the lags if white)"
    figure.suptitle(title, fontsize=LARGE)
    figure.align_ylabels()
    return figure


def correlation_figure(dataset: xr.Dataset) -> "Figure":
    """Return a figure of the correlation matrix of the parameters' estimation errors, as a coloured map."""
    return draw_for_print(_draw_correlation, dataset)


def _draw_correlation(dataset: xr.Dataset) -> "Figure":
    names = [str(name) for name in dataset["parameter"].values]
    _, figure = new_figure((2.2 + 0.2 * len(names), 1.8 + 0.2 * len(names)))
    axes = figure.subplots()
    image = axes.imshow(dataset["correlation"].values, vmin=-1.0, vmax=1.0, cmap="RdBu_r")
    axes.set_xticks(range(len(names)), names, rotation=90, fontsize=SMALL)
    axes.set_yticks(range(len(names)), names, fontsize=SMALL)
    axes.grid(visible=False)
    figure.colorbar(image, label="Correlation of the errors", shrink=0.8)
    return figure


def write_identification_report(dataset: xr.Dataset, fits: Sequence[Mapping[str, Any]], folder: Path) -> None:
    """Write the figures (SVG, PNG) and the page `report.html` of an identification into an existing folder.

    `fits` has a table for each response: name, R^2 and Theil's inequality coefficient; if there is a validation flight,
    also R^2 and Theil's coefficient of the validation. Raises FileExistsError if one of the files exists.
    """
    figures = {"responses": response_figure(dataset)}
    if "validation_measured" in dataset:
        figures["validation"] = response_figure(dataset, "validation_")
    figures |= {"residuals": residual_figure(dataset), "correlation": correlation_figure(dataset)}
    for name, figure in figures.items():
        save_figure(figure, [folder / f"{name}{suffix}" for suffix in (".svg", ".png")])
    columns = ("estimate", "low", "high", "standard_error", "variance_inflation")
    rows = [
        {"name": str(name), "numbers": [f"{float(dataset[key].sel(parameter=name)):.4g}" for key in columns]}
        for name in dataset["parameter"].values
    ]
    measures = ("r_squared", "theil_inequality", "validation_r_squared", "validation_theil_inequality")
    fit_rows = [{"name": fit["response"], "numbers": [_shown(fit.get(key)) for key in measures]} for fit in fits]
    page = render_page(
        "identification.html",
        body_class="aircraft-flight",
        styles=["page.css"],
        scripts=[],
        data=("conditions", {"model": dataset.attrs["model"], "method": dataset.attrs["method"]}),
        title=str(dataset.attrs["title"]),
        figures=[svg_markup(figure) for figure in figures.values()],
        rows=rows,
        fits=fit_rows,
        notes=[note for note in str(dataset.attrs["notes"]).split("\n") if note],
        versions={key: value for key, value in dataset.attrs.items() if key.startswith("version")},
    )
    write_file(folder / "report.html", page)


def _shown(value: float | None) -> str:
    return "–" if value is None else f"{value:.4f}"
