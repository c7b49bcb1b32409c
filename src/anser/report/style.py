"""Style of figures and pages: colours, line styles of aircraft, and figure files with reproducible bytes."""

import functools
import io
import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from anser.files import write_file

if TYPE_CHECKING:
    from matplotlib.figure import Figure


COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#595959")
"""Colours of Okabe and Ito (2008), without yellow (too faint on white), and with dark grey in place of black."""

DARK_COLORS = ("#3D97E0", "#F0772B", "#1FBF90", "#DE93BC", "#EFB530", "#9AD6F7", "#AEB6BF")
"""Hues of `COLORS` for a dark background, each with a contrast of at least 3 to 1 (WCAG 2.2, 1.4.11)."""


def color_of(index: int) -> str:
    """Return the colour "#rrggbb" of aircraft or line number `index`; the colours repeat after 7."""
    return COLORS[index % len(COLORS)]


def page_color_of(index: int) -> str:
    """Return the colour of aircraft number `index` on a page, as a CSS variable for light and dark backgrounds."""
    return f"var(--c{index % len(COLORS)})"


def page_colors() -> str:
    """Return the CSS rule that defines the variables returned by `page_color_of`."""
    pairs = enumerate(zip(COLORS, DARK_COLORS, strict=True))
    return ":root { " + " ".join(f"--c{k}: light-dark({light}, {dark});" for k, (light, dark) in pairs) + " }"


FIGURE_SUFFIXES = (".svg", ".png", ".pdf")
"""Suffixes of the file formats in which figures are written."""

INK, MUTED = "#1b1f24", "#6e7781"
SMALL, LARGE = 7.5, 9.5
DASHED = (0, (4, 2))
"""Dash pattern of planned and commanded values, for matplotlib."""
COMMAND_LINE: dict[str, Any] = {"color": INK, "linestyle": DASHED, "linewidth": 0.9}
"""Line properties, for matplotlib, of planned and commanded values in figures of one aircraft."""
_LINE_DASHES: tuple[Any, ...] = (
    "solid",
    (0, (6, 1.2, 1.2, 1.2)),
    (0, (1.3, 1.0)),
    (0, (3.2, 1.1)),
    (0, (6, 1, 1, 1, 1, 1)),
)
_MARKERS, _FILLS = "os^DvPX", ("full", "none", "left")
PRINT_STYLE: dict[str, Any] = {
    # text stays text, and fixed identifiers make the files reproducible
    "svg.fonttype": "none",
    "svg.hashsalt": "anser",
    "pdf.fonttype": 42,
    "font.size": 8.5,
    "mathtext.fontset": "dejavusans",
    "axes.edgecolor": MUTED,
    "axes.labelcolor": INK,
    "axes.grid": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.formatter.useoffset": False,
    "grid.color": "#e1e4e8",
    "grid.linewidth": 0.6,
    "lines.linewidth": 1.5,
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "legend.framealpha": 0.8,
    "legend.edgecolor": "none",
    "legend.fontsize": SMALL,
    "legend.handlelength": 2.2,
}
MAP_STYLE: dict[str, Any] = {"svg.fonttype": "none", "pdf.fonttype": 42, "font.size": 8, "axes.titlesize": 9}
"""Matplotlib settings of figures over the flight envelope and of robustness studies."""
_METADATA: dict[str, dict[str, None]] = {
    ".svg": {"Date": None},
    ".png": {"Software": None},
    ".pdf": {"CreationDate": None, "Producer": None, "Creator": None},
}


def _matplotlib() -> Any:
    try:
        import matplotlib as mpl
        import matplotlib.figure
    except ImportError:
        raise ImportError("matplotlib is not installed: pip install matplotlib") from None
    return mpl


def new_figure(size: tuple[float, float]) -> tuple[Any, "Figure"]:
    """Return the module matplotlib, and a new empty figure of `size` (width, height), inches."""
    return _matplotlib(), _figure_class()(figsize=size, layout="constrained")


@functools.cache
def _figure_class() -> Any:
    """Return a figure class of matplotlib that a notebook displays without pyplot."""

    class Drawing(_matplotlib().figure.Figure):
        def _repr_png_(self) -> bytes:
            return figure_content(self, ".png", dpi=120)

    return Drawing


def draw_for_print(draw: Callable[[xr.Dataset], "Figure"], dataset: xr.Dataset) -> "Figure":
    """Return the figure that `draw` returns for a dataset, drawn with the matplotlib settings `PRINT_STYLE`."""
    with _matplotlib().rc_context(PRINT_STYLE):
        return draw(dataset)


def series_style(index: int) -> dict[str, Any]:
    """Return colour and dashes, for matplotlib, of line number `index` in a panel; the dashes repeat after 5."""
    return {"color": color_of(index), "linestyle": _LINE_DASHES[index % len(_LINE_DASHES)]}


