"""A sheet that a figure of a flight is drawn on: how wide, with or without a title, how its aircraft are told apart."""

import functools
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from anser.report.derived_variables import HOLD, recorded_scenario
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


_MM = 25.4
_WIDTHS_MM = (60.0, 400.0)
_LETTER = 0.58  # mean width of a letter in its size, with some to spare
_LEFT = 0.75  # of the labels left of the axes, inches
_FEW = 7  # aircraft: of more, lines have no marks, and names instead of a key
_TALL, _LOW = 1.7, 1.2  # panels of a wide and of a narrow figure, inches
_BELOW, _BETWEEN = 0.45, 0.1  # time axis, and what lies between panels, inches
_LINE = 1.35 / 72.0  # height of a line of letters in their size, inches


@dataclass(frozen=True)
class FigureFormat:
    """What a figure is made for.

    Attributes
    ----------
    width_mm
        Width of the figure, 60 to 400 mm; one column of a journal has 85 to 90, two have 170 to 180.
    title
        Whether the flight's title stands above it.

    Raises
    ------
    ValueError
        The width is none of a figure.
    """

    width_mm: float = 6.5 * _MM
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
        return self.width_mm / _MM

    @property
    def is_narrow(self) -> bool:
        """Whether nothing can stand side by side."""
        return self.width_mm < 130.0


