"""Style of figures and pages.

Colours that the colour-blind can tell apart, line styles of aircraft, and figures for print that are written
reproducibly.
"""

import functools
import io
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
"""Okabe and Ito (2008), without the yellow, which white paper swallows, and with a dark grey for the black of text."""

DARK_COLORS = ("#3D97E0", "#F0772B", "#1FBF90", "#DE93BC", "#EFB530", "#9AD6F7", "#AEB6BF")
"""The same hues on a dark ground: each at least 3 to 1 against it, as WCAG 2.2 (1.4.11) asks of graphics."""


def color_of(index: int) -> str:
    """Colour of an aircraft, by its place in the fleet; a large fleet uses each again."""
    return COLORS[index % len(COLORS)]


def page_color_of(index: int) -> str:
    """Colour of an aircraft on a page, for CSS and SVG: the page has it in light and in dark."""
    return f"var(--c{index % len(COLORS)})"


def page_colors() -> str:
    """Rule of the style sheet that defines what `page_color_of` names."""
    pairs = zip(COLORS, DARK_COLORS, strict=True)
    return ":root { " + " ".join(f"--c{k}: light-dark({one}, {dark});" for k, (one, dark) in enumerate(pairs)) + " }"


FIGURE_SUFFIXES = (".svg", ".png", ".pdf")
"""Kinds of files that a figure can be."""

INK, MUTED = "#1b1f24", "#6e7781"
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


def draw_for_print(draw: Callable[[xr.Dataset], "Figure"], dataset: xr.Dataset) -> "Figure":
    """Draw a figure of a dataset in the style for print."""
    with _matplotlib().rc_context(PRINT_STYLE):
        return draw(dataset)


def series_style(index: int) -> dict[str, Any]:
    """Colour and dashes of the lines that share a panel: to be told apart in grey as well."""
    return {"color": color_of(index), "linestyle": _LINES[index % len(_LINES)]}


def marker_style(index: int) -> dict[str, Any]:
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


_COLORS = 7  # then the colours begin again, with other dashes
_DASHES: tuple[Any, ...] = ("solid", (0, (5, 1.5)), (0, (1.2, 1.2)), (0, (6, 1.5, 1, 1.5)))
_FEW = 7
_PREFIX_MIN = 3


@dataclass(frozen=True)
class LineStyle:
    """Place in the dataset, label, colour and dashes of an aircraft."""

    index: int
    label: str
    color: str
    dashes: Any
    width: float


def aircraft_line_styles(dataset: xr.Dataset) -> list[LineStyle]:
    """One pen for each aircraft whose path is finite at its start."""
    names, prefix = [str(name) for name in dataset["aircraft"].values], shared_prefix(dataset)
    width = 1.5 if len(names) <= _FEW else 1.0 if len(names) <= 3 * _FEW else 0.6
    return [
        LineStyle(k, name[len(prefix) :], color_of(k), _DASHES[k // _COLORS % len(_DASHES)], width)
        for k, name in enumerate(names)
        if np.isfinite(dataset["north_m"].values[0, k])
    ]


def shared_prefix(dataset: xr.Dataset) -> str:
    """What the names of a large fleet begin with alike and labels leave out; empty for a small one."""
    names = [str(name) for name in dataset["aircraft"].values]
    if len(names) <= _FEW:
        return ""
    prefix = _shared(names).rstrip("0123456789")
    whole = all(len(name) > len(prefix) for name in names)
    return prefix if whole and len(prefix) >= _PREFIX_MIN else ""


def _shared(names: list[str]) -> str:
    """Letters that all names begin with: those that the first and the last in order share."""
    first, last = min(names), max(names)
    differ = (k for k, (one, other) in enumerate(zip(first, last, strict=False)) if one != other)
    return first[: next(differ, min(len(first), len(last)))]
