"""Commands step and gallery: step tests of the autopilot."""

import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from anser.cli.app import help_epilog
from anser.cli.arguments import AircraftName, Inversion, VariantName
from anser.cli.console import (
    InputError,
    activity,
    columns,
    fail_if_any,
    flight_point,
    must_be_known_aircraft,
    number,
    print_document,
    print_line,
    print_note,
    print_table,
    refuse_on,
    trim_progress,
)
from anser.cli.folders import Force, must_be_new_file, note_if_written, open_output_folder, write_if_requested

if TYPE_CHECKING:
    from anser.analysis.step_tests import StepTest, StepTestResult


@help_epilog(
    "anser step --loop velocity --channel chi --size 20 --at 150,1000",
    "anser step --loop rates --channel q --size -5 --at 150,2000 --out pitch.svg",
    "anser step --aircraft aerosonde --loop attitude --channel mu --size 30 --at 25,300",
    unmet="no steady flight at this condition",
)
def step(
    loop: Annotated[Literal["rates", "attitude", "velocity"], typer.Option(help="Which loop is commanded.")],
    channel: Annotated[
        list[str],
        typer.Option(help="Of that loop: p, q, r; mu, alpha, beta; v, gamma, chi. May be given several times."),
    ],
    size: Annotated[list[float], typer.Option(help="Of the step, deg/s, deg or m/s; one for each channel.")],
    at: Annotated[
        str,
        typer.Option(
            help="SPEED,ALTITUDE of the level trim that is left, m/s and m; cas:140,1000, eas:140,1000 or "
            "mach:0.4,1000 for calibrated or equivalent airspeed or the Mach number."
        ),
    ],
    duration_s: Annotated[
        float | None,
        typer.Option(
            help="How long; left out: 3, 6 or 60 s (rates, attitude, velocity), 1.05 s for a yaw rate; longer "
            "where an aircraft has slower loops than the F-16."
        ),
    ] = None,
    inversion: Inversion = "model",
    aircraft: AircraftName = "f16",
    variant: VariantName = "textbook",
    out: Annotated[Path | None, typer.Option(help="New picture of the response: NAME.svg, .png or .pdf.")] = None,
    force: Force = False,
) -> None:
    """Command a step to one loop and measure rise, settling, overshoot, final error, coupling and surface use.

    The F-16 flies with the published gains, other aircraft with derived gains and limits.
    """
    must_be_known_aircraft(aircraft, variant)
    speed_m_s, altitude_m = flight_point(at)
    must_be_new_file("--out", out, force=force)
    if len(channel) != len(size):
        raise InputError(f"--size: arrived {len(size)} for {len(channel)} channels; expected one for each --channel")
    if len(set(channel)) != len(channel):
        raise InputError(f"--channel: arrived {', '.join(channel)}; expected each at most once")
    from anser.analysis.step_flights import step_time_scale
    from anser.analysis.step_tests import step_document, step_test

    with refuse_on(ValueError, "--"):
        test = step_test(loop, dict(zip(channel, size, strict=True)), duration_s)
    if duration_s is None:
        with trim_progress("trimming"):
            time_scale = step_time_scale(aircraft, variant, speed_m_s, altitude_m)
        test = step_test(loop, dict(zip(channel, size, strict=True)), None, time_scale)
    flown = _fly([test], aircraft, variant, speed_m_s, altitude_m, inversion)
    from anser.report.aircraft_figures import draw_step

    write_if_requested("--out", out, force, lambda file: draw_step(flown[0].dataset, [file]))
    print_document(lambda: step_document(flown))
    _print_metrics(flown)
    if flown[0].left_tables:
        print_note("caution: it leaves the aerodynamic tables")
    note_if_written(out)


