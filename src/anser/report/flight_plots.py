"""Figures of a flight for Python: `flown.plot.tracks()`."""

from typing import TYPE_CHECKING

import xarray as xr

from anser.report.flight_figures import figures_of
from anser.report.print_style import drawn

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class FlightPlots:
    """Figures of one flight, each a new `matplotlib.figure.Figure`, which a notebook shows and `savefig` writes.

    `flown.plot("guidance")` draws any figure of `anser figures`; `flown.plot.names` are those that there are.
    """

    def __init__(self, dataset: xr.Dataset) -> None:
        self._dataset = dataset

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the figures that can be drawn of this flight."""
        return tuple(figures_of(self._dataset))

    def __call__(self, name: str) -> "Figure":
        """Draw a figure by its name.

        Raises
        ------
        ValueError
            There is none of this name.
        """
        figures = figures_of(self._dataset)
        if name not in figures:
            raise ValueError(f"plot: arrived {name!r}; expected one of {', '.join(figures)}")
        return drawn(figures[name], self._dataset)

    def __repr__(self) -> str:
        return f"figures of a flight: {', '.join(self.names)}"

    def tracks(self) -> "Figure":
        """Tracks over ground up to the arrivals, with the goals'."""
        return self("tracks")

    def profile(self) -> "Figure":
        """Altitude and airspeed against time, with what was planned and the limits."""
        return self("profile")

    def separation(self) -> "Figure":
        """Least distance of each aircraft to any other, and its ratio to the separation asked for.

        Raises
        ------
        ValueError
            There is one aircraft only.
        """
        return self("separation")
