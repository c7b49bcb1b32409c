"""Commands for steady flight: trim, linearize, deep-stall."""

import math
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from anser.cli.app import help_epilog
from anser.cli.arguments import (
    AircraftName,
    Altitude,
    CalibratedAirspeed,
    CentreOfGravity,
    EquivalentAirspeed,
    MachNumber,
    PathAngle,
    TrueAirspeed,
    TurnRate,
    VariantName,
)
from anser.cli.console import (
    InputError,
    activity,
    columns,
    end_without_result,
    must_be_flight_condition,
    must_be_in_range,
    must_be_known_aircraft,
    print_document,
    print_line,
    print_table,
    screen,
    trim_progress,
    true_airspeed_of,
)
from anser.cli.folders import Force, must_be_new_file, note_if_written, write_if_requested
from anser.constants import STEP_MAX_S, STEP_MIN_S
from anser.environment.air import AIRSPEED_FORMS

if TYPE_CHECKING:
    from anser.analysis.linear_models import LinearizationResult
    from anser.analysis.modes import Mode


@help_epilog(
    "anser trim --speed-m-s 150 --altitude-m 1000",
    "anser trim --speed-m-s 150 --altitude-m 1000 --turn-rate-deg-s 5 --json",
    "anser trim --speed-m-s 153 --altitude-m 0 --cg 0.35 --pitch-rate-deg-s 10",
    unmet="no steady flight at this condition",
)
def trim(
    altitude_m: Altitude,
    speed_m_s: TrueAirspeed = None,
    speed_cas_m_s: CalibratedAirspeed = None,
    speed_eas_m_s: EquivalentAirspeed = None,
    mach: MachNumber = None,
    aircraft: AircraftName = "f16",
    variant: VariantName = "textbook",
    cg: CentreOfGravity = None,
    path_angle_deg: PathAngle = 0.0,
    turn_rate_deg_s: TurnRate = 0.0,
    pitch_rate_deg_s: Annotated[
        float, typer.Option(help="Pitch rate of a pull-up: wings level, no roll and yaw rate; not in a turn.")
    ] = 0.0,
) -> None:
    """Find the steady flight at a condition, or report the limiting quantity and the nearest steady flight."""
    must_be_known_aircraft(aircraft, variant, cg=cg)
    airspeeds = dict(zip(AIRSPEED_FORMS, (speed_m_s, speed_cas_m_s, speed_eas_m_s, mach), strict=True))
    condition: dict[str, Any] = {
        "speed_m_s": true_airspeed_of(altitude_m, airspeeds),
        "altitude_m": altitude_m,
        "path_angle_deg": path_angle_deg,
        "turn_rate_deg_s": turn_rate_deg_s,
        "pitch_rate_deg_s": pitch_rate_deg_s,
    }
    must_be_flight_condition(condition | {"cg": cg})
    from anser.aircraft.f16 import F16
    from anser.analysis.trim_points import airframe_label, resolve_airframe
    from anser.analysis.trim_points import trim as solve

    airframe, identity = resolve_airframe(aircraft, variant, cg)
    x_cg = {"x_cg_over_c": float(airframe.x_cg)} if isinstance(airframe, F16) else {}
    with activity("solving"):
        point = solve(airframe, **condition)
    if point.diagnosis is not None:
        end_without_result("no steady flight", [point.diagnosis])
    quantities = [{"name": name, "value": value, "unit": unit or "1"} for name, value, unit in point.quantities]
    print_document(lambda: {"format_version": 1, **identity, **x_cg, **condition, "quantities": quantities})
    title = f"{airframe_label(identity)} at {condition['speed_m_s']:g} m/s, {altitude_m:g} m"
    headings = [*columns("quantity"), *columns("value", justify="right", digits=4), *columns("unit")]
    cg_rows = [("centre of gravity", value, "of chord") for value in x_cg.values()]
    print_table(title, headings, [*cg_rows, *point.quantities])


_SUFFIXES = (".nc", ".json")
_ROUNDING = 1e-12
"""Matrix entries of smaller magnitude are rounding errors of terms that cancel; they are printed as 0."""


