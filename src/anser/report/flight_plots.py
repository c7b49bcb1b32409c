"""Figures of a flight for Python: `flown.plot.tracks()`."""

from collections.abc import Callable
from typing import TYPE_CHECKING

import xarray as xr

from anser.report.flight_figures import chosen_figures, figures_of
from anser.report.flight_paper import Paper, Sheet
from anser.report.print_style import drawn

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_WIDTH_MM = Paper().width_mm


def _method(name: str, words: str) -> "Callable[..., Figure]":
    """Method that draws one figure."""

    def draw(self: "FlightPlots", *, width_mm: float = _WIDTH_MM, title: bool = True) -> "Figure":
        return self(name, width_mm=width_mm, title=title)

    draw.__name__ = draw.__qualname__ = name.replace("-", "_")
    draw.__doc__ = f"{words}\n\n        Arguments and errors as of a call of `FlightPlots` itself."
    return draw


class FlightPlots:
    """Figures of one flight, each a new `matplotlib.figure.Figure`, which a notebook shows and `savefig` writes.

    `flown.plot("guidance")` draws any figure of `anser figures`; `flown.plot.names` are those that there are.
    """

    def __init__(self, dataset: xr.Dataset) -> None:
        self._dataset = dataset

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the figures that can be drawn of this flight."""
        return figures_of(self._dataset)

    def __call__(self, name: str, *, width_mm: float = _WIDTH_MM, title: bool = True) -> "Figure":
        """Draw a figure by its name.

        Parameters
        ----------
        name
            One of `names`.
        width_mm
            Width of the figure; letters keep their size.
        title
            Whether the flight's title stands above it.

        Raises
        ------
        ValueError
            There is none of this name, or the width is none of a figure.
        """
        try:
            figure = chosen_figures(self._dataset, [name])
        except ValueError as error:
            raise ValueError(f"plot: {error}") from None
        try:
            paper = Paper(width_mm, title)
        except ValueError as error:
            raise ValueError(f"width_mm: {error}") from None
        (one,) = figure.values()
        return drawn(lambda dataset: one.draw(Sheet(dataset, paper)), self._dataset)

    def __repr__(self) -> str:
        return f"figures of a flight: {', '.join(self.names)}"

    tracks = _method("tracks", "Tracks over ground up to the arrivals, with the goals'.")
    profile = _method("profile", "Altitude and airspeed against time, with what was asked for and the limits.")
    altitudes = _method("altitudes", "Altitude against time, with the planned one and the limits.")
    airspeed = _method("airspeed", "True airspeed against time, with its command and limits.")
    bank = _method("bank", "Bank angle about the velocity against time, with its command and limits.")
    load_factor = _method("load-factor", "Normal load factor against time, with its limits.")
    surfaces = _method("surfaces", "Each control surface against time, with its command and stops.")
    separation = _method(
        "separation", "Least distance of each aircraft to any other, and over the separation asked for."
    )
    ranges = _method("ranges", "Range to the rendezvous against time, linear and logarithmic.")
    miss = _method("miss", "Zero-effort miss of the rendezvous against time, with the miss that is required.")
    guidance = _method("guidance", "Airspeed, path angle and course against time, with their commands.")
    goal_velocity = _method("goal-velocity", "Velocity of goals that change it, as the aircraft estimate it.")
    plan = _method("plan", "The plan's parameters against time, as it is renewed.")
    knowledge = _method("knowledge", "How well the aircraft know where their goals are.")
    network = _method("network", "Links and clocks of a fleet without a centre.")
