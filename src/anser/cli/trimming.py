"""The command trim."""

from typing import Annotated

import typer

from anser.cli.arguments import AircraftName, Altitude, CentreOfGravity, PathAngle, TrueAirspeed, TurnRate, VariantName
from anser.cli.console import (
    answer,
    end_without,
    must_be_flight_condition,
    must_be_known,
    must_stand_alone,
    plain_table,
    print_table,
    working,
)
from anser.cli.offering import about


@about(
    "anser trim --speed-m-s 150 --altitude-m 1000",
    "anser trim --speed-m-s 150 --altitude-m 1000 --turn-rate-deg-s 5 --json",
    "anser trim --speed-m-s 153 --altitude-m 0 --cg 0.35 --pitch-rate-deg-s 10",
    unmet="no steady flight there",
)
def trim(
    speed_m_s: TrueAirspeed,
    altitude_m: Altitude,
    aircraft: AircraftName = "f16",
    variant: VariantName = "textbook",
    cg: CentreOfGravity = None,
    path_angle_deg: PathAngle = 0.0,
    turn_rate_deg_s: TurnRate = 0.0,
    pitch_rate_deg_s: Annotated[
        float, typer.Option(help="Pitch rate of a pull-up: wings level, no roll and yaw rate; not in a turn.")
    ] = 0.0,
) -> None:
    """Find the steady flight at a condition, or say what stops it and where the nearest one is."""
    must_be_known(aircraft, variant)
    must_be_flight_condition(
        {
            "--speed-m-s": speed_m_s,
            "--altitude-m": altitude_m,
            "--cg": cg,
            "--path-angle-deg": path_angle_deg,
            "--turn-rate-deg-s": turn_rate_deg_s,
            "--pitch-rate-deg-s": pitch_rate_deg_s,
        }
    )
    must_stand_alone("--pitch-rate-deg-s", pitch_rate_deg_s, {"--turn-rate-deg-s": turn_rate_deg_s})
    from anser.campaign import find_trim
    from anser.scenario import load_airframe

    airframe = load_airframe(aircraft, variant, cg)
    with working("solving"):
        found = find_trim(
            airframe,
            speed_m_s,
            altitude_m,
            path_angle_deg,
            turn_rate_deg_s,
            pitch_rate_deg_s=pitch_rate_deg_s,
        )
    if found.diagnosis is not None:
        end_without("no steady flight", [found.diagnosis])
    answer(
        lambda: {
            "format_version": 1,
            "aircraft": aircraft,
            "variant": variant,
            "x_cg_over_c": float(airframe.x_cg),
            "speed_m_s": speed_m_s,
            "altitude_m": altitude_m,
            "path_angle_deg": path_angle_deg,
            "turn_rate_deg_s": turn_rate_deg_s,
            "pitch_rate_deg_s": pitch_rate_deg_s,
            "quantities": [{"name": name, "value": value, "unit": unit or "1"} for name, value, unit in found.rows],
        }
    )
    table = plain_table(f"{aircraft} ({variant}) at {speed_m_s:g} m/s, {altitude_m:g} m")
    table.add_column("quantity")
    table.add_column("value", justify="right")
    table.add_column("unit")
    for name, value, unit in (("centre of gravity", float(airframe.x_cg), "of chord"), *found.rows):
        table.add_row(name, f"{value:.4f}", unit)
    print_table(table)
