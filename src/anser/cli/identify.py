"""Command identify: estimates of an aircraft's parameters from a recorded flight."""

from pathlib import Path
from typing import Annotated, Literal

import typer

from anser.cli.app import help_epilog
from anser.cli.arguments import VariantName, complete_aircraft
from anser.cli.console import (
    InputError,
    activity,
    columns,
    must_be_known_aircraft,
    print_document,
    print_note,
    print_table,
    refuse_on,
)
from anser.cli.folders import Force, open_output_folder


@help_epilog(
    "anser identify runs/multisine --model derivatives --out runs/estimate",
    "anser identify runs/3211 --model short-period --validate runs/doublet --out runs/short-period",
    "anser identify flight-12.csv --map columns.toml --aircraft my-uav.toml --model lateral --out runs/lateral",
)
def identify(
    run: Annotated[Path, typer.Argument(help="Folder with flight.nc, or a NetCDF or CSV file of a recording.")],
    out: Annotated[Path, typer.Option(help="New folder for the dataset, the JSON document, the page and the figures.")],
    model: Annotated[
        Literal["short-period", "lateral", "derivatives"],
        typer.Option(help="Rates of alpha and q, rates of beta, p and r, or derivatives of an aircraft file."),
    ] = "derivatives",
    aircraft: Annotated[
        str | None,
        typer.Option(
            help="Aircraft with mass, inertia, lengths and engine: name, or path of an aircraft file; left out: that "
            "of the recording.",
            autocompletion=complete_aircraft,
        ),
    ] = None,
    variant: VariantName = "textbook",
    method: Annotated[
        Literal["frequency", "equation-error", "output-error", "filter-error"],
        typer.Option(
            help="Regression of Fourier transforms or in time; for linear models also maximum likelihood of their "
            "responses, without or with noise in the rates (turbulence)."
        ),
    ] = "frequency",
    validate: Annotated[Path | None, typer.Option(help="Recording of another manoeuvre, which is predicted.")] = None,
    map_: Annotated[
        Path | None,
        typer.Option("--map", help='TOML file of columns by names of the catalogue: alpha_deg = "AOA".'),
    ] = None,
    accelerometer_m: Annotated[
        str, typer.Option(help="X,Y,Z of the accelerometers relative to the centre of gravity, body axes, m.")
    ] = "0,0,0",
    window_s: Annotated[str | None, typer.Option(help="START,END of the part that is used, s; left out: all.")] = None,
    aircraft_name: Annotated[str | None, typer.Option(help="Aircraft of a recording with several.")] = None,
    align: Annotated[
        bool, typer.Option("--align/--no-align", help="Remove constant delays between the channels.")
    ] = True,
    force: Force = False,
) -> None:
    """Estimate the parameters of an aircraft from a recorded flight, with intervals, fit and validation."""
    if aircraft is not None:
        must_be_known_aircraft(aircraft, variant)
    position = _numbers("--accelerometer-m", accelerometer_m, 3)
    window = None if window_s is None else _numbers("--window-s", window_s, 2)
    from anser.identification.identify import identify as compute
    from anser.single_aircraft.model import aircraft as load_model

    vehicle = None if aircraft is None else load_model(aircraft, variant)
    with open_output_folder(out, force) as folder:
        with activity("estimating"), refuse_on(ValueError):
            result = compute(
                run,
                model,
                aircraft=vehicle,
                method=method,
                validate=validate,
                columns=map_,
                accelerometer_m=(position[0], position[1], position[2]),
                aircraft_name=aircraft_name,
                window_s=None if window is None else (window[0], window[1]),
                align=align,
            )
        with activity("drawing"):
            result.write_into(folder)
    print_document(result.document)
    headings = [
        *columns("parameter", no_wrap=True),
        *columns("estimate", "95 % from", "to", "standard error", "variance inflation", justify="right"),
    ]
    keys = ("estimate", "low", "high", "standard_error", "variance_inflation")
    print_table(result.title, headings, [[row["name"], *(f"{row[key]:.4g}" for key in keys)] for row in result.rows()])
    fits = result.fit_rows()
    measures = [key for key in fits[0] if key != "response"]
    headings = [*columns("response"), *columns(*(key.replace("_", " ") for key in measures), justify="right", digits=4)]
    print_table("fit", headings, [[row["response"], *(row[key] for key in measures)] for row in fits])
    for note in result.notes:
        print_note(note)
    files = "identification.nc, identification.json, report.html, figures"
    print_note(f"{out}: {files}{', aircraft.toml' if model == 'derivatives' else ''} written")


def _numbers(option: str, text: str, count: int) -> tuple[float, ...]:
    try:
        numbers = tuple(float(part) for part in text.split(","))
    except ValueError:
        numbers = ()
    if len(numbers) != count:
        raise InputError(f"{option}: arrived {text!r}; expected {count} numbers, separated by commas")
    return numbers
