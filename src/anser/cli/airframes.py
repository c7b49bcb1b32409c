"""Commands about airframes: aircraft list, aircraft show, aircraft check, aircraft new."""

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from anser.aircraft_files.sources import AIRCRAFT_SCHEMA, DAVE_ML_SUFFIX, SUFFIXES, VARIANTS, write_airframe_starter
from anser.cli.app import help_epilog
from anser.cli.arguments import VariantName, complete_aircraft
from anser.cli.console import (
    InputError,
    activity,
    columns,
    fail_if_any,
    must_be_in_range,
    must_be_known_aircraft,
    print_document,
    print_line,
    print_table,
)
from anser.cli.folders import Force, must_be_new_file, note_if_written, write_if_requested
from anser.cli.scenario_files import write_starter_file

if TYPE_CHECKING:
    from collections.abc import Mapping

    from anser.aircraft_files.check_data import CheckedValue
    from anser.aircraft_files.findings import Finding
    from anser.dave_ml.definition import Variable


_Aircraft = Annotated[
    str, typer.Argument(help="Name of an airframe, or path of an aircraft file.", autocompletion=complete_aircraft)
]


@help_epilog("anser aircraft list", "anser aircraft list --json")
def list_() -> None:
    """List the airframes of the library and of installed packages (entry points): mass, span, airspeeds, surfaces."""
    from anser.analysis.airframes import list_airframes

    listed = list_airframes()
    print_document(lambda: {"format_version": 1, "aircraft": [dataclasses.asdict(airframe) for airframe in listed]})
    headings = [
        *columns("name"),
        *columns("mass kg", justify="right", digits=1),
        *columns("span m", "airspeed m/s", justify="right", digits=2),
        *columns("surfaces", "from", overflow="fold"),
    ]
    rows = []
    for airframe in listed:
        speeds = airframe.airspeed_m_s and "{:g} to {:g}".format(*airframe.airspeed_m_s)
        surfaces = airframe.problem or ", ".join(airframe.surfaces)
        rows.append((airframe.name, airframe.mass_kg, airframe.span_m, speeds, surfaces, airframe.origin))
    print_table("aircraft", headings, rows)


@help_epilog("anser aircraft show aerosonde", "anser aircraft show my-uav.toml --out my-uav.png")
def show(
    aircraft: _Aircraft,
    variant: VariantName = "textbook",
    altitude_m: Annotated[float, typer.Option(help="Of the steady flights and the thrust.")] = 0.0,
    performance: Annotated[
        bool,
        typer.Option(
            "--performance",
            help="The performance sheet instead: stall, level flight, climb, ceiling, glide, turns; the picture is the "
            "specific excess power.",
        ),
    ] = False,
    out: Annotated[
        Path | None, typer.Option(help="New file for a picture: coefficients, thrust, trim map; NAME.png, .svg, .pdf.")
    ] = None,
    force: Force = False,
) -> None:
    """Show an airframe: mass, geometry, surfaces, engine, range of validity, and airspeeds of level flight."""
    must_be_known_aircraft(aircraft, variant, "AIRCRAFT")
    must_be_new_file("--out", out, force=force)
    must_be_in_range("--altitude-m", altitude_m, 0.0, 20_000.0)
    if performance:
        _show_performance(aircraft, variant, altitude_m, out, force)
        return
    from anser.analysis.airframes import describe_airframe, find_aircraft_file, survey_airframe, trim_speed_range
    from anser.analysis.trim_points import airframe_label, resolve_airframe

    airframe, identity = resolve_airframe(aircraft, variant)
    quantities, file = describe_airframe(airframe), find_aircraft_file(aircraft)
    with activity("trimming"):
        dataset = survey_airframe(aircraft, variant, altitude_m=altitude_m)
    speed_range = trim_speed_range(dataset)
    level_speeds, unit = "at no airspeed looked at", ""
    if speed_range is not None:
        level_speeds, unit = f"{speed_range[0]:.3g} to {speed_range[1]:.3g}", "m/s, within all limits"
    quantities.append((f"level flight at {altitude_m:g} m", level_speeds, unit))
    from anser.report.aircraft_figures import draw_airframe

    write_if_requested("--out", out, force, lambda file: draw_airframe(dataset, file))
    print_document(
        lambda: {
            "format_version": 1,
            **identity,
            "source": None if file is None else file.source,
            "assumed": None if file is None else file.assumed,
            "quantities": [{"name": name, "value": value, "unit": unit} for name, value, unit in quantities],
            "level_flight_m_s": None if speed_range is None else list(speed_range),
        }
    )
    headings = [*columns("quantity"), *columns("value", justify="right"), *columns("unit")]
    print_table(airframe_label(identity), headings, quantities)
    if file is not None:
        print_line(f"source: {file.source}")
        if file.assumed:
            print_line(f"assumed: {file.assumed}")
    note_if_written(out)


def _show_performance(aircraft: str, variant: str, altitude_m: float, out: Path | None, force: bool) -> None:
    from anser.single_aircraft.model import aircraft as load_model

    with activity("trimming"):
        sheet = load_model(aircraft, variant).performance(altitude_m)
    from anser.report.style import save_figure

    write_if_requested("--out", out, force, lambda file: save_figure(sheet.plot(), [file]))
    print_document(sheet.document)
    headings = [
        *columns("figure"),
        *columns("value", justify="right", digits=2),
        *columns("unit"),
        *columns("limit", overflow="fold"),
    ]
    rows = [(figure.name, figure.value, figure.unit, figure.limit) for figure in sheet.figures]
    print_table(sheet.title, headings, rows)
    note_if_written(out)


