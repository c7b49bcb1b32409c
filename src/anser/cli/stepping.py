"""The commands step and gallery."""

import importlib.util
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer
from rich.table import Table

from anser.cli.console import RefusedError, err, make_new, must_lie, number, plain_table, print_table, screen
from anser.scenario import VARIANTS

if TYPE_CHECKING:
    from anser.campaign import SteppedFlight, StepTest

_AIRCRAFT = "f16"

_Inversion = Annotated[
    Literal["model", "incremental"],
    typer.Option(help="Inversion of the model, or of the change from what the sensors measure."),
]
_Variant = Annotated[str, typer.Option(help=f"Published set of tables: {', '.join(VARIANTS[_AIRCRAFT])}.")]


def step(
    loop: Annotated[Literal["rates", "attitude", "velocity"], typer.Option(help="Which loop is commanded.")],
    channel: Annotated[
        list[str],
        typer.Option(help="Of that loop: p, q, r; mu, alpha, beta; v, gamma, chi. May be given several times."),
    ],
    size: Annotated[list[float], typer.Option(help="Of the step, deg/s, deg or m/s; one for each channel.")],
    at: Annotated[str, typer.Option(help="SPEED,ALTITUDE of the level trim that is left, m/s and m.")],
    duration_s: Annotated[
        float | None,
        typer.Option(help="How long; left out: 3, 6 or 60 s (rates, attitude, velocity), 1.05 s for a yaw rate."),
    ] = None,
    inversion: _Inversion = "model",
    variant: _Variant = "textbook",
    as_json: Annotated[bool, typer.Option("--json", help="Print the figures as JSON instead of the table.")] = False,
    out: Annotated[Path | None, typer.Option(help="New picture of the response: NAME.svg, .png or .pdf.")] = None,
) -> None:
    """Step one loop's command and measure: rise, settling, overshoot, error at the end, coupling, surface use."""
    _must_be_variant(variant)
    speed_m_s, altitude_m = _place(at)
    if out is not None:
        _must_be_new_picture(out)
    if len(channel) != len(size):
        raise RefusedError(f"--size: arrived {len(size)} for {len(channel)} channels; expected one for each --channel")
    if len(set(channel)) != len(channel):
        raise RefusedError(f"--channel: arrived {', '.join(channel)}; expected each at most once")
    from anser.campaign import step_document, step_test

    try:
        test = step_test(loop, dict(zip(channel, size, strict=True)), duration_s)
    except ValueError as error:
        raise RefusedError(f"--{error}") from None
    flown = _fly([test], variant, speed_m_s, altitude_m, inversion)
    if out is not None:
        from anser.report.step_figures import draw_step

        try:
            draw_step(flown[0].dataset, [out])
        except OSError as error:
            reason = error.strerror or str(error)
            raise RefusedError(f"--out: arrived {out}; expected a place for a file ({reason})") from None
    if as_json:
        sys.stdout.write(json.dumps(step_document(flown), indent=1, allow_nan=False) + "\n")
    else:
        print_table(
            _table(flown, f"{_AIRCRAFT} ({variant}) at {speed_m_s:g} m/s, {altitude_m:g} m: {inversion} inversion")
        )
    if flown[0].left_tables:
        err.print("caution: it leaves the aerodynamic tables", markup=False)
    if out is not None:
        err.print(f"{out}: written", soft_wrap=True, markup=False)


def gallery(
    out: Annotated[Path, typer.Option(help="New folder for the figures and metrics.json.", show_default=False)],
    inversion: _Inversion = "model",
    variant: _Variant = "textbook",
) -> None:
    """Fly every published step test of the three loops: a figure of each, an overview, a table of their figures."""
    _must_be_variant(variant)
    _must_draw()
    make_new(out)
    from anser.campaign import PUBLISHED_STEPS, step_document
    from anser.report.step_figures import draw_overview, draw_step

    flown = _fly(PUBLISHED_STEPS, variant, 150.0, 1000.0, inversion)
    document = step_document(flown)
    with (out / "metrics.json").open("x", encoding="utf-8") as file:
        json.dump(document, file, indent=1, allow_nan=False)
        file.write("\n")
    with err.status("drawing"):
        for flight in flown:
            draw_step(flight.dataset, [out / f"{flight.test.key}{suffix}" for suffix in (".svg", ".png")])
        draw_overview([flight.dataset for flight in flown], [out / f"overview{suffix}" for suffix in (".svg", ".png")])
    print_table(_table(flown, f"{_AIRCRAFT} ({variant}) at 150 m/s, 1000 m: {inversion} inversion"))
    limits = document["limits"]
    short = [(flight.test.key, line) for flight in flown for line in flight.shortfalls]
    screen.print(
        f"{len(flown) - len({key for key, _ in short})} of {len(flown)} within overshoot "
        f"{limits['overshoot_percent']:g} %, final error {limits['final_error_percent']:g} %, sideslip "
        f"{limits['sideslip_in_velocity_steps_deg']:g} deg in velocity steps; figures in {out}",
        soft_wrap=True,
        highlight=False,
        markup=False,
    )
    err.print(
        "The climb-and-turn is a scenario of its own: anser run scenarios/climb-and-turn.toml",
        soft_wrap=True,
        markup=False,
    )
    for key, line in short:
        err.print(f"falls short: {key}: {line}", soft_wrap=True, markup=False)
    if short:
        raise typer.Exit(1)


