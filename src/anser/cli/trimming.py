"""The command trim."""

from typing import Annotated

import typer

from anser.cli.arguments import AircraftName, VariantName
from anser.cli.console import answer, end_without, must_be_known, must_lie, plain_table, print_table, working
from anser.cli.offering import about
from anser.scenario import load_airframe


@about(
    "anser trim --speed-m-s 150 --altitude-m 1000",
    "anser trim --speed-m-s 150 --altitude-m 1000 --turn-rate-deg-s 5 --json",
    unmet="no steady flight there",
)
def trim(
    speed_m_s: Annotated[float, typer.Option(help="True airspeed.", show_default=False)],
    altitude_m: Annotated[float, typer.Option(help="Geometric altitude.", show_default=False)],
    aircraft: AircraftName = "f16",
    variant: VariantName = "textbook",
    path_angle_deg: Annotated[float, typer.Option(help="Climb angle.")] = 0.0,
    turn_rate_deg_s: Annotated[float, typer.Option(help="Rate of the course, right positive.")] = 0.0,
) -> None:
    """Find the steady flight at a condition, or say what stops it and where the nearest one is."""
    must_be_known(aircraft, variant)
    must_lie("--speed-m-s", speed_m_s, 1, 1000)
    must_lie("--altitude-m", altitude_m, -500, 30000)
    must_lie("--path-angle-deg", path_angle_deg, -80, 80)
    must_lie("--turn-rate-deg-s", turn_rate_deg_s, -60, 60)
    from anser.campaign import find_trim

    with working("solving (the first time, this compiles)"):
        found = find_trim(load_airframe(aircraft, variant), speed_m_s, altitude_m, path_angle_deg, turn_rate_deg_s)
    if found.diagnosis is not None:
        end_without("no steady flight", [found.diagnosis])
    answer(
        lambda: {
            "format_version": 1,
            "aircraft": aircraft,
            "variant": variant,
            "speed_m_s": speed_m_s,
            "altitude_m": altitude_m,
            "path_angle_deg": path_angle_deg,
            "turn_rate_deg_s": turn_rate_deg_s,
            "quantities": [{"name": name, "value": value, "unit": unit or "1"} for name, value, unit in found.rows],
        }
    )
    table = plain_table(f"{aircraft} ({variant}) at {speed_m_s:g} m/s, {altitude_m:g} m")
    table.add_column("quantity")
    table.add_column("value", justify="right")
    table.add_column("unit")
    for name, value, unit in found.rows:
        table.add_row(name, f"{value:.4f}", unit)
    print_table(table)