@help_epilog(
    "anser gallery --out gallery",
    "anser gallery --aircraft aerosonde --out gallery",
    unmet="a response does not meet its limits",
)
def gallery(
    out: Annotated[Path, typer.Option(help="New folder for the figures and metrics.json.")],
    inversion: Inversion = "model",
    aircraft: AircraftName = "f16",
    variant: VariantName = "textbook",
    force: Force = False,
    at: Annotated[
        str | None,
        typer.Option(
            help="SPEED,ALTITUDE of the level trim that the steps leave; left out: 150,1000 of the F-16, of another "
            "aircraft between its least and greatest airspeed."
        ),
    ] = None,
) -> None:
    """Fly every published autopilot test: a figure for each, an overview, and a table of metrics.

    Aircraft other than the F-16 use derived gains and limits, and step sizes within their capability.
    """
    must_be_known_aircraft(aircraft, variant)
    trim_point = None if at is None else flight_point(at)
    with open_output_folder(out, force) as into:
        from anser.analysis.step_flights import climb_and_turn, gallery_steps
        from anser.analysis.step_tests import step_document
        from anser.missions.runs import run
        from anser.report.aircraft_figures import draw_overview, draw_step, draw_tracking
        from anser.results.documents import write_json

        with trim_progress("trimming"):
            tests, (speed_m_s, altitude_m) = gallery_steps(aircraft, variant, trim_point)
        flown = _fly(tests, aircraft, variant, speed_m_s, altitude_m, inversion)
        with trim_progress("flying the climb-and-turn"):
            tracked = run(climb_and_turn(variant, inversion, aircraft, (speed_m_s, altitude_m)))
        requirements = tracked.summary["requirements"]
        document = step_document(flown) | {"climb_and_turn": requirements}
        write_json(document, into / "metrics.json")

        def pictures(name: str) -> list[Path]:
            return [into / f"{name}{suffix}" for suffix in (".svg", ".png")]

        with activity("drawing"):
            for flight in flown:
                draw_step(flight.dataset, pictures(flight.test.key))
            draw_overview([flight.dataset for flight in flown], pictures("overview"))
            heading = f"Climb and turn on velocity commands alone: {_name(flown)}, {inversion} inversion"
            draw_tracking(tracked.dataset, heading, pictures("climb-and-turn"))
    print_document(lambda: document)
    _print_metrics(flown)
    limits = document["limits"]
    shortfalls = [(flight.test.key, line) for flight in flown for line in flight.shortfalls]
    print_line(
        f"{len(flown) - len({key for key, _ in shortfalls})} of {len(flown)} within overshoot "
        f"{limits['overshoot_percent']:g} %, final error {limits['final_error_percent']:g} %, sideslip "
        f"{limits['sideslip_in_velocity_steps_deg']:g} deg in velocity steps; figures in {out}"
    )
    by_name = {requirement["name"]: requirement for requirement in requirements}
    error, miss = by_name["position_error_max_m"], by_name["miss_max_m"]
    print_line(
        f"climb and turn: position error {number(error['value'], 2)} m at most, {number(miss['value'], 2)} m at the "
        f"end; {error['limit']:g} m are allowed"
    )
    shortfalls += [
        ("climb-and-turn", f"{r['name']} is {r['value']:g}, not {r['limit']:g}") for r in requirements if not r["met"]
    ]
    fail_if_any(f"falls short: {key}: {reason}" for key, reason in shortfalls)


def _fly(
    tests: Sequence["StepTest"], aircraft: str, variant: str, speed_m_s: float, altitude_m: float, inversion: Inversion
) -> tuple["StepTestResult", ...]:
    from anser.analysis.step_flights import fly_steps

    with trim_progress("flying") as tell:
        condition = {"speed_m_s": speed_m_s, "altitude_m": altitude_m}
        options: dict[str, Any] = {"inversion": inversion, "progress": lambda loop: tell(f"flying the {loop} loop")}
        return fly_steps(tests, aircraft=aircraft, variant=variant, **condition, **options)


def _name(flights: Sequence["StepTestResult"]) -> str:
    from anser.analysis.trim_points import airframe_label

    return airframe_label(flights[0].dataset.attrs)


def _title(flights: Sequence["StepTestResult"]) -> str:
    condition = flights[0].dataset.attrs
    point = f"{condition['speed_m_s']:g} m/s, {condition['altitude_m']:g} m"
    return f"{_name(flights)} at {point}: {condition['inversion']} inversion"


def _print_metrics(flights: Sequence["StepTestResult"]) -> None:
    rows, styles = [], []
    for flight in flights:
        document = flight.document()
        coupling = ", ".join(
            f"{channel} {_short(entry['greatest'])} {entry['unit']}" for channel, entry in document["coupling"].items()
        )
        surfaces = ", ".join(number(value, 0) for value in document["surface_use_percent"].values())
        # values of the whole response appear in its first row only
        shared_cells = [document["key"], coupling, document["sideslip_max_deg"], surfaces]
        for channel, entry in document["channels"].items():
            key, *other_cells = shared_cells
            names = ("rise_time_s", "settling_time_s", "overshoot_percent", "final_error_percent")
            size = f"{entry['size']:+g} {entry['unit']}"
            rows.append([key, channel, size, *(entry[name] for name in names), *other_cells])
            styles.append("red" if document["shortfalls"] else None)
            shared_cells = [""] * 4
    headings = [
        *columns("step\n", "channel\n", no_wrap=True),
        *columns("size\n", "rise\ns", "settling\ns", "overshoot\n%", "final error\n%", justify="right", digits=2),
        *columns("others move\nat most"),
        *columns("sideslip\ndeg", _surfaces_used(flights[0]), justify="right", digits=2),
    ]
    print_table(_title(flights), headings, rows, styles)


def _surfaces_used(flight: "StepTestResult") -> str:
    """Return the column heading for the use of the control surfaces, with their names, in lines of 20 characters."""
    names = [name.replace("_", " ") for name in flight.document()["surface_use_percent"]]
    return textwrap.fill(f"{', '.join(names)} used, %", 20)


def _short(value: float | None) -> str:
    return "<0.01" if value is not None and value < 0.01 else number(value, 2)
