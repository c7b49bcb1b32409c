"""Common layout of a flight's figures: width, title, legend, and the line styles that distinguish the aircraft."""

import functools
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from anser.report.derived_variables import HOLD, recorded_table
from anser.report.labels import NAMES_MAX, escape_mathtext, minimum_panel_height
from anser.report.style import (
    DASHED,
    INK,
    LARGE,
    MUTED,
    SMALL,
    LineStyle,
    aircraft_line_styles,
    marker_style,
    new_figure,
    shared_prefix,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


_MM_PER_INCH = 25.4
_WIDTHS_MM = (60.0, 400.0)
_LETTER_WIDTH = 0.58  # mean width of a letter relative to the font size, rounded up
_LABEL_SPACE = 0.75  # width of the labels left of the axes, inches
_MARKERS_PER_LINE = 8
_FEW_AIRCRAFT_MAX = 7  # with more aircraft, lines have names instead of markers and a legend
_PANEL_HEIGHT_MAX, _PANEL_HEIGHT_MIN = 1.7, 1.2  # in a wide and in a narrow figure, inches
_TIME_AXIS_HEIGHT, _PANEL_GAP = 0.45, 0.1  # inches
_LINE_HEIGHT = 1.35 / 72.0  # height of a line of text relative to the font size, inches


@dataclass(frozen=True)
class FigureFormat:
    """Format of a figure: width in mm, and whether the figure has a title.

    Raises ValueError if the width is not a number from 60 to 400. A column of a journal is 85 to 90 mm wide, two
    columns 170 to 180 mm.
    """

    width_mm: float = 6.5 * _MM_PER_INCH
    title: bool = True

    def __post_init__(self) -> None:
        low, high = _WIDTHS_MM
        if not isinstance(self.width_mm, int | float):
            raise ValueError(f"arrived {self.width_mm!r}; expected a number of mm, such as 88")
        if not low <= self.width_mm <= high:
            raise ValueError(
                f"arrived {self.width_mm:g}; expected {low:g} to {high:g} mm: one column of a paper is about 88 wide, "
                "two are about 180"
            )

    @property
    def width(self) -> float:
        """Width of the figure, inches."""
        return self.width_mm / _MM_PER_INCH

    @property
    def is_narrow(self) -> bool:
        """Whether the figure is too narrow (below 130 mm) for two panels side by side."""
        return self.width_mm < 130.0


class FlightSheet:
    """A flight and the common format of its figures: size, line styles of the aircraft, legend and title."""

    def __init__(self, dataset: xr.Dataset, figure_format: FigureFormat | None = None) -> None:
        self.dataset, self.figure_format = dataset, figure_format or FigureFormat()

    @property
    def count(self) -> int:
        """Number of aircraft in the flight."""
        return self.dataset.sizes["aircraft"]

    @property
    def has_few_aircraft(self) -> bool:
        """Whether the fleet is small enough (up to 7 aircraft) for markers on the lines and a legend."""
        return self.count <= _FEW_AIRCRAFT_MAX

    @property
    def has_line_names(self) -> bool:
        """Whether the aircraft's names stand at the line ends, as in a fleet of 8 to 40 aircraft."""
        return not self.has_few_aircraft and self.count <= NAMES_MAX

    @functools.cached_property
    def scenario(self) -> dict[str, Any]:
        """Scenario of the flight as plain data; empty if the dataset has no scenario."""
        return recorded_table(self.dataset)

    @functools.cached_property
    def line_styles(self) -> list[LineStyle]:
        """Line styles, one for each aircraft with a finite initial position."""
        return aircraft_line_styles(self.dataset)

    @functools.cached_property
    def time(self) -> np.ndarray:
        """Times of the record, s."""
        return self.dataset["time"].values

    @functools.cached_property
    def arrival_index(self) -> np.ndarray:
        """Index of the last sample before the holding pattern, shape (aircraft,); the last sample if there is none."""
        is_holding = self.dataset["phase"].values >= HOLD
        return np.where(is_holding.any(axis=0), np.maximum(is_holding.argmax(axis=0), 1), is_holding.shape[0]) - 1

    def until_arrival(self, name: str, line_style: LineStyle) -> np.ndarray:
        """Return the dataset variable `name` of one aircraft up to its arrival, shape (samples,)."""
        end = int(self.arrival_index[line_style.index]) + 1
        return self.dataset[name].values[:end, line_style.index].astype(np.float64)

    def goal_name(self, line_style: LineStyle) -> str:
        """Return the name of an aircraft's first goal, or the text "the goal of ..." if the scenario is unknown."""
        aircraft_tables = self.scenario.get("aircraft", [])
        return (
            str(aircraft_tables[line_style.index]["goal"])
            if line_style.index < len(aircraft_tables)
            else f"the goal of {line_style.label}"
        )

    def name(self, index: int) -> str:
        """Return the name of aircraft number `index`, escaped for matplotlib."""
        return escape_mathtext(self.dataset["aircraft"].values[index])

    def label(self, line_style: LineStyle) -> str:
        """Return the name of an aircraft without the fleet's common prefix, escaped for matplotlib."""
        return escape_mathtext(line_style.label)

    def line_properties(self, line_style: LineStyle) -> dict[str, Any]:
        """Return matplotlib properties of an aircraft's line: colour, and markers (small fleet) or dashes (large)."""
        if self.has_few_aircraft:
            return marker_style(line_style.index) | {"linewidth": 1.5}
        return line_style.properties

    def plot(self, axes: "Axes", line_style: LineStyle, x: np.ndarray, y: np.ndarray) -> None:
        """Draw an aircraft's line; in a small fleet with markers, whose positions are staggered among the aircraft."""
        step = max(x.size // _MARKERS_PER_LINE, 1)
        markers = (line_style.index * step // self.count, step) if self.has_few_aircraft else None
        properties = self.line_properties(line_style)
        axes.plot(x, y, markevery=markers, label=self.name(line_style.index), **properties)

    def reference_properties(self) -> dict[str, Any]:
        """Return matplotlib properties of planned or commanded lines: dashed or, in a large fleet, grey underneath."""
        if self.has_few_aircraft:
            return {"color": INK, "linestyle": DASHED, "linewidth": 0.8, "zorder": 3}
        return {"color": "#c9ced4", "linestyle": "solid", "linewidth": 2.0, "zorder": 1}

    @property
    def reference_text(self) -> str:
        """Word for the look of planned or commanded lines in notes: "dashed" or, in a large fleet, "grey"."""
        return "dashed" if self.has_few_aircraft else "grey"

    @functools.cached_property
    def panel_height(self) -> float:
        """Height of a panel, inches; sufficient for all names at the line ends, if any."""
        height = float(np.clip(0.26 * self.figure_format.width, _PANEL_HEIGHT_MIN, _PANEL_HEIGHT_MAX))
        return max(height, minimum_panel_height(self.count) + 0.1) if self.has_line_names else height

    def figure(self, height: float) -> "Figure":
        """Return a new empty figure with the width of the format and a height in inches."""
        return new_figure((self.figure_format.width, height))[1]

    def panels(self, count: int) -> tuple["Figure", list["Axes"]]:
        """Return a new figure and its `count` panels, one below another with a common time axis."""
        figure = self.figure(_TIME_AXIS_HEIGHT + count * (self.panel_height + _PANEL_GAP))
        panels = list(figure.subplots(count, 1, sharex=True, squeeze=False)[:, 0])
        panels[-1].set_xlabel("Time $t$ (s)")
        return figure, panels

    def label_capacity(self, height: float) -> int:
        """Return how many letters a line of a vertical axis label can have in a panel of `height` inches."""
        return int(height * 72.0 / (8.5 * _LETTER_WIDTH))

    def finish(self, figure: "Figure", panels: Sequence["Axes"], heading: str, note: str) -> "Figure":
        """Add legend, title (flight, `heading`), and `note` above the first panel; enlarge and return the figure."""
        extra_height = 0.0
        if self.count > 1 and self.has_few_aircraft:
            handles = {text: line for axes in panels for line, text in zip(*_entries(axes), strict=True)}
            figure.legend(
                list(handles.values()), list(handles), loc="outside lower center", ncols=self._columns, fontsize=SMALL
            )
            extra_height += _LINE_HEIGHT * SMALL * (1.5 + -(-len(handles) // self._columns))
        if self.figure_format.title:
            title = f"{self.dataset.attrs.get('title', 'flight')}: {heading}"
            lines = self._lines(title, LARGE, 0.0)
            figure.suptitle(escape_mathtext("\n".join(lines)), fontsize=LARGE)
            extra_height += _LINE_HEIGHT * LARGE * (0.5 + len(lines))
        prefix = shared_prefix(self.dataset)
        notes = [note] if note else []
        if prefix and self.has_line_names:
            notes.append(f'names without "{prefix}"')
        if notes:
            lines = self._lines("; ".join(notes), SMALL, _LABEL_SPACE)
            panels[0].set_title(escape_mathtext("\n".join(lines)), fontsize=SMALL, color=MUTED, loc="left")
            extra_height += _LINE_HEIGHT * SMALL * (0.5 + len(lines))
        figure.set_figheight(figure.get_figheight() + extra_height)
        figure.align_ylabels(panels)
        return figure

    def _lines(self, heading: str, points: float, indentation: float) -> list[str]:
        """Return `heading` as lines that fit the figure's width less `indentation`, inches, at font size `points`."""
        return textwrap.wrap(heading, int((self.figure_format.width - indentation) * 72.0 / (points * _LETTER_WIDTH)))

    @property
    def _columns(self) -> int:
        longest = max(len(str(name)) for name in self.dataset["aircraft"].values)
        return max(1, min(6, self.count, int(self.figure_format.width / (0.48 + 0.058 * longest))))


def _entries(axes: "Axes") -> tuple[list[Any], list[str]]:
    handles, labels = axes.get_legend_handles_labels()
    return list(handles), list(labels)
