"""Commands about one steady flight: trim, linearize."""

import math
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from anser.cli.arguments import AircraftName, Altitude, CentreOfGravity, PathAngle, TrueAirspeed, TurnRate, VariantName
from anser.cli.console import (
    RefusedError,
    answer,
    columns,
    end_without,
    finding_trim,
    line,
    must_be_flight_condition,
    must_be_known,
    must_lie,
    plain_table,
    print_table,
    say,
    screen,
    working,
)
from anser.cli.offering import about
from anser.cli.output_folder import Force, must_be_new_file, written_file

if TYPE_CHECKING:
    from anser.execution import Linearized
    from anser.simulation import Mode


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
    condition: dict[str, Any] = {
        "speed_m_s": speed_m_s,
        "altitude_m": altitude_m,
        "path_angle_deg": path_angle_deg,
        "turn_rate_deg_s": turn_rate_deg_s,
        "pitch_rate_deg_s": pitch_rate_deg_s,
    }
    must_be_flight_condition(condition | {"cg": cg})
    from anser.aircraft import F16
    from anser.execution import airframe_of, name_of
    from anser.execution import trim as find

    airframe, of = airframe_of(aircraft, variant, cg)
    centre = {"x_cg_over_c": float(airframe.x_cg)} if isinstance(airframe, F16) else {}
    with working("solving"):
        found = find(airframe, **condition)
    if found.diagnosis is not None:
        end_without("no steady flight", [found.diagnosis])
    answer(
        lambda: {
            "format_version": 1,
            **of,
            **centre,
            **condition,
            "quantities": [{"name": name, "value": value, "unit": unit or "1"} for name, value, unit in found.rows],
        }
    )
    title = f"{name_of(of)} at {speed_m_s:g} m/s, {altitude_m:g} m"
    table = plain_table(title, "quantity", *columns("value", justify="right"), "unit")
    placed = [("centre of gravity", value, "of chord") for value in centre.values()]
    for name, value, unit in (*placed, *found.rows):
        table.add_row(name, f"{value:.4f}", unit)
    print_table(table)


_SUFFIXES = (".nc", ".json")
_ROUNDING = 1e-12
"""Entries of the tables below this are rounding noise of terms that cancel, and shown as 0."""


@about(
    "anser linearize --speed-m-s 150 --altitude-m 1000",
    "anser linearize --speed-m-s 150 --altitude-m 1000 --loop attitude --out model.nc",
    unmet="no steady flight there",
)
def linearize(
    speed_m_s: TrueAirspeed,
    altitude_m: Altitude,
    aircraft: AircraftName = "f16",
    variant: VariantName = "textbook",
    x_cg: CentreOfGravity = None,
    path_angle_deg: PathAngle = 0.0,
    turn_rate_deg_s: TurnRate = 0.0,
    path_rate_deg_s: Annotated[float, typer.Option(help="Rate of the climb angle: a path bent upwards.")] = 0.0,
    pitch_rate_deg_s: Annotated[
        float, typer.Option(help="Pitch rate of a pull-up: wings level, no roll and yaw rate; no other rate.")
    ] = 0.0,
    loop: Annotated[
        Literal["open", "rates", "attitude", "velocity"],
        typer.Option(help="The aircraft by itself, or the loop of its autopilot that is commanded."),
    ] = "open",
    actuators: Annotated[
        bool, typer.Option("--actuators", help="Inputs are commands to the actuators, not deflections (open loop).")
    ] = False,
    step_s: Annotated[float, typer.Option(help="Sampling period of the autopilot.")] = 0.01,
    out: Annotated[
        Path | None, typer.Option(help="New file to write all of it to: NAME.nc (NetCDF) or NAME.json.")
    ] = None,
    force: Force = False,
) -> None:
    """Trim an aircraft and linearize it there: A, B, C, D and the modes with their names, in SI units and radians."""
    must_be_known(aircraft, variant)
    condition: dict[str, Any] = {
        "speed_m_s": speed_m_s,
        "altitude_m": altitude_m,
        "path_angle_deg": path_angle_deg,
        "turn_rate_deg_s": turn_rate_deg_s,
        "path_rate_deg_s": path_rate_deg_s,
        "pitch_rate_deg_s": pitch_rate_deg_s,
    }
    must_be_flight_condition(condition | {"x_cg": x_cg})
    must_lie("--step-s", step_s, 0.001, 0.05)
    if actuators and loop != "open":
        raise RefusedError(f"--actuators: arrived with --loop {loop}, which always has them; expected --loop open")
    if out is not None:
        must_be_new_file("--out", out, _SUFFIXES, force)
    from anser.execution import linearize as find

    with finding_trim("trimming and differentiating"):
        found = find(aircraft, variant, x_cg_over_c=x_cg, loop=loop, actuators=actuators, step_s=step_s, **condition)
    if out is not None:
        with written_file("--out", out, force) as file:
            found.write(file)
    answer(found.document)
    _print_model(found)
    if out is not None:
        say(f"{out}: written")


