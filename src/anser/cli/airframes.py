"""Commands about aircraft themselves: list, show, check, new."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from anser.cli.arguments import VariantName, complete_aircraft
from anser.cli.console import (
    RefusedError,
    answer,
    columns,
    line,
    must_be_known,
    number,
    plain_table,
    print_table,
    problem,
    say,
    working,
)
from anser.cli.offering import about
from anser.cli.output_folder import Force, must_be_new_file, written_file
from anser.cli.scenario_files import start
from anser.scenario import VARIANTS
from anser.scenario.airframe_file import DAVE_ML_SUFFIX, SUFFIXES, write_airframe_starter
from anser.scenario.airframe_file.template import AIRCRAFT_SCHEMA

if TYPE_CHECKING:
    from collections.abc import Mapping

    from anser.dave_ml import Variable
    from anser.scenario.airframe_file.checking import Compared
    from anser.scenario.airframe_file.linting import Finding

_Aircraft = Annotated[
    str,
    typer.Argument(
        help="Name of an airframe, or path of an aircraft file.", show_default=False, autocompletion=complete_aircraft
    ),
]
_PICTURES = (".png", ".svg", ".pdf")


@about("anser aircraft list", "anser aircraft list --json")
def list_() -> None:
    """List the airframes of the library and of entry points: mass, span, airspeeds of their data, surfaces."""
    from anser.execution import list_airframes

    found = list_airframes()
    answer(
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


@about("anser aircraft show aerosonde", "anser aircraft show my-uav.toml --out my-uav.png")
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
    must_be_known(aircraft, variant)
    if out is not None:
        must_be_new_file("--out", out, _PICTURES, force)
    from anser.execution import airframe_of, described_airframe, file_of, name_of, survey_airframe, trimmed_speeds

    airframe, of = airframe_of(aircraft, variant)
    rows, file = described_airframe(airframe), file_of(aircraft)
    with working("trimming"):
        dataset = survey_airframe(aircraft, variant, altitude_m=altitude_m)
    speeds = trimmed_speeds(dataset)
    flown = "at no airspeed looked at" if speeds is None else f"{speeds[0]:.3g} to {speeds[1]:.3g}"
    rows.append((f"level flight at {altitude_m:g} m", flown, "" if speeds is None else "m/s, within all limits"))
    if out is not None:
        from anser.report import draw_airframe

        with written_file("--out", out, force) as picture:
            draw_airframe(dataset, picture)
    answer(
        lambda: {
            "format_version": 1,
            **of,
            "source": None if file is None else file.source,
            "assumed": None if file is None else file.assumed,
            "quantities": [{"name": name, "value": value, "unit": unit} for name, value, unit in rows],
            "level_flight_m_s": None if speeds is None else list(speeds),
        }
    )
    table = plain_table(name_of(of), "quantity", *columns("value", justify="right"), "unit")
    for row in rows:
        table.add_row(*row)
    print_table(table)
    if file is not None:
        line(f"source: {file.source}")
        if file.assumed:
            line(f"assumed: {file.assumed}")
    if out is not None:
        say(f"{out}: written")


@about(
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
    must_be_known(aircraft, variant)
    from anser.execution import check_airframe, check_dave_ml, file_of

    if Path(aircraft).suffix == DAVE_ML_SUFFIX:
        with working("computing"):
            model = check_dave_ml(aircraft)
        signals = {"inputs": model.inputs, "outputs": model.outputs}
        _report(Path(aircraft).name, aircraft, model.compared, model.findings, signals)
        return

    if file_of(aircraft) is None and aircraft not in VARIANTS:
        words = "an aircraft file, or the name of one of the library or of the F-16"
        raise RefusedError(f"AIRCRAFT: arrived {aircraft!r}, an airframe in code; expected {words}")
    with working("computing"):
        compared, findings = check_airframe(aircraft, variant)
    name = Path(aircraft).stem if aircraft not in VARIANTS else f"{aircraft} ({variant})"
    _report(name, aircraft, compared, findings, {})


def _report(
    name: str,
    aircraft: str,
    compared: "tuple[Compared, ...]",
    findings: "tuple[Finding, ...]",
    signals: "Mapping[str, tuple[Variable, ...]]",
) -> None:
    """Answer with check data and findings; `signals` are the inputs and outputs of a DAVE-ML file by itself."""
    wrong = [one for one in compared if not one.agrees]
    answer(
        lambda: {
            "format_version": 1,
            "aircraft": name,
            "checks": [
                {
                    "place": one.place,
                    "name": one.name,
                    "unit": one.unit,
                    "expected": one.expected,
                    "obtained": one.obtained,
                    "tolerance": one.tolerance,
                    "agrees": one.agrees,
                }
                for one in compared
            ],
            "findings": [{"place": one.place, "text": one.text} for one in findings],
            **{
                key: [{"name": one.name, "id": one.id, "units": one.units, "usual": one.initial} for one in variables]
                for key, variables in signals.items()
            },
        }
    )
    line(_count(name, compared, wrong))
    if not compared:
        for key, variables in signals.items():
            listed = [f"{one.name} ({', '.join(filter(None, (one.id, one.units)))})" for one in variables]
            line(f"{key}: {', '.join(listed) or 'none'}")
    for one in wrong:
        problem(_disagrees(one))
    if wrong and Path(aircraft).suffix in (*SUFFIXES, DAVE_ML_SUFFIX):
        problem("check data belong to the data of the file: change or delete them with these")
    for one in findings:
        problem(str(one))
    if wrong or findings:
        raise typer.Exit(1)
    line("nothing found that looks wrong")


def _count(name: str, compared: "tuple[Compared, ...]", wrong: "list[Compared]") -> str:
    if not compared:
        return f"{name}: there are no check data"
    return f"{name}: {len(compared) - len(wrong)} of {len(compared)} numbers of its check data agree"


def _disagrees(one: "Compared") -> str:
    return (
        f"{one.place} ({one.name}): expected {one.expected:.10g} {one.unit}, obtained {one.obtained:.10g}, "
        f"tolerance {one.tolerance:.2g}"
    )


@about("anser aircraft new my-uav.toml")
def new(
    path: Annotated[Path, typer.Argument(help="New file to write.", show_default=False)],
) -> None:
    """Write an aircraft file to start from, with comments: a valid one, that of a small aircraft."""
    start(path, write_airframe_starter, AIRCRAFT_SCHEMA, "anser aircraft check")
