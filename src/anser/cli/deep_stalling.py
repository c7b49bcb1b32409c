"""The command deep-stall."""

from pathlib import Path
from typing import Annotated

import typer

from anser.cli.arguments import VariantName
from anser.cli.console import (
    RefusedError,
    answer,
    columns,
    line,
    must_be_known,
    must_lie,
    plain_table,
    print_table,
    say,
    working,
)
from anser.cli.offering import about
from anser.cli.output_folder import Force, must_be_new_file, written_file

_AIRCRAFT = "f16"


@about(
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
        float | None, typer.Option(help="Elevator that is held; left out: fully nose-down.", show_default=False)
    ] = None,
    alpha_from_deg: Annotated[float, typer.Option(help="Least angle of attack that is looked at.")] = 20.0,
    altitude_m: Annotated[float, typer.Option(help="Of the steady descents in the trims.")] = 5000.0,
    picture: Annotated[
        Path | None, typer.Option(help="New picture of Cm against alpha and of the trims: NAME.svg, .png or .pdf.")
    ] = None,
    force: Force = False,
) -> None:
    """Angles of attack that the elevator cannot leave: pitch trims beyond the stall, followed as the c.g. moves."""
    must_be_known(_AIRCRAFT, variant)
    for x_cg in cg or ():
        must_lie("--cg", x_cg, 0.1, 0.5)
    must_lie("--alpha-from-deg", alpha_from_deg, -20.0, 89.0)
    must_lie("--altitude-m", altitude_m, 0.0, 15000.0)
    if picture is not None:
        from anser.report import BODE_SUFFIXES

        must_be_new_file("--picture", picture, BODE_SUFFIXES, force)
    from anser.execution import CENTRES, deep_stall_document
    from anser.execution import deep_stall as find

    with working("following the trims"):
        try:
            found = find(
                variant,
                x_cg_over_c=cg or CENTRES,
                elevator_deg=elevator_deg,
                alpha_from_deg=alpha_from_deg,
                altitude_m=altitude_m,
            )
        except ValueError as error:
            raise RefusedError(f"--{str(error).replace('_', '-')}") from None
    if picture is not None:
        from anser.report import draw_deep_stall

        with written_file("--picture", picture, force) as file:
            draw_deep_stall(found, [file])
    document = deep_stall_document(found)
    answer(lambda: document)
    table = plain_table(
        f"{_AIRCRAFT} ({variant}), elevator {found.attrs['elevator_deg']:g} deg: pitch trims beyond "
        f"{alpha_from_deg:g} deg; descents at {altitude_m:g} m, idle",
        *columns("c.g., of chord", "alpha, deg", justify="right"),
        "in pitch",
        *columns("airspeed, m/s", "path angle, deg", "pitch angle, deg", justify="right"),
    )
    for one in document["trims"]:
        table.add_row(
            f"{one['x_cg_over_c']:.4g}",
            f"{one['alpha_deg']:.2f}",
            "stable" if one["stable"] else "unstable",
            f"{one['speed_m_s']:.1f}",
            f"{one['path_angle_deg']:.1f}",
            f"{one['pitch_deg']:.1f}",
        )
    print_table(table)
    for one in document["greatest_pitching_moment"]:
        line(
            f"c.g. at {one['x_cg_over_c']:.4g}: Cm is {one['pitching_moment']:+.4f} at most, "
            f"at alpha {one['alpha_deg']:.4g} deg"
        )
    if document["appears"] is not None:
        at = document["appears"]
        line(f"A trim appears with the c.g. at {at['x_cg_over_c']:.4f}, at alpha {at['alpha_deg']:.1f} deg.")
    if picture is not None:
        say(f"{picture}: written")