def _print_model(found: "Linearized") -> None:
    from anser.execution import name_of

    model, of = found.model, found.condition
    named = name_of(of)
    if "x_cg_over_c" in of:
        named = f"{named.removesuffix(')')}, centre of mass {of['x_cg_over_c']:.3g})"
    sampled = float(model.step) > 0
    kind = f"{of['loop']} loop, sampled every {float(model.step):g} s" if sampled else "open loop"
    lines = [
        f"{named} at {of['speed_m_s']:g} m/s, {of['altitude_m']:g} m: {kind}",
        "SI units and radians; power in percent",
        "",
        *_mode_lines(found.modes),
        "",
        *_block("condition", ("value",), model.states + model.inputs, [[v] for v in [*model.x, *model.u]]),
        "",
        *_block("A", model.states, model.states, model.A),
        "",
        *_block("B", model.inputs, model.states, model.B),
    ]
    for text in lines:
        line(text)


def _mode_lines(modes: tuple["Mode", ...]) -> list[str]:
    width = max(len(mode.name) for mode in modes)
    head = f"{'mode':<{width}}  {'eigenvalue, 1/s':>22}  {'rad/s':>9}  {'damping':>8}  {'period, s':>9}  {'half, s':>9}"
    rows = [
        f"{mode.name:<{width}}  {_eigenvalue(mode):>22}  {mode.natural_frequency:>9.4g}  {mode.damping_ratio:>8.4f}  "
        f"{_time(mode.period):>9}  {_time(mode.time_to_half):>9}"
        for mode in modes
    ]
    return [head, *rows, "half: time to half the amplitude; negative: minus the time to double"]


def _eigenvalue(mode: "Mode") -> str:
    value = mode.eigenvalue
    return f"{value.real:.5g} +- {value.imag:.5g}i" if mode.order == 2 else f"{value.real:.5g}"


def _time(seconds: float) -> str:
    return f"{seconds:.4g}" if math.isfinite(seconds) else "-"


def _entry(value: float) -> str:
    return "0" if abs(value) < _ROUNDING else f"{value:.5g}"


def _block(name: str, columns: tuple[str, ...], rows: tuple[str, ...], values: Iterable[Iterable[float]]) -> list[str]:
    """Fixed-width text, in as many pieces as the screen is wide."""
    cells = [[_entry(float(value)) for value in row] for row in values]
    first = max(len(name), *(len(row) for row in rows))
    widths = [max(len(column), *(len(row[k]) for row in cells)) for k, column in enumerate(columns)]
    lines, begin = [], 0
    while begin < len(columns):
        end, taken = begin, first
        while end < len(columns) and (end == begin or taken + 2 + widths[end] <= screen.width):
            taken += 2 + widths[end]
            end += 1
        lines += [""] if begin else []
        for label, row in [(name, list(columns)), *zip(rows, cells, strict=True)]:
            lines.append(f"{label:<{first}}" + "".join(f"  {row[k]:>{widths[k]}}" for k in range(begin, end)))
        begin = end
    return lines
