"""Command margins: stability margins of the autopilot."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from anser.cli.app import help_epilog
from anser.cli.arguments import AircraftName, Inversion, VariantName
from anser.cli.console import (
    InputError,
    columns,
    flight_point,
    must_be_in_range,
    must_be_known_aircraft,
    number,
    print_document,
    print_line,
    print_note,
    print_table,
    progress_bar,
    trim_progress,
)
from anser.cli.folders import Force, must_be_new_file, note_if_written, open_output_folder, write_if_requested
from anser.constants import STEP_MAX_S, STEP_MIN_S

if TYPE_CHECKING:
    import xarray as xr

    from anser.analysis.margins import MarginSurvey


_AT = "150,1000"
_FIGURES = (
    ("gain_margin_db", "gain, dB", 1),
    ("phase_margin_deg", "phase, deg", 1),
    ("delay_margin_ms", "delay, ms", 1),
    ("disk_margin", "disk", 2),
)


@help_epilog(
    "anser margins --at 150,1000 --bode margins.svg",
    "anser margins --envelope --coarse --out margins",
    unmet="no steady flight at this condition",
)
def margins(
    at: Annotated[
        str | None,
        typer.Option(
            help=f"SPEED,ALTITUDE of level flight, m/s and m (or cas:140,1000, mach:0.4,1000); left out: {_AT}."
        ),
    ] = None,
    aircraft: AircraftName = "f16",
    variant: VariantName = "textbook",
    inversion: Inversion = "model",
    step_s: Annotated[float, typer.Option(help="Sampling period of the autopilot, s.")] = 0.01,
    bode: Annotated[
        Path | None, typer.Option(help="New picture of Bode and Nyquist diagrams: NAME.svg, .png or .pdf.")
    ] = None,
    envelope: Annotated[
        bool, typer.Option("--envelope", help="At every point of the envelope that can be flown; needs --out.")
    ] = False,
    coarse: Annotated[
        bool, typer.Option("--coarse", help="With --envelope: a coarse grid (F-16: 3 x 5 instead of 16 x 18).")
    ] = False,
    out: Annotated[Path | None, typer.Option(help="With --envelope: new folder for dataset and maps.")] = None,
    force: Force = False,
) -> None:
    """Compute gain, phase, delay and disk margins at every actuator and loop of the autopilot, opened one at a time."""
    must_be_known_aircraft(aircraft, variant)
    must_be_in_range("--step-s", step_s, STEP_MIN_S, STEP_MAX_S)
    if envelope:
        for option, value in (("--at", at), ("--bode", bode)):
            if value is not None:
                raise InputError(f"{option}: arrived with --envelope, which is of all points; expected one of them")
        if out is None:
            raise InputError("--out: arrived nothing; expected a new folder for what --envelope finds")
        _survey(aircraft, variant, inversion, step_s, coarse, out, force)
        return
    for option, value in (("--out", out), ("--coarse", coarse or None)):
        if value is not None:
            raise InputError(f"{option}: arrived without --envelope; expected both or neither")
    speed_m_s, altitude_m = flight_point(_AT if at is None else at)
    must_be_new_file("--bode", bode, force=force)
    from anser.analysis.margins import margin_document, margins_at

    with trim_progress("trimming and breaking the loops"):
        dataset = margins_at(
            aircraft, variant, speed_m_s=speed_m_s, altitude_m=altitude_m, inversion=inversion, step_s=step_s
        )
    from anser.report.envelope_figures import draw_bode

    write_if_requested("--bode", bode, force, lambda file: draw_bode(dataset, [file]))
    print_document(lambda: margin_document(dataset))
    _print(dataset)
    note_if_written(bode)


def _survey(
    aircraft: str, variant: str, inversion: Inversion, step_s: float, coarse: bool, out: Path, force: bool
) -> None:
    with open_output_folder(out, force) as into, progress_bar() as tell:
        from anser.analysis.margins import survey_margins
        from anser.report.envelope_figures import draw_margin_maps
        from anser.results.documents import write_json
        from anser.results.netcdf import write_netcdf

        surveyed = survey_margins(aircraft, variant, inversion=inversion, coarse=coarse, step_s=step_s, progress=tell)
        tell("writing", 1.0)
        write_netcdf(surveyed.dataset, into / "margins.nc")
        draw_margin_maps(surveyed.dataset, into)
        write_json(surveyed.document(), into / "margins.json")
    print_document(surveyed.document)
    _print_survey(surveyed)
    print_note(f"{out}: margins.nc, margins.json and maps written")


def _name(condition: dict[str, Any]) -> str:
    from anser.analysis.trim_points import airframe_label

    return airframe_label(condition)


def _print(dataset: "xr.Dataset") -> None:
    condition = dataset.attrs
    rows = []
    for name in dataset["breakpoint"].values.tolist():
        margins_here = {
            key: values.item() for key, values in dataset.sel(breakpoint=name).data_vars.items() if not values.dims
        }
        gain_up = _gain(margins_here["gain_up_db"], margins_here["gain_up_searched_db"], 1.0)
        gain_down = _gain(margins_here["gain_down_db"], margins_here["gain_down_searched_db"], -1.0)
        keys = ("phase_margin_deg", "crossover_rad_s", "delay_margin_ms", "disk_margin")
        figures = [*(margins_here[key] for key in keys), *_disk(margins_here["disk_margin"])]
        rows.append([name, gain_up, gain_down, *figures, "short" if margins_here["short"] else ""])
    print_table(
        f"{_name(condition)} at {condition['speed_m_s']:g} m/s, {condition['altitude_m']:g} m: "
        f"{condition['inversion']} inversion, sampled every {1000 * condition['step_s']:g} ms",
        [
            *columns("loop broken at", no_wrap=True),
            *columns("gain up, dB", "down, dB", "phase, deg", justify="right", digits=1),
            *columns("crossover, rad/s", justify="right", digits=2),
            *columns("delay, ms", justify="right", digits=1),
            *columns("disk", justify="right", digits=2),
            *columns("is dB", "or deg", justify="right", digits=1),
            *columns("short"),
        ],
        rows,
    )
    simultaneous = dataset["actuators_disk_margin"].item()
    gain, phase = _disk(simultaneous)
    print_line(
        f"All actuators at once: disk {simultaneous:.2f}, {gain:.1f} dB or {phase:.1f} deg each. "
        f"Short: less than {condition['gain_min_db']:g} dB or {condition['phase_min_deg']:g} deg. Boundaries of "
        f"stability are searched from {condition['frequency_min_rad_s']:g} to "
        f"{condition['frequency_max_rad_s']:.5g} rad/s; "
        "a dash: none found. "
        "None to: none found up to this change of gain; beyond it one could lie below these "
        "frequencies. "
        "All loops but the one broken are closed."
    )


def _print_survey(surveyed: "MarginSurvey") -> None:
    document = surveyed.document()
    condition = surveyed.dataset.attrs
    headings = (*(heading for _, heading, _ in _FIGURES), "short", "of points", "short of all points")
    rows = []
    for with_reserve, all_points in zip(document["breakpoints_with_reserve"], document["breakpoints_all"], strict=True):
        cells = [
            " / ".join(number(with_reserve[f"{key}_{statistic}"], digits) for statistic in ("min", "p5", "median"))
            for key, _, digits in _FIGURES
        ]
        counts = (with_reserve["short"], with_reserve["points"], all_points["short"])
        rows.append([with_reserve["breakpoint"], *cells, *counts])
    print_table(
        f"{_name(condition)}, {condition['inversion']} inversion: least / 5th percentile / median where a tenth of "
        "power and surfaces is left",
        [*columns("loop broken at", no_wrap=True), *columns(*headings, justify="right")],
        rows,
    )
    points = document["points"]
    print_line(
        f"{points['stable']} points are stable, {points['unstable']} unstable; {points['held_back']} stand at a limit "
        f"of the autopilot, {points['no_trim']} cannot be flown. Short: less than {condition['gain_min_db']:g} dB or "
        f"{condition['phase_min_deg']:g} deg. {surveyed.run_s:.1f} s (and {surveyed.compile_s:.1f} s compiling)"
    )


def _disk(radius: float) -> tuple[float, float]:
    """Return the change of gain alone (dB), and of phase alone (deg), that a disk margin `radius` allows."""
    gain = 20 * math.log10((2 + radius) / (2 - radius)) if radius < 2 else math.inf
    return gain, math.degrees(2 * math.atan(radius / 2))


def _gain(margin_db: float, searched_db: float, sign: float) -> str | float:
    """Return the gain margin, dB, times `sign` (1: increase of gain, -1: decrease); a text if above `searched_db`."""
    if margin_db <= searched_db:
        return sign * margin_db
    return f"none to {sign * searched_db:.1f}"
