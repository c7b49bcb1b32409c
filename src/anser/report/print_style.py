"""Figures for print: how they look, and how they are written so that the same numbers make the same file."""

import functools
import io
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import xarray as xr

from anser.output_files import write_file
from anser.report.style import color_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FIGURE_SUFFIXES = (".svg", ".png", ".pdf")
"""Kinds of files that a figure can be."""

INK, QUIET = "#1b1f24", "#6e7781"
SMALL, LARGE = 7.5, 9.5
DASHED = (0, (4, 2))
"""What was asked for, beside what was done."""
_LINES: tuple[Any, ...] = ("solid", (0, (6, 1.2, 1.2, 1.2)), (0, (1.3, 1.0)), (0, (3.2, 1.1)), (0, (6, 1, 1, 1, 1, 1)))
_MARKERS, _FILLS = "os^DvPX", ("full", "none", "left")
PRINT_STYLE: dict[str, Any] = {
    # Text stays text and the identifiers are fixed: the same numbers make the same file.
    "svg.fonttype": "none",
    "svg.hashsalt": "anser",
    "pdf.fonttype": 42,
    "font.size": 8.5,
    "mathtext.fontset": "dejavusans",
    "axes.edgecolor": QUIET,
    "axes.labelcolor": INK,
    "axes.grid": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.formatter.useoffset": False,
    "grid.color": "#e1e4e8",
    "grid.linewidth": 0.6,
    "lines.linewidth": 1.5,
    "xtick.color": QUIET,
    "ytick.color": QUIET,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "legend.framealpha": 0.8,
    "legend.edgecolor": "none",
    "legend.fontsize": SMALL,
    "legend.handlelength": 2.2,
}
MAP_STYLE: dict[str, Any] = {"svg.fonttype": "none", "pdf.fonttype": 42, "font.size": 8, "axes.titlesize": 9}
"""Of maps over the envelope and of studies."""
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
    """Matplotlib, and an empty figure of a size in inches."""
    return _matplotlib(), _drawing_class()(figsize=size, layout="constrained")


@functools.cache
def _drawing_class() -> Any:
    """Make the class of figures that a notebook shows, pyplot or not."""

    class Drawing(_matplotlib().figure.Figure):
        """A figure without a window."""

        def _repr_png_(self) -> bytes:
            content = io.BytesIO()
            self.savefig(content, format="png", dpi=120)
            return content.getvalue()

    return Drawing


def drawn(draw: Callable[[xr.Dataset], "Figure"], dataset: xr.Dataset) -> "Figure":
    """Draw a figure of a dataset in the style for print."""
    with _matplotlib().rc_context(PRINT_STYLE):
        return draw(dataset)


def line_of(index: int) -> dict[str, Any]:
    """Colour and dashes of the lines that share a panel: to be told apart in grey as well."""
    return {"color": color_of(index), "linestyle": _LINES[index % len(_LINES)]}


def marker_of(index: int) -> dict[str, Any]:
    """Colour and marker of an aircraft, by its place in the fleet: shape and filling alone tell 21 apart."""
    return {
        "color": color_of(index),
        "marker": _MARKERS[index % len(_MARKERS)],
        "fillstyle": _FILLS[index // len(_MARKERS) % len(_FILLS)],
        "markersize": 4.5,
        "markeredgewidth": 0.9,
    }


def save_figure(figure: "Figure", paths: Sequence[Path], *, overwrite: bool = False) -> None:
    """Write a figure to files, each of one of `FIGURE_SUFFIXES`; FileExistsError if one may not be replaced."""
    for path in paths:
        content = io.BytesIO()  # a full disk would leave matplotlib with faults of its own
        figure.savefig(content, format=path.suffix.removeprefix("."), dpi=160, metadata=_METADATA[path.suffix])
        write_file(path, content.getvalue(), overwrite=overwrite)
        figure.set_layout_engine("none")  # laid out once is enough


def save_drawings(
    drawings: Mapping[str, Callable[[xr.Dataset], "Figure"]],
    dataset: xr.Dataset,
    style: Mapping[Any, Any],
    folder: Path,
    suffixes: Sequence[str] = (".svg", ".png"),
    *,
    overwrite: bool = False,
) -> tuple[Path, ...]:
    """Draw a dataset in a style, each drawing into `NAME` and each suffix in a folder; returns the paths."""
    written: list[Path] = []
    with _matplotlib().rc_context(style):
        for name, draw in drawings.items():
            paths = [folder / f"{name}{suffix}" for suffix in suffixes]
            save_figure(draw(dataset), paths, overwrite=overwrite)
            written += paths
    return tuple(written)
