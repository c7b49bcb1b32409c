"""Plots of the errors of a check over time, in tolerances, as SVG."""

import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from anser.output_files import write_file

_PANELS = (
    ("Place", ("altitudeMsl", "latitude", "longitude", "eiPosition", "gePosition")),
    ("Velocity", ("feVelocity", "eiVelocity", "altitudeRate", "trueAirspeed")),
    ("Attitude", ("eulerAngle",)),
    ("Body rates", ("bodyAngularRate",)),
    ("Forces and moments", ("aero_",)),
    ("Air and gravity", ("",)),
)
"""Panel and the beginnings of the names of its quantities; the last takes the rest."""

_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000", "#7f7f7f")
"""Okabe and Ito's, which colour-blind readers can tell apart."""


def plot_errors(check: Mapping[str, Any], path: Path) -> bool:
    """Draw the errors of every quantity of a check over time, divided by their tolerances.

    Parameters
    ----------
    check
        One check of the document that `anser verify --json` prints.
    path
        SVG file to write.

    Returns
    -------
    Whether there was something to draw: a published figure at two times or more.
    """
    timed = [c for c in check["comparisons"] if c["time_s"] is not None and c["tolerance"] and c["error"] is not None]
    if len({c["time_s"] for c in timed}) < 2:
        return False
    import matplotlib as mpl
    from matplotlib.figure import Figure

    # No date and fixed identifiers: the same numbers make the same file.
    with mpl.rc_context(
        {"svg.hashsalt": check["key"], "svg.fonttype": "none", "font.size": 8, "axes.grid": True, "grid.alpha": 0.3}
    ):
        figure = Figure(figsize=(13, 7), layout="constrained")
        for axes, (name, groups) in zip(figure.subplots(2, 3, sharex=True).flat, _sorted_panels(timed), strict=True):
            axes.axhspan(-1, 1, color="#0072b2", alpha=0.08, linewidth=0)
            axes.set_title(name)
            for k, (group, members) in enumerate(groups.items()):
                for reference in sorted({c["reference"] for c in members}):
                    line = sorted((c for c in members if c["reference"] == reference), key=lambda c: c["time_s"])
                    axes.plot(
                        [c["time_s"] for c in line],
                        [c["error"] / c["tolerance"] for c in line],
                        marker=".",
                        color=_COLOURS[k % len(_COLOURS)],
                        linestyle="--" if reference == "sim_04" else "-",
                        label=group if reference != "sim_04" else None,
                        linewidth=1,
                    )
            axes.set_ylabel("error / tolerance")
            if groups:
                axes.legend(fontsize=6, ncols=2, loc="best")
        for axes in figure.axes[3:]:
            axes.set_xlabel("time (s)")
        figure.suptitle(f"{check['title']}: obtained less sim_05 (full lines) and sim_04 (broken lines)")
        content = io.BytesIO()
        figure.savefig(content, format="svg", metadata={"Date": None})
        write_file(path, content.getvalue())
    return True


def _sorted_panels(
    comparisons: Sequence[Mapping[str, Any]],
) -> list[tuple[str, dict[str, list[Mapping[str, Any]]]]]:
    """Quantities by panel: name of the panel, quantity -> its comparisons."""
    panels: list[tuple[str, dict[str, list[Mapping[str, Any]]]]] = [(name, {}) for name, _ in _PANELS]
    for comparison in comparisons:
        group = comparison["group"]
        place = next(k for k, (_, starts) in enumerate(_PANELS) if group.startswith(starts))
        panels[place][1].setdefault(group, []).append(comparison)
    return panels