@help_epilog(
    "anser aircraft check my-uav.toml",
    "anser aircraft check aerosonde --json",
    "anser aircraft check f16 --variant tp1538",
    "anser aircraft check my-aero.dml",
    unmet="check data disagree, or a value is probably wrong",
)
def check(aircraft: _Aircraft, variant: VariantName = "textbook") -> None:
    """Compare an aircraft file's check data with computed values, and look for probable errors: signs, units, tables.

    Check data are inputs of the aerodynamic model with the outputs that the publisher computed. For an aircraft by
    DAVE-ML, the check shots of its files are compared first; for the F-16, only the tables are examined. A DAVE-ML file
    (.dml) without check data has its inputs and outputs listed.
    """
    must_be_known_aircraft(aircraft, variant, "AIRCRAFT")
    from anser.analysis.airframes import check_airframe, check_dave_ml, find_aircraft_file

    if Path(aircraft).suffix == DAVE_ML_SUFFIX:
        with activity("computing"):
            model = check_dave_ml(aircraft)
        signals = {"inputs": model.inputs, "outputs": model.outputs}
        _report(Path(aircraft).name, aircraft, model.checked_values, model.findings, signals)
        return

    if find_aircraft_file(aircraft) is None and aircraft not in VARIANTS:
        expected = "an aircraft file, or the name of one of the library or of the F-16"
        raise InputError(f"AIRCRAFT: arrived {aircraft!r}, an airframe in code; expected {expected}")
    from anser.single_aircraft.model import aircraft as load_aircraft
    from anser.single_aircraft.model import surface_effects

    with activity("computing"):
        checked_values, findings = check_airframe(aircraft, variant)
        airframe = load_aircraft(aircraft, variant).airframe
        effects = dict(zip(airframe.actuators.names, surface_effects(airframe), strict=True))
    name = Path(aircraft).stem if aircraft not in VARIANTS else f"{aircraft} ({variant})"
    _report(name, aircraft, checked_values, findings, {}, effects)


def _report(
    name: str,
    aircraft: str,
    checked_values: "tuple[CheckedValue, ...]",
    findings: "tuple[Finding, ...]",
    signals: "Mapping[str, tuple[Variable, ...]]",
    effects: "Mapping[str, str] | None" = None,
) -> None:
    """Print an aircraft file's check data and findings; exit with code 1 if a check fails or a finding exists.

    `name` is printed, `aircraft` is the argument on the command line. `signals` are the inputs and outputs of a DAVE-ML
    file, empty for other files. `effects` says what a positive deflection of each surface does.
    """
    failed = [item for item in checked_values if not item.passed]
    print_document(
        lambda: {
            "format_version": 1,
            "aircraft": name,
            "checks": [
                {
                    "place": item.location,
                    "name": item.name,
                    "unit": item.unit,
                    "expected": item.expected,
                    "obtained": item.obtained,
                    "tolerance": item.tolerance,
                    "agrees": item.passed,
                }
                for item in checked_values
            ],
            "findings": [{"place": item.location, "text": item.text} for item in findings],
            **({"positive_deflections": dict(effects)} if effects else {}),
            **{key: [_signal_entry(item) for item in variables] for key, variables in signals.items()},
        }
    )
    print_line(_count(name, checked_values, failed))
    if effects:
        signs = ", ".join(f"{surface} {effect}" for surface, effect in effects.items())
        print_line(f"sign conventions, a positive deflection: {signs}")
    if not checked_values:
        for key, variables in signals.items():
            listed = [f"{item.name} ({', '.join(filter(None, (item.id, item.units)))})" for item in variables]
            print_line(f"{key}: {', '.join(listed) or 'none'}")
    problems = [_disagreement_text(item) for item in failed]
    if failed and Path(aircraft).suffix in (*SUFFIXES, DAVE_ML_SUFFIX):
        problems.append("check data belong to the data of the file: change or delete them with these")
    fail_if_any([*problems, *map(str, findings)])
    print_line("nothing found that looks wrong")


def _signal_entry(item: "Variable") -> dict[str, Any]:
    return {"name": item.name, "id": item.id, "units": item.units, "usual": item.initial}


def _count(name: str, checked_values: "tuple[CheckedValue, ...]", failed: "list[CheckedValue]") -> str:
    if not checked_values:
        return f"{name}: there are no check data"
    return f"{name}: {len(checked_values) - len(failed)} of {len(checked_values)} numbers of its check data agree"


def _disagreement_text(checked_value: "CheckedValue") -> str:
    return (
        f"{checked_value.location} ({checked_value.name}): expected {checked_value.expected:.10g} "
        f"{checked_value.unit}, obtained {checked_value.obtained:.10g}, tolerance {checked_value.tolerance:.2g}"
    )


@help_epilog("anser aircraft new my-uav.toml")
def new(path: Annotated[Path, typer.Argument(help="New file to write.")]) -> None:
    """Write a commented, valid aircraft file of a small aircraft as a starting point."""
    write_starter_file(path, write_airframe_starter, AIRCRAFT_SCHEMA, "anser aircraft check")
