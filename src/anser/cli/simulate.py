"""Command simulate: open-loop flight of one aircraft under given control inputs."""

import contextlib
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from anser.cli.app import help_epilog
from anser.cli.arguments import (
    Altitude,
    CalibratedAirspeed,
    CentreOfGravity,
    EquivalentAirspeed,
    MachNumber,
    PathAngle,
    TrueAirspeed,
    TurnRate,
    VariantName,
    complete_aircraft,
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
    print_note,
    print_table,
    refuse_on,
    true_airspeed_of,
)
from anser.cli.folders import Force, open_output_folder
from anser.constants import STEP_MAX_S, STEP_MIN_S
from anser.environment.air import AIRSPEED_FORMS, standard_layers

_SHOWN = (
    *("airspeed_m_s", "altitude_m", "alpha_deg", "beta_deg", "roll_deg", "pitch_deg", "yaw_deg"),
    *("roll_rate_deg_s", "pitch_rate_deg_s", "yaw_rate_deg_s", "load_factor"),
)
_COLUMNS = ("name", "start", "end", "least", "greatest")


@help_epilog(
    "anser simulate f16 --speed-m-s 150 --altitude-m 1000 --input elevator=doublet:1 --out runs/doublet",
    "anser simulate aerosonde --speed-m-s 25 --altitude-m 300 --input aileron=3211:2 --turbulence light",
    "anser simulate f16 --speed-m-s 150 --altitude-m 1000 --controls stick.csv --duration-s 30",
    unmet="no steady flight at the start",
)
def simulate(
    aircraft: Annotated[
        str, typer.Argument(help="Name of an airframe, or path of an aircraft file.", autocompletion=complete_aircraft)
    ],
    altitude_m: Altitude,
    speed_m_s: TrueAirspeed = None,
    speed_cas_m_s: CalibratedAirspeed = None,
    speed_eas_m_s: EquivalentAirspeed = None,
    mach: MachNumber = None,
    variant: VariantName = "textbook",
    cg: CentreOfGravity = None,
    path_angle_deg: PathAngle = 0.0,
    turn_rate_deg_s: TurnRate = 0.0,
    input_: Annotated[
        list[str] | None,
        typer.Option(
            "--input",
            help="NAME=SIGNAL:AMPLITUDE[:START_S[:WIDTH_S]], deg or throttle, added to the trim; signals: step, "
            "doublet, 3211. May be given once for each input.",
        ),
    ] = None,
    controls: Annotated[
        Path | None,
        typer.Option(help="CSV file with a column time_s and a column for each input: deg, and throttle 0 to 1."),
    ] = None,
    increments: Annotated[
        bool, typer.Option("--increments", help="The numbers of the CSV file are added to the trim.")
    ] = False,
    duration_s: Annotated[float, typer.Option(help="Length of the flight.")] = 20.0,
    step_s: Annotated[float, typer.Option(help="Period of integration and controls.")] = 0.01,
    record_period_s: Annotated[
        float | None, typer.Option(help="Period of the rows of flight.nc, a multiple of the step; without: every step.")
    ] = None,
    wind_m_s: Annotated[float, typer.Option(help="Wind speed.")] = 0.0,
    wind_from_deg: Annotated[float, typer.Option(help="Direction that the wind comes from.")] = 0.0,
    temperature_offset_k: Annotated[
        float, typer.Option(help="Temperature of the air above the standard atmosphere's.")
    ] = 0.0,
    turbulence: Annotated[
        Literal["none", "light", "moderate", "severe"], typer.Option(help="Intensity of the turbulence.")
    ] = "none",
    earth: Annotated[Literal["standard", "flat", "wgs84"], typer.Option(help="Model of the Earth.")] = "standard",
    seed: Annotated[int, typer.Option(help="Seed of the turbulence.")] = 0,
    out: Annotated[Path | None, typer.Option(help="New folder for flight.nc, flight.png and report.html.")] = None,
    force: Force = False,
) -> None:
    """Fly one aircraft in open loop from a trim, under control inputs; write its dataset, figure and report."""
    must_be_known_aircraft(aircraft, variant, "AIRCRAFT", cg)
    must_be_in_range("--temperature-offset-k", temperature_offset_k, -60.0, 60.0)
    atmosphere = {"temperature_offset_k": temperature_offset_k} if temperature_offset_k else None
    airspeeds = dict(zip(AIRSPEED_FORMS, (speed_m_s, speed_cas_m_s, speed_eas_m_s, mach), strict=True))
    speed_m_s = true_airspeed_of(altitude_m, airspeeds, standard_layers(temperature_offset_k))
    condition: dict[str, Any] = {"speed_m_s": speed_m_s, "altitude_m": altitude_m}
    condition |= {"path_angle_deg": path_angle_deg, "turn_rate_deg_s": turn_rate_deg_s}
    must_be_flight_condition(condition | {"cg": cg})
    must_be_in_range("--duration-s", duration_s, 0.01, 36_000.0)
    coarser = "; --record-period-s gives a coarser output"
    must_be_in_range("--step-s", step_s, STEP_MIN_S, STEP_MAX_S, coarser)
    if input_ and controls is not None:
        raise InputError("--controls: arrived with --input; expected one of the two")
    from anser.parts.input_signals import parse_signal
    from anser.results.dataset import value_range
    from anser.single_aircraft.flight import simulate as fly
    from anser.single_aircraft.model import aircraft as load_model

    model = load_model(aircraft, variant, x_cg_over_c=cg)
    signals: dict[str, Any] = {}
    for text in input_ or []:
        name, _, signal = text.partition("=")
        if name not in model.inputs or name in signals:
            expected = f"each input once, among {', '.join(model.inputs)}"
            raise InputError(f"--input {text}: arrived {name!r}; expected NAME=SIGNAL:AMPLITUDE, {expected}")
        with refuse_on(ValueError, f"--input {text}: "):
            signals[name] = parse_signal(signal)
    with contextlib.nullcontext() if out is None else open_output_folder(out, force) as folder:
        with activity("trimming"):
            trim = model.trim(**condition, atmosphere=atmosphere)
        if trim.diagnosis is not None:
            end_without_result("no steady flight", [trim.diagnosis])
        with activity("flying"), refuse_on(ValueError):
            flight = fly(
                model,
                trim,
                signals if controls is None else controls,
                duration_s=duration_s,
                step_s=step_s,
                record_period_s=record_period_s,
                increments=increments,
                wind={"speed_m_s": wind_m_s, "from_deg": wind_from_deg},
                atmosphere=atmosphere,
                turbulence=turbulence,
                earth=None if earth == "standard" else earth,
                seed=seed,
            )
        if folder is not None:
            flight.write_into(folder)
    dataset = flight.dataset
    figures = [dict(zip(_COLUMNS, (name, *value_range(dataset[name])), strict=True)) for name in _SHOWN]
    end, length_s = dataset.attrs["end"], float(dataset.time[-1])
    summary = {"controls": dataset.attrs["controls"], "end": end, "duration_s": length_s, "variables": figures}
    print_document(lambda: {"format_version": 1, **model.identity, **condition, **summary})
    headings = [*columns("variable"), *columns(*_COLUMNS[1:], justify="right", digits=3)]
    print_table(f"{aircraft}: {length_s:g} s, {end}", headings, [tuple(row.values()) for row in figures])
    if out is not None:
        print_note(f"{out}: flight.nc, flight.png, report.html")