def _fly(
    tests: Sequence["StepTest"],
    variant: str,
    speed_m_s: float,
    altitude_m: float,
    inversion: Literal["model", "incremental"],
) -> tuple["SteppedFlight", ...]:
    from anser.campaign import ConditionError, fly_steps

    try:
        with err.status("flying (the first time, this compiles)") as status:
            return fly_steps(
                tests,
                aircraft=_AIRCRAFT,
                variant=variant,
                speed_m_s=speed_m_s,
                altitude_m=altitude_m,
                inversion=inversion,
                progress=lambda loop: status.update(f"flying the {loop} loop (the first time, this compiles)"),
            )
    except ConditionError as error:
        err.print(str(error), soft_wrap=True, markup=False)
        raise typer.Exit(1) from None


def _must_be_variant(variant: str) -> None:
    if variant not in VARIANTS[_AIRCRAFT]:
        raise RefusedError(f"--variant: arrived {variant!r}; expected one of {', '.join(VARIANTS[_AIRCRAFT])}")


def _place(at: str) -> tuple[float, float]:
    """Speed and altitude, m/s and m."""
    try:
        speed, altitude = (float(part) for part in at.split(","))
    except ValueError:
        raise RefusedError(f"--at: arrived {at!r}; expected SPEED,ALTITUDE in m/s and m, such as 150,2000") from None
    must_lie("--at, speed", speed, 1, 1000)
    must_lie("--at, altitude", altitude, -500, 30000)
    return speed, altitude


def _must_draw() -> None:
    if importlib.util.find_spec("matplotlib") is None:
        raise RefusedError("--out: arrived a picture, but matplotlib is missing; expected pip install matplotlib")


def _must_be_new_picture(out: Path) -> None:
    """Refuse a picture that cannot be written, before anything is flown."""
    from anser.report.step_figures import FIGURE_SUFFIXES

    if out.suffix not in FIGURE_SUFFIXES:
        raise RefusedError(f"--out: arrived {out}; expected a name that ends with {', '.join(FIGURE_SUFFIXES)}")
    if out.exists():
        raise RefusedError(f"--out: arrived {out}, which exists; expected a new file (nothing is overwritten)")
    if not out.parent.is_dir():
        raise RefusedError(f"--out: arrived {out}; expected a file in a folder that exists")
    _must_draw()


def _table(flights: Sequence["SteppedFlight"], title: str) -> Table:
    """One row per commanded channel."""
    table = plain_table(title)
    for name, unit in (("step", ""), ("channel", "")):
        table.add_column(f"{name}\n{unit}", no_wrap=True)
    for name, unit in (("size", ""), ("rise", "s"), ("settling", "s"), ("overshoot", "%"), ("final error", "%")):
        table.add_column(f"{name}\n{unit}", justify="right")
    table.add_column("others move\nat most")
    table.add_column("sideslip\ndeg", justify="right")
    table.add_column("elevator, aileron,\nrudder used, %", justify="right")
    for flight in flights:
        document = flight.document()
        others = ", ".join(
            f"{channel} {_short(of['greatest'])} {of['unit']}" for channel, of in document["coupling"].items()
        )
        surfaces = ", ".join(number(value, 0) for value in document["surface_use_percent"].values())
        # What holds for the whole response stands in the first of its rows.
        once = [document["key"], others, number(document["sideslip_max_deg"], 2), surfaces]
        for channel, of in document["channels"].items():
            key, *rest = once
            table.add_row(key, channel, *_cells(of), *rest, style="red" if document["shortfalls"] else None)
            once = [""] * 4
    return table


def _cells(of: dict[str, Any]) -> list[str]:
    return [
        f"{of['size']:+g} {of['unit']}",
        number(of["rise_time_s"], 2),
        number(of["settling_time_s"], 2),
        number(of["overshoot_percent"], 2),
        number(of["final_error_percent"], 2),
    ]


def _short(value: float | None) -> str:
    """Two decimals; a dash for none."""
    return "<0.01" if value is not None and value < 0.01 else number(value, 2)