class FlightSheet:
    """A flight on a paper: what every figure of it needs.

    Attributes
    ----------
    dataset, paper
        As given.
    """

    def __init__(self, dataset: xr.Dataset, figure_format: FigureFormat) -> None:
        self.dataset, self.figure_format = dataset, figure_format

    @classmethod
    def with_default_format(cls, dataset: xr.Dataset) -> "FlightSheet":
        """A flight on the usual paper."""
        return cls(dataset, FigureFormat())

    @property
    def count(self) -> int:
        """Number of aircraft."""
        return self.dataset.sizes["aircraft"]

    @property
    def has_few_aircraft(self) -> bool:
        """Whether the lines have marks and a key; of more aircraft they have names at their ends."""
        return self.count <= _FEW

    @property
    def has_line_names(self) -> bool:
        """Whether lines have names at their ends."""
        return not self.has_few_aircraft and self.count <= NAMES_MAX

    @functools.cached_property
    def scenario(self) -> dict[str, Any]:
        """The flight's scenario; empty where the dataset carries none."""
        return recorded_scenario(self.dataset)

    @functools.cached_property
    def line_styles(self) -> list[LineStyle]:
        """Of each aircraft that is somewhere at the start."""
        return aircraft_line_styles(self.dataset)

    @functools.cached_property
    def time(self) -> np.ndarray:
        """Times of the record, s."""
        return self.dataset["time"].values

    @functools.cached_property
    def arrival_index(self) -> np.ndarray:
        """Index of the last time before each aircraft begins its hold; the flight's last where it never does."""
        held = self.dataset["phase"].values >= HOLD
        return np.where(held.any(axis=0), np.maximum(held.argmax(axis=0), 1), held.shape[0]) - 1

    def until_arrival(self, name: str, line_style: LineStyle) -> np.ndarray:
        """A variable of one aircraft up to its arrival, shape (samples,)."""
        return (
            self.dataset[name]
            .values[: int(self.arrival_index[line_style.index]) + 1, line_style.index]
            .astype(np.float64)
        )

    def goal_name(self, line_style: LineStyle) -> str:
        """Name of the goal that an aircraft has at first; that of its aircraft where the record does not tell."""
        rows = self.scenario.get("aircraft", [])
        return (
            str(rows[line_style.index]["goal"]) if line_style.index < len(rows) else f"the goal of {line_style.label}"
        )

    def name(self, index: int) -> str:
        """Name of an aircraft, for matplotlib."""
        return escape_mathtext(self.dataset["aircraft"].values[index])

    def label(self, line_style: LineStyle) -> str:
        """Short name of an aircraft, for matplotlib."""
        return escape_mathtext(line_style.label)

    def line_properties(self, line_style: LineStyle) -> dict[str, Any]:
        """Colour of a line, with marks of few aircraft, with dashes of many."""
        if self.has_few_aircraft:
            return marker_style(line_style.index) | {"linewidth": 1.5}
        return {"color": line_style.color, "linestyle": line_style.dashes, "linewidth": line_style.width}

    def reference_properties(self) -> dict[str, Any]:
        """Line of what was planned or commanded: beneath the flown where there are many, not to hide them."""
        if self.has_few_aircraft:
            return {"color": INK, "linestyle": DASHED, "linewidth": 0.8, "zorder": 3}
        return {"color": "#c9ced4", "linestyle": "solid", "linewidth": 2.0, "zorder": 1}

    @property
    def reference_text(self) -> str:
        """What the look of the planned or commanded is called."""
        return "dashed" if self.has_few_aircraft else "grey"

    @functools.cached_property
    def panel_height(self) -> float:
        """Height of one of several panels, inches; as many names as aircraft stand beside it."""
        height = float(np.clip(0.26 * self.figure_format.width, _LOW, _TALL))
        return max(height, minimum_panel_height(self.count) + 0.1) if self.has_line_names else height

    def figure(self, height: float) -> "Figure":
        """Figure of a height (inches), which grows by key, title and note."""
        return new_figure((self.figure_format.width, height))[1]

    def panels(self, count: int) -> tuple["Figure", list["Axes"]]:
        """Figure of panels under one another, which share their times."""
        figure = self.figure(_BELOW + count * (self.panel_height + _BETWEEN))
        panels = list(figure.subplots(count, 1, sharex=True, squeeze=False)[:, 0])
        panels[-1].set_xlabel("Time $t$ (s)")
        return figure, panels

    def label_capacity(self, height: float) -> int:
        """Letters of an axis label that stand beside a panel of a height, inches."""
        return int(height * 72.0 / (8.5 * _LETTER))

    def finish(self, figure: "Figure", panels: Sequence["Axes"], heading: str, note: str) -> "Figure":
        """Add key, title and note; the note stands above the first panel.

        Parameters
        ----------
        figure, panels
            As drawn.
        words
            What is shown; the title.
        note
            What the lines are, and what is not shown.
        """
        more = 0.0
        if self.count > 1 and self.has_few_aircraft:
            handles = {text: line for axes in panels for line, text in zip(*_entries(axes), strict=True)}
            figure.legend(
                list(handles.values()), list(handles), loc="outside lower center", ncols=self._columns, fontsize=SMALL
            )
            more += _LINE * SMALL * (1.5 + -(-len(handles) // self._columns))
        if self.figure_format.title:
            title = f"{self.dataset.attrs.get('title', 'flight')}: {heading}"
            lines = self._lines(title, LARGE, 0.0)
            figure.suptitle(escape_mathtext("\n".join(lines)), fontsize=LARGE)
            more += _LINE * LARGE * (0.5 + len(lines))
        prefix = shared_prefix(self.dataset)
        told = [note] if note else []
        if prefix and self.has_line_names:
            told.append(f'names without "{prefix}"')
        if told:
            lines = self._lines("; ".join(told), SMALL, _LEFT)
            panels[0].set_title(escape_mathtext("\n".join(lines)), fontsize=SMALL, color=MUTED, loc="left")
            more += _LINE * SMALL * (0.5 + len(lines))
        figure.set_figheight(figure.get_figheight() + more)
        figure.align_ylabels(panels)
        return figure

    def _lines(self, heading: str, points: float, less: float) -> list[str]:
        """Words in lines that are as wide as the figure, or less (inches)."""
        return textwrap.wrap(heading, int((self.figure_format.width - less) * 72.0 / (points * _LETTER)))

    @property
    def _columns(self) -> int:
        """Columns of the key: as many as the longest name lets stand side by side."""
        longest = max(len(str(name)) for name in self.dataset["aircraft"].values)
        return max(1, min(6, self.count, int(self.figure_format.width / (0.48 + 0.058 * longest))))


def _entries(axes: "Axes") -> tuple[list[Any], list[str]]:
    handles, labels = axes.get_legend_handles_labels()
    return list(handles), list(labels)
