"""The command figures."""

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import typer

from anser.cli.arguments import complete_run
from anser.cli.console import answer, line, make_new, working
from anser.cli.offering import about
from anser.cli.run_folder import must_hold, read_run

_AIRCRAFT, _VARIANT, _SPEED_M_S, _ALTITUDE_M = "f16", "textbook", 150.0, 1000.0


@about(
    "anser figures --out figures",
    "anser figures runs/three-aircraft --out figures",
)
def figures(
    out: Annotated[Path, typer.Option(help="New folder for the figures.", show_default=False)],
    run: Annotated[
        Path | None,
        typer.Argument(
            help="Folder that anser run wrote; left out: the published cases.",
            show_default=False,
            autocompletion=complete_run,
        ),
    ] = None,
) -> None:
    """Draw figures for a paper, each as PDF, SVG and PNG: of a flight, or every one of the published cases.

    The published cases are the step responses, the climb-and-turn, the paths bent by b4 and c4, the flights of one and
    of three aircraft; they are computed on the way, in a few minutes the first time.
    """
    if run is not None:
        dataset, _ = read_run(run)
        from anser.report.flight_figures import NEEDED_VARIABLES, draw_flight

        must_hold(dataset, NEEDED_VARIABLES, run)
        make_new(out)
        with working("drawing"):
            written = draw_flight(dataset, "flight", out)
    else:
        make_new(out)
        written = tuple(_published(out))
    kinds = sorted({path.suffix for path in written})
    count = len(written) // len(kinds)
    made = "1 figure" if count == 1 else f"{count} figures, each"
    answer(lambda: {"format_version": 1, "files": [str(path) for path in written]})
    line(f"{out}: {made} as {', '.join(kinds)}")


def _published(out: Path) -> Iterator[Path]:
    """Compute and draw the published cases, one after the other."""
    from anser.campaign import PUBLISHED_STEPS, fly_climb_and_turn, fly_steps
    from anser.report.flight_figures import draw_flight
    from anser.report.print_style import FIGURE_SUFFIXES
    from anser.report.shape_figures import draw_shapes
    from anser.report.step_figures import draw_overview, draw_step
    from anser.report.tracking_figure import draw_tracking
    from anser.verification.missions import published_flights
    from anser.verification.shape_families import shape_families

    def paths(name: str) -> list[Path]:
        return [out / f"{name}{suffix}" for suffix in FIGURE_SUFFIXES]

    with working("computing the paths bent by b4 and c4") as tell:
        for family, dataset in shape_families().items():
            yield from draw_shapes(dataset, family, out)
        tell("flying the step responses")
        flown = fly_steps(
            PUBLISHED_STEPS,
            aircraft=_AIRCRAFT,
            variant=_VARIANT,
            speed_m_s=_SPEED_M_S,
            altitude_m=_ALTITUDE_M,
            inversion="model",
        )
        tell("drawing the step responses")
        for flight in flown:
            draw_step(flight.dataset, files := paths(f"step-{flight.test.key}"))
            yield from files
        draw_overview([flight.dataset for flight in flown], files := paths("step-overview"))
        yield from files
        tell("flying the climb-and-turn")
        tracked = fly_climb_and_turn(_VARIANT)
        draw_tracking(tracked.dataset, "Climb and turn on velocity commands alone", files := paths("climb-and-turn"))
        yield from files
        tell("flying one and three aircraft")
        for name, flight in published_flights().items():
            tell(f"drawing the flight: {name}")
            yield from draw_flight(flight.dataset, name, out)