@help_epilog(
    "anser linearize --speed-m-s 150 --altitude-m 1000",
    "anser linearize --speed-m-s 150 --altitude-m 1000 --loop attitude --out model.nc",
    unmet="no steady flight at this condition",
)
def linearize(
    altitude_m: Altitude,
    speed_m_s: TrueAirspeed = None,
    speed_cas_m_s: CalibratedAirspeed = None,
    speed_eas_m_s: EquivalentAirspeed = None,
    mach: MachNumber = None,
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
    """Trim an aircraft and linearize it: A, B, C, D and the named modes, in SI units and radians."""
    must_be_known_aircraft(aircraft, variant, cg=x_cg)
    airspeeds = dict(zip(AIRSPEED_FORMS, (speed_m_s, speed_cas_m_s, speed_eas_m_s, mach), strict=True))
    condition: dict[str, Any] = {
        "speed_m_s": true_airspeed_of(altitude_m, airspeeds),
        "altitude_m": altitude_m,
        "path_angle_deg": path_angle_deg,
        "turn_rate_deg_s": turn_rate_deg_s,
        "path_rate_deg_s": path_rate_deg_s,
        "pitch_rate_deg_s": pitch_rate_deg_s,
    }
    must_be_flight_condition(condition | {"x_cg": x_cg})
    must_be_in_range("--step-s", step_s, STEP_MIN_S, STEP_MAX_S)
    if actuators and loop != "open":
        raise InputError(f"--actuators: arrived with --loop {loop}, which always has them; expected --loop open")
    must_be_new_file("--out", out, _SUFFIXES, force)
    from anser.analysis.linear_models import linearize as compute

    with trim_progress("trimming and differentiating"):
        linearization = compute(
            aircraft, variant, x_cg_over_c=x_cg, loop=loop, actuators=actuators, step_s=step_s, **condition
        )
    write_if_requested("--out", out, force, linearization.write)
    print_document(linearization.document)
    _print_model(linearization)
    note_if_written(out)


def _print_model(linearization: "LinearizationResult") -> None:
    from anser.analysis.trim_points import airframe_label

    model, condition = linearization.model, linearization.condition
    label = airframe_label(condition)
    if "x_cg_over_c" in condition:
        label = f"{label.removesuffix(')')}, centre of mass {condition['x_cg_over_c']:.3g})"
    is_sampled = float(model.step) > 0
    kind = f"{condition['loop']} loop, sampled every {float(model.step):g} s" if is_sampled else "open loop"
    lines = [
        f"{label} at {condition['speed_m_s']:g} m/s, {condition['altitude_m']:g} m: {kind}",
        "SI units and radians; power in percent",
        "",
        *_mode_lines(linearization.modes),
        "",
        *_block("condition", ("value",), model.states + model.inputs, [[v] for v in [*model.x, *model.u]]),
        "",
        *_block("A", model.states, model.states, model.A),
        "",
        *_block("B", model.inputs, model.states, model.B),
    ]
    for text in lines:
        print_line(text)


def _mode_lines(modes: tuple["Mode", ...]) -> list[str]:
    width = max(len(mode.name) for mode in modes)
    head = f"{'mode':<{width}}  {'eigenvalue, 1/s':>22}  {'rad/s':>9}  {'damping':>8}  {'period, s':>9}  {'half, s':>9}"
    mode_rows = [
        f"{mode.name:<{width}}  {_eigenvalue(mode):>22}  {mode.natural_frequency:>9.4g}  {mode.damping_ratio:>8.4f}  "
        f"{_time(mode.period):>9}  {_time(mode.time_to_half):>9}"
        for mode in modes
    ]
    return [head, *mode_rows, "half: time to half the amplitude; negative: minus the time to double"]


def _eigenvalue(mode: "Mode") -> str:
    value = mode.eigenvalue
    return f"{value.real:.5g} +- {value.imag:.5g}i" if mode.order == 2 else f"{value.real:.5g}"


def _time(seconds: float) -> str:
    return f"{seconds:.4g}" if math.isfinite(seconds) else "-"


def _entry(value: float) -> str:
    return "0" if abs(value) < _ROUNDING else f"{value:.5g}"


def _block(
    name: str, columns: tuple[str, ...], quantities: tuple[str, ...], values: Iterable[Iterable[float]]
) -> list[str]:
    """Return a matrix as lines of text, divided into blocks of columns that fit the screen.

    `columns` and `quantities` are the labels of columns and rows, `name` is the heading of the row labels.
    """
    cells = [[_entry(float(value)) for value in entries] for entries in values]
    label_width = max(len(name), *(len(entries) for entries in quantities))
    widths = [max(len(column), *(len(entries[k]) for entries in cells)) for k, column in enumerate(columns)]
    lines, start = [], 0
    while start < len(columns):
        end, line_width = start, label_width
        while end < len(columns) and (end == start or line_width + 2 + widths[end] <= screen.width):
            line_width += 2 + widths[end]
            end += 1
        lines += [""] if start else []
        for label, entries in [(name, list(columns)), *zip(quantities, cells, strict=True)]:
            lines.append(f"{label:<{label_width}}" + "".join(f"  {entries[k]:>{widths[k]}}" for k in range(start, end)))
        start = end
    return lines


_AIRCRAFT = "f16"


@help_epilog(
    "anser deep-stall",
    "anser deep-stall --cg 0.36 --cg 0.365 --cg 0.37 --picture deep-stall.svg",
    "anser deep-stall --elevator-deg 20 --json",
)
def deep_stall(
    variant: VariantName = "tp1538",
    cg: Annotated[
        list[float] | None,
        typer.Option("--cg", "--x-cg", help="Centre of gravity, fraction of the chord; may be given several times."),
    ] = None,
    elevator_deg: Annotated[
        float | None, typer.Option(help="Elevator that is held; left out: fully nose-down.")
    ] = None,
    alpha_from_deg: Annotated[float, typer.Option(help="Least angle of attack that is looked at.")] = 20.0,
    altitude_m: Annotated[float, typer.Option(help="Of the steady descents in the trims.")] = 5000.0,
    picture: Annotated[
        Path | None, typer.Option(help="New picture of Cm against alpha and of the trims: NAME.svg, .png or .pdf.")
    ] = None,
    force: Force = False,
) -> None:
    """Find pitch trims beyond the stall with the elevator held, and follow them as the centre of gravity moves."""
    must_be_known_aircraft(_AIRCRAFT, variant)
    for x_cg in cg or ():
        must_be_in_range("--cg", x_cg, 0.1, 0.5)
    must_be_in_range("--alpha-from-deg", alpha_from_deg, -20.0, 89.0)
    must_be_in_range("--altitude-m", altitude_m, 0.0, 15000.0)
    must_be_new_file("--picture", picture, force=force)
    from anser.analysis.deep_stalls import CENTRES_OF_GRAVITY, deep_stall_document
    from anser.analysis.deep_stalls import deep_stall as compute

    with activity("following the trims"):
        try:
            condition = {"elevator_deg": elevator_deg, "alpha_from_deg": alpha_from_deg, "altitude_m": altitude_m}
            dataset = compute(variant, x_cg_over_c=cg or CENTRES_OF_GRAVITY, **condition)
        except ValueError as error:
            raise InputError(f"--{str(error).replace('_', '-')}") from None
    from anser.report.aircraft_figures import draw_deep_stall

    write_if_requested("--picture", picture, force, lambda file: draw_deep_stall(dataset, [file]))
    document = deep_stall_document(dataset)
    print_document(lambda: document)
    rows = []
    for entry in document["trims"]:
        stability = "stable" if entry["stable"] else "unstable"
        angles = [entry["speed_m_s"], entry["path_angle_deg"], entry["pitch_deg"]]
        rows.append([f"{entry['x_cg_over_c']:.4g}", entry["alpha_deg"], stability, *angles])
    print_table(
        f"{_AIRCRAFT} ({variant}), elevator {dataset.attrs['elevator_deg']:g} deg: pitch trims beyond "
        f"{alpha_from_deg:g} deg; descents at {altitude_m:g} m, idle",
        [
            *columns("c.g., of chord", "alpha, deg", justify="right", digits=2),
            *columns("in pitch"),
            *columns("airspeed, m/s", "path angle, deg", "pitch angle, deg", justify="right", digits=1),
        ],
        rows,
    )
    for entry in document["greatest_pitching_moment"]:
        print_line(
            f"c.g. at {entry['x_cg_over_c']:.4g}: Cm is {entry['pitching_moment']:+.4f} at most, "
            f"at alpha {entry['alpha_deg']:.4g} deg"
        )
    if document["appears"] is not None:
        onset = document["appears"]
        print_line(
            f"A trim appears with the c.g. at {onset['x_cg_over_c']:.4f}, at alpha {onset['alpha_deg']:.1f} deg."
        )
    note_if_written(picture)
