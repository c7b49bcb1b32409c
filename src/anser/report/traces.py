"""From recorded variables to drawn lines: labels from their attributes, thinning, gaps where an angle wraps."""

import html
from dataclasses import dataclass

import numpy as np
import plotly.graph_objects as go
import xarray as xr

from anser.report.style import color_of

__all__ = ["Pen", "axis_title", "pens_of", "printed_unit", "spread_indices", "thin_indices", "time_trace", "with_gaps"]

_MOST_POINTS, _LEAST_POINTS, _POINTS_OF_A_FLEET = 2000, 200, 40_000

# How units are printed; all others are printed as they are stored.
_PRINTED_UNITS = {"m s-1": "m/s", "degree": "°", "degree s-1": "°/s", "percent": "%", "1": ""}


@dataclass(frozen=True)
class Pen:
    """How one aircraft is drawn.

    Attributes
    ----------
    index
        Place of the aircraft in the dataset.
    name
        Its name, escaped for HTML, which plotly reads in part.
    group
        Name of all its traces, by which the page shows and hides them.
    color
        Colour of all its traces.
    points
        Most points of one trace.
    """

    index: int
    name: str
    group: str
    color: str
    points: int


def pens_of(dataset: xr.Dataset) -> list[Pen]:
    """One pen for each aircraft; the more aircraft, the fewer points for each, so that the page stays light."""
    names = [str(name) for name in dataset["aircraft"].values]
    points = max(_LEAST_POINTS, min(_MOST_POINTS, _POINTS_OF_A_FLEET // len(names)))
    return [Pen(i, html.escape(name), f"aircraft-{i}", color_of(i), points) for i, name in enumerate(names)]


def axis_title(values: xr.DataArray) -> str:
    """Label of an axis from the attributes of a variable: words, symbol and unit."""
    base, _, subscript = html.escape(values.attrs["symbol"]).partition("_")
    symbol = f"<i>{base}</i>" + (f"<sub>{subscript}</sub>" if subscript else "")
    unit = printed_unit(values)
    return f"{html.escape(values.attrs['long_name'])} {symbol}" + (f" ({unit})" if unit else "")


def printed_unit(values: xr.DataArray) -> str:
    """Print the unit of a variable; empty where there is none."""
    unit = str(values.attrs["units"])
    return html.escape(_PRINTED_UNITS.get(unit, unit))


def time_trace(values: xr.DataArray, pen: Pen, *, dashed: bool = False) -> go.Scatter:
    """Line of one variable of one aircraft over time; dashed for commands and plans.

    Parameters
    ----------
    values
        Variable of shape (time, aircraft), with the attributes of a dataset of results.
    pen
        Which aircraft, and how it is drawn.
    dashed
        Whether it is a command rather than a response.
    """
    time, numbers = values["time"].values, values.values[:, pen.index].astype(np.float64)
    kept = thin_indices(numbers, pen.points)
    x, y = with_gaps(time[kept], numbers[kept], 180.0 if values.attrs["units"] == "degree" else np.inf)
    unit = printed_unit(values)
    label = html.escape(values.attrs["long_name"])
    return go.Scatter(
        x=x.astype(np.float32),
        y=y.astype(np.float32),
        mode="lines",
        line={"color": pen.color, "width": 1.3 if dashed else 1.8, "dash": "4px,3px" if dashed else "solid"},
        name=pen.name,
        legendgroup=pen.group,
        hovertemplate=f"{pen.name}: {label} %{{y:.5~g}} {unit}<extra></extra>",
    )


def thin_indices(values: np.ndarray, limit: int) -> np.ndarray:
    """Choose at most `limit` samples that keep the ends and every peak: the least and greatest of equal stretches.

    Parameters
    ----------
    values
        Samples, shape (time,).
    limit
        Most samples to keep, at least 4.
    """
    count = values.size
    if count <= limit:
        return np.arange(count)
    stretches = (limit - 2) // 2
    length = -(-count // stretches)
    padded = np.full(stretches * length, np.nan)
    padded[:count] = values
    rows = padded.reshape(stretches, length)
    start = np.arange(stretches) * length
    least = start + np.argmin(np.where(np.isfinite(rows), rows, np.inf), axis=1)
    greatest = start + np.argmax(np.where(np.isfinite(rows), rows, -np.inf), axis=1)
    kept = np.unique(np.concatenate([[0], least, greatest, [count - 1]]))
    return kept[kept < count]


def spread_indices(count: int, limit: int) -> np.ndarray:
    """Choose at most `limit` of `count` samples, evenly spread, both ends among them."""
    return np.arange(count) if count <= limit else np.unique(np.linspace(0, count - 1, limit).astype(int))


def with_gaps(x: np.ndarray, y: np.ndarray, jump: float) -> tuple[np.ndarray, np.ndarray]:
    """Put a gap wherever y jumps by more than `jump`, so that no line is drawn across a wrapped angle."""
    steps = np.abs(np.diff(y))
    at = np.flatnonzero(np.where(np.isfinite(steps), steps, 0.0) > jump) + 1
    return np.insert(x, at, x[at]), np.insert(y, at, np.nan)
