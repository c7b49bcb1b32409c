"""Velocities of the goals as the aircraft estimate them; those that stay as they are, in words."""

from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from anser.report.aircraft_pens import Pen
from anser.report.flight_curves import Curve, draw_curve
from anser.report.flight_paper import Sheet

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_AXES = ("north", "east", "down")
GOAL_VELOCITIES = tuple(Curve(f"goal_estimate_velocity_{axis}_m_s", f"goal_velocity_{axis}_m_s") for axis in _AXES)
"""What the aircraft estimate, beside the truth."""
_FLAT_M_S = 0.02  # what changes no more is no curve
_STANDS_M_S = 0.05


def has_changing_goals(dataset: xr.Dataset) -> bool:
    """Whether the velocity of a goal, or what an aircraft takes it to be, changes before the arrival."""
    return any(_changing(Sheet.of(dataset), curve) for curve in GOAL_VELOCITIES)


def draw_goal_velocities(sheet: Sheet) -> "Figure":
    """Draw the components that change, and say of the others what they are."""
    shown = [(curve, pens) for curve in GOAL_VELOCITIES if (pens := _changing(sheet, curve))]
    figure, panels = sheet.panels(len(shown))
    told = [f"lines: recovered from the line of sight; {sheet.wanted_words}: true"]
    for axes, (curve, pens) in zip(panels, shown, strict=True):
        draw_curve(axes, sheet, curve, pens)
    drawn = {pen.index for _, pens in shown for pen in pens}
    steady = dict.fromkeys(_words(sheet, pen) for pen in sheet.pens if pen.index not in drawn)
    return sheet.finish(
        figure, panels, "velocities of the goals as the aircraft estimate them", "; ".join([*told, *steady])
    )


def _changing(sheet: Sheet, curve: Curve) -> list[Pen]:
    """Aircraft for whose goal a component changes."""
    names = [name for name in (curve.name, curve.wanted) if name is not None]
    return [pen for pen in sheet.pens if any(float(np.ptp(sheet.flown(name, pen))) > _FLAT_M_S for name in names)]


def _words(sheet: Sheet, pen: Pen) -> str:
    north, east, down = (float(sheet.flown(f"goal_velocity_{axis}_m_s", pen)[-1]) for axis in _AXES)
    speed, goal = np.hypot(north, east), sheet.goal(pen)
    if np.hypot(speed, down) < _STANDS_M_S:
        return f"{goal} stands"
    words = f"{goal} keeps {speed:.3g} m/s on course {np.degrees(np.arctan2(east, north)) % 360.0:.0f}°"
    return words if abs(down) < _STANDS_M_S else f"{words}, {abs(down):.2g} m/s {'down' if down > 0.0 else 'up'}"
