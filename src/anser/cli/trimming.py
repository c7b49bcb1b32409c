"""The command trim."""

from typing import Annotated

import typer
from rich.table import Table

from anser.cli.console import RefusedError, err, must_lie, screen
from anser.scenario import AIRFRAMES, VARIANTS, load_airframe


def trim(
    speed_m_s: Annotated[float, typer.Option(help="True airspeed.", show_default=False)],
    altitude_m: Annotated[float, typer.Option(help="Geometric altitude.", show_default=False)],
    aircraft: Annotated[str, typer.Option(help=f"Airframe: {', '.join(AIRFRAMES)}.")] = "f16",
    variant: Annotated[str, typer.Option(help="Published set of tables: textbook, s119 or founding.")] = "textbook",
    path_angle_deg: Annotated[float, typer.Option(help="Climb angle.")] = 0.0,
    turn_rate_deg_s: Annotated[float, typer.Option(help="Rate of the course, right positive.")] = 0.0,
) -> None:
    """Find the steady flight at a condition, or say what stops it and where the nearest one is."""
    if aircraft not in AIRFRAMES:
        raise RefusedError(f"--aircraft: arrived {aircraft!r}; expected one of {', '.join(AIRFRAMES)}")
    if variant not in VARIANTS[aircraft]:
        raise RefusedError(f"--variant: arrived {variant!r}; expected one of {', '.join(VARIANTS[aircraft])}")
    must_lie("--speed-m-s", speed_m_s, 1, 1000)
    must_lie("--altitude-m", altitude_m, -500, 30000)
    must_lie("--path-angle-deg", path_angle_deg, -80, 80)
    must_lie("--turn-rate-deg-s", turn_rate_deg_s, -60, 60)
    from anser.campaign import find_trim

    with err.status("solving (the first time, this compiles)"):
        found = find_trim(load_airframe(aircraft, variant), speed_m_s, altitude_m, path_angle_deg, turn_rate_deg_s)
    if found.diagnosis is not None:
        err.print(found.diagnosis, soft_wrap=True, markup=False)
        raise typer.Exit(1)
    table = Table(title=f"{aircraft} ({variant}) at {speed_m_s:g} m/s, {altitude_m:g} m")
    table.add_column("quantity")
    table.add_column("value", justify="right")
    table.add_column("unit")
    for name, value, unit in found.rows:
        table.add_row(name, f"{value:.4f}", unit)
    screen.print(table)
