"""Commands about aircraft themselves: list, show, check, new."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from anser.aircraft_files.sources import AIRCRAFT_SCHEMA, DAVE_ML_SUFFIX, SUFFIXES, VARIANTS, write_airframe_starter
from anser.cli.app import help_epilog
from anser.cli.arguments import VariantName, complete_aircraft
from anser.cli.console import (
    RefusedError,
    activity,
    columns,
    must_be_known_aircraft,
    number,
    plain_table,
    print_document,
    print_line,
    print_note,
    print_problem,
    print_table,
)
from anser.cli.folders import Force, must_be_new_file, open_output_file
from anser.cli.scenario_files import write_starter_file

if TYPE_CHECKING:
    from collections.abc import Mapping

    from anser.aircraft_files.check_data import CheckedValue
    from anser.aircraft_files.findings import Finding
    from anser.dave_ml.definition import Variable


_Aircraft = Annotated[
    str,
    typer.Argument(
        help="Name of an airframe, or path of an aircraft file.", show_default=False, autocompletion=complete_aircraft
    ),
]
_PICTURES = (".png", ".svg", ".pdf")


@help_epilog("anser aircraft list", "anser aircraft list --json")
def list_() -> None:
    """List the airframes of the library and of entry points: mass, span, airspeeds of their data, surfaces."""
    from anser.analysis.airframes import list_airframes

    found = list_airframes()
    print_document(
        lambda: {
            "format_version": 1,
            "aircraft": [
                {
                    "name": one.name,
                    "origin": one.origin,
                    "mass_kg": one.mass_kg,
                    "span_m": one.span_m,
                    "airspeed_m_s": one.airspeed_m_s and list(one.airspeed_m_s),
                    "surfaces": list(one.surfaces),
                    "problem": one.problem,
                }
                for one in found
            ],
        }
    )
    table = plain_table(
        "aircraft",
        "name",
        *columns("mass kg", "span m", "airspeed m/s", justify="right"),
        *columns("surfaces", "from", overflow="fold"),
    )
    for one in found:
        speeds = "-" if one.airspeed_m_s is None else "{:g} to {:g}".format(*one.airspeed_m_s)
        surfaces = one.problem or ", ".join(one.surfaces)
        table.add_row(one.name, number(one.mass_kg, 1), number(one.span_m, 2), speeds, surfaces, one.origin)
    print_table(table)


@help_epilog("anser aircraft show aerosonde", "anser aircraft show my-uav.toml --out my-uav.png")
def show(
    aircraft: _Aircraft,
    variant: VariantName = "textbook",
    altitude_m: Annotated[float, typer.Option(help="Of the steady flights and the thrust.")] = 0.0,
    out: Annotated[
        Path | None, typer.Option(help="New file for a picture: coefficients, thrust, trim map; NAME.png, .svg, .pdf.")
    ] = None,
    force: Force = False,
) -> None:
    """Show an airframe: mass, geometry, surfaces, engine, where its data hold, and where it flies level."""
    must_be_known_aircraft(aircraft, variant)
    if out is not None:
        must_be_new_file("--out", out, _PICTURES, force)
    from anser.analysis.airframes import describe_airframe, find_aircraft_file, survey_airframe, trim_speed_range
    from anser.analysis.trim_points import airframe_label, resolve_airframe

    airframe, of = resolve_airframe(aircraft, variant)
    rows, file = describe_airframe(airframe), find_aircraft_file(aircraft)
    with activity("trimming"):
        dataset = survey_airframe(aircraft, variant, altitude_m=altitude_m)
    speeds = trim_speed_range(dataset)
    flown = "at no airspeed looked at" if speeds is None else f"{speeds[0]:.3g} to {speeds[1]:.3g}"
    rows.append((f"level flight at {altitude_m:g} m", flown, "" if speeds is None else "m/s, within all limits"))
    if out is not None:
        from anser.report.airframe_figures import draw_airframe

        with open_output_file("--out", out, force) as picture:
            draw_airframe(dataset, picture)
    print_document(
        lambda: {
            "format_version": 1,
            **of,
            "source": None if file is None else file.source,
            "assumed": None if file is None else file.assumed,
            "quantities": [{"name": name, "value": value, "unit": unit} for name, value, unit in rows],
            "level_flight_m_s": None if speeds is None else list(speeds),
        }
    )
    table = plain_table(airframe_label(of), "quantity", *columns("value", justify="right"), "unit")
    for row in rows:
        table.add_row(*row)
    print_table(table)
    if file is not None:
        print_line(f"source: {file.source}")
        if file.assumed:
            print_line(f"assumed: {file.assumed}")
    if out is not None:
        print_note(f"{out}: written")


@help_epilog(
    "anser aircraft check my-uav.toml",
    "anser aircraft check aerosonde --json",
    "anser aircraft check f16 --variant tp1538",
    "anser aircraft check my-aero.dml",
    unmet="check data disagree, or something is probably not meant so",
)
def check(aircraft: _Aircraft, variant: VariantName = "textbook") -> None:
    """Compute an aircraft file's own check data, and look for what is probably wrong in it: signs, units, tables.

    Of an aircraft by DAVE-ML the check data of its files come first; of the F-16 there are tables alone. A DAVE-ML file
    (.dml) is checked by itself; where it has no check data, its inputs and outputs are listed.
    """
    must_be_known_aircraft(aircraft, variant)
    from anser.analysis.airframes import check_airframe, check_dave_ml, find_aircraft_file

    if Path(aircraft).suffix == DAVE_ML_SUFFIX:
        with activity("computing"):
            model = check_dave_ml(aircraft)
        signals = {"inputs": model.inputs, "outputs": model.outputs}
        _report(Path(aircraft).name, aircraft, model.checked_values, model.findings, signals)
        return

    if find_aircraft_file(aircraft) is None and aircraft not in VARIANTS:
        words = "an aircraft file, or the name of one of the library or of the F-16"
        raise RefusedError(f"AIRCRAFT: arrived {aircraft!r}, an airframe in code; expected {words}")
    with activity("computing"):
        compared, findings = check_airframe(aircraft, variant)
    name = Path(aircraft).stem if aircraft not in VARIANTS else f"{aircraft} ({variant})"
    _report(name, aircraft, compared, findings, {})


def _report(
    name: str,
    aircraft: str,
    checked_values: "tuple[CheckedValue, ...]",
    findings: "tuple[Finding, ...]",
    signals: "Mapping[str, tuple[Variable, ...]]",
) -> None:
    """Answer with check data and findings; `signals` are the inputs and outputs of a DAVE-ML file by itself."""
    wrong = [one for one in checked_values if not one.passed]
    print_document(
        lambda: {
            "format_version": 1,
            "aircraft": name,
            "checks": [
                {
                    "place": one.location,
                    "name": one.name,
                    "unit": one.unit,
                    "expected": one.expected,
                    "obtained": one.obtained,
                    "tolerance": one.tolerance,
                    "agrees": one.passed,
                }
                for one in checked_values
            ],
            "findings": [{"place": one.location, "text": one.text} for one in findings],
            **{
                key: [{"name": one.name, "id": one.id, "units": one.units, "usual": one.initial} for one in variables]
                for key, variables in signals.items()
            },
        }
    )
    print_line(_count(name, checked_values, wrong))
    if not checked_values:
        for key, variables in signals.items():
            listed = [f"{one.name} ({', '.join(filter(None, (one.id, one.units)))})" for one in variables]
            print_line(f"{key}: {', '.join(listed) or 'none'}")
    for one in wrong:
        print_problem(_disagreement_text(one))
    if wrong and Path(aircraft).suffix in (*SUFFIXES, DAVE_ML_SUFFIX):
        print_problem("check data belong to the data of the file: change or delete them with these")
    for one in findings:
        print_problem(str(one))
    if wrong or findings:
        raise typer.Exit(1)
    print_line("nothing found that looks wrong")


def _count(name: str, checked_values: "tuple[CheckedValue, ...]", wrong: "list[CheckedValue]") -> str:
    if not checked_values:
        return f"{name}: there are no check data"
    return f"{name}: {len(checked_values) - len(wrong)} of {len(checked_values)} numbers of its check data agree"


def _disagreement_text(one: "CheckedValue") -> str:
    return (
        f"{one.location} ({one.name}): expected {one.expected:.10g} {one.unit}, obtained {one.obtained:.10g}, "
        f"tolerance {one.tolerance:.2g}"
    )


@help_epilog("anser aircraft new my-uav.toml")
def new(
    path: Annotated[Path, typer.Argument(help="New file to write.", show_default=False)],
) -> None:
    """Write an aircraft file to start from, with comments: a valid one, that of a small aircraft."""
    write_starter_file(path, write_airframe_starter, AIRCRAFT_SCHEMA, "anser aircraft check")
