"""Picture of the deep stall: pitching moment against angle of attack, and its trims as the centre of gravity moves."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import xarray as xr

from anser.report.print_style import INK, PRINT_STYLE, QUIET, new_figure, save_figure
from anser.report.style import color_of


def draw_deep_stall(dataset: xr.Dataset, paths: Sequence[Path]) -> None:
    """Draw Cm against alpha for each centre of gravity, trims marked, and the followed curve of trims.

    Parameters
    ----------
    dataset
        As `anser.execution.deep_stall` makes it.
    paths
        New files, with one of the suffixes of a figure.
    """
    mpl, figure = new_figure((9.0, 4.2))
    with mpl.rc_context(PRINT_STYLE):
        left, right = figure.subplots(1, 2)
        alphas = dataset["alpha"].values
        for k, x_cg in enumerate(dataset["x_cg"].values):
            left.plot(alphas, dataset["pitching_moment"].values[k], color=color_of(k), label=f"{x_cg:g} of chord")
        left.axhline(0.0, color=INK, linewidth=0.8)
        for stable, fill, name in ((1, INK, "stable trim"), (0, "white", "unstable trim")):
            which = dataset["trim_stable"].values == stable
            marks = {"linestyle": "none", "marker": "o", "color": INK, "markerfacecolor": fill, "zorder": 5}
            left.plot(dataset["trim_alpha"].values[which], np.zeros(which.sum()), label=name, **marks)
            right.plot(dataset["trim_x_cg"].values[which], dataset["trim_alpha"].values[which], **marks)
        left.set_xlabel("angle of attack (deg)")
        left.set_ylabel("pitching moment coefficient $C_m$")
        left.legend(title="centre of gravity")
        x_cg, alpha = dataset["branch_x_cg"].values, dataset["branch_alpha"].values
        falls = dataset["branch_slope"].values < 0.0
        right.plot(x_cg, np.where(falls, alpha, np.nan), color=INK, label="stable")
        right.plot(x_cg, np.where(falls, np.nan, alpha), color=QUIET, linestyle="dashed", label="unstable")
        right.set_xlabel("centre of gravity (of chord)")
        right.set_ylabel("angle of attack of the trim (deg)")
        if np.isfinite(x_cg).any():
            right.legend()
        of = dataset.attrs
        figure.suptitle(
            f"{of['aircraft']} ({of['variant']}): pitch trims with the elevator held at {of['elevator_deg']:g} deg, "
            "no sideslip",
            fontsize=9.5,
            color=INK,
        )
        save_figure(figure, paths)