def marker_style(index: int) -> dict[str, Any]:
    """Return colour and marker, for matplotlib, of aircraft number `index`; the markers repeat after 21."""
    return {
        "color": color_of(index),
        "marker": _MARKERS[index % len(_MARKERS)],
        "fillstyle": _FILLS[index // len(_MARKERS) % len(_FILLS)],
        "markersize": 4.5,
        "markeredgewidth": 0.9,
    }


def save_figure(figure: "Figure", paths: Sequence[Path], *, overwrite: bool = False) -> None:
    """Write a figure to files in the formats of their suffixes.

    Raises FileExistsError if a file exists and `overwrite` is False.
    """
    for path in paths:  # in memory first: on a full disk, matplotlib would raise misleading errors
        write_file(path, figure_content(figure, path.suffix, dpi=160), overwrite=overwrite)
        figure.set_layout_engine("none")  # the layout is computed only once


def figure_content(figure: "Figure", suffix: str, dpi: float | None = None) -> bytes:
    """Return the content of a file of a figure in the format of `suffix`: ".svg", ".png" or ".pdf".

    `dpi` is the resolution in dots per inch; None: the figure's resolution.
    """
    from matplotlib.backend_bases import get_registered_canvas_class

    canvas, resolution, content = figure.canvas, figure.dpi, io.BytesIO()
    try:
        if dpi is not None:
            figure.dpi = dpi
        printer = get_registered_canvas_class(suffix[1:])(figure)
        getattr(printer, f"print_{suffix[1:]}")(content, metadata=_METADATA[suffix])
    finally:
        figure.set_canvas(canvas)
        figure.dpi = resolution
    return content.getvalue()


def save_drawings(
    drawings: Mapping[str, Callable[[xr.Dataset], "Figure"]],
    dataset: xr.Dataset,
    style: Mapping[Any, Any],
    folder: Path,
    suffixes: Sequence[str] = (".svg", ".png"),
    *,
    overwrite: bool = False,
) -> tuple[Path, ...]:
    """Draw figures into the files `folder`/name + suffix, for each name in `drawings` and each of `suffixes`.

    `drawings` are functions that return a figure of the dataset; `style` are settings of matplotlib. Returns the paths.
    Raises FileExistsError if a file exists and `overwrite` is False.
    """
    written: list[Path] = []
    with _matplotlib().rc_context(style):
        for name, draw in drawings.items():
            paths = [folder / f"{name}{suffix}" for suffix in suffixes]
            save_figure(draw(dataset), paths, overwrite=overwrite)
            written += paths
    return tuple(written)


_FLEET_DASHES: tuple[Any, ...] = ("solid", (0, (5, 1.5)), (0, (1.2, 1.2)), (0, (6, 1.5, 1, 1.5)))
_SMALL_FLEET_MAX = 7
_PREFIX_MIN = 3


@dataclass(frozen=True)
class LineStyle:
    """Line style of one aircraft."""

    index: int  # of the aircraft in the dataset
    label: str  # name of the aircraft without the fleet's common prefix
    color: str
    dashes: Any  # dash pattern, for matplotlib
    width: float  # points

    @property
    def properties(self) -> dict[str, Any]:
        """Colour, dashes and width of the line by matplotlib's names."""
        return {"color": self.color, "linestyle": self.dashes, "linewidth": self.width}


def aircraft_line_styles(dataset: xr.Dataset) -> list[LineStyle]:
    """Return the line styles of the aircraft of a flight or plan that have a finite first position."""
    names, prefix = [str(name) for name in dataset["aircraft"].values], shared_prefix(dataset)
    width = 1.5 if len(names) <= _SMALL_FLEET_MAX else 1.0 if len(names) <= 3 * _SMALL_FLEET_MAX else 0.6
    return [
        LineStyle(k, name[len(prefix) :], color_of(k), _FLEET_DASHES[k // len(COLORS) % len(_FLEET_DASHES)], width)
        for k, name in enumerate(names)
        if np.isfinite(dataset["north_m"].values[0, k])
    ]


def shared_prefix(dataset: xr.Dataset) -> str:
    """Return the common start of the aircraft names, which labels omit; empty in a fleet of fewer than 8."""
    names = [str(name) for name in dataset["aircraft"].values]
    if len(names) <= _SMALL_FLEET_MAX:
        return ""
    shared_letters = itertools.takewhile(lambda letters: len(set(letters)) == 1, zip(*names, strict=False))
    prefix = "".join(letters[0] for letters in shared_letters).rstrip("0123456789")
    is_proper = all(len(name) > len(prefix) for name in names)
    return prefix if is_proper and len(prefix) >= _PREFIX_MIN else ""
