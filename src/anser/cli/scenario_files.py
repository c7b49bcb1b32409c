"""Commands about the files of scenarios: check, new, convert, schema."""

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Literal

import typer

from anser.cli.arguments import ScenarioPath
from anser.cli.console import RefusedError, answer, line, say
from anser.cli.offering import about
from anser.cli.output_folder import Force, must_be_new_file, written_file
from anser.cli.setting import loaded
from anser.output_files import write_file
from anser.scenario import AirframeFile, Scenario, ScenarioError, cautions, write_starter
from anser.scenario import convert as as_format
from anser.scenario.file_schema import json_schema
from anser.scenario.load import read_text
from anser.scenario.new_files import schema_text, write_new
from anser.scenario.schema import DEFAULT_PLANNERS, FORMAT
from anser.scenario.schema_base import Table
from anser.scenario.template import SCENARIO_SCHEMA


@about("anser check scenarios/three-aircraft.toml", "anser check mine.toml --json")
def check(scenario: ScenarioPath) -> None:
    """Check a scenario file without planning or flying it.

    Good: it is well-formed and consistent. Whether a plan exists anser plan finds out; the flight may still fail.
    """
    try:
        wanted = loaded(scenario, built=False)
    except ScenarioError as error:
        found = [dataclasses.asdict(one) for one in error.problems]
        answer(lambda: {"format_version": 1, "file": str(scenario), "good": False, "problems": found})
        raise
    count = len(wanted.aircraft)
    fleet = "1 aircraft" if count == 1 else f"{count} aircraft"
    goals = "1 goal" if len(wanted.goal) == 1 else f"{len(wanted.goal)} goals"
    answer(
        lambda: {
            "format_version": 1,
            "file": str(scenario),
            "good": True,
            "name": wanted.name,
            "hash": wanted.hash,
            "aircraft": count,
            "goals": len(wanted.goal),
            "duration_s": wanted.timing.duration_s,
            "cautions": list(cautions(wanted, built=False)),
        }
    )
    line(f"{scenario}: good. {wanted.name}: {fleet}, {goals}, {wanted.timing.duration_s:g} s.")
    line(f"Next: anser plan {scenario}")


@about("anser convert old.toml new.toml", "anser convert new.toml old.toml --format 1")
def convert(
    scenario: ScenarioPath,
    path: Annotated[Path, typer.Argument(help="File to write; it must not exist.", show_default=False)],
    format_: Annotated[int, typer.Option("--format", help="Format to write: 1 or 2.")] = FORMAT,
) -> None:
    """Write a scenario file in another format: it flies as it did, and its comments stay."""
    if format_ not in DEFAULT_PLANNERS:
        raise RefusedError(f"--format: arrived {format_}; expected {' or '.join(map(str, DEFAULT_PLANNERS))}")
    text = as_format(read_text(scenario), str(scenario), format_)
    write_new(path, text)
    answer(lambda: {"format_version": 1, "file": str(path), "format": format_})
    line(f"{path}: written in format {format_}. Next: anser check {path}")


@about("anser schema", "anser schema study --out anser-study.schema.json", "anser schema aircraft")
def schema(
    kind: Annotated[Literal["scenario", "study", "aircraft"], typer.Argument(help="Kind of file.")] = "scenario",
    out: Annotated[
        Path | None, typer.Option(help="New file, NAME.json; left out: standard output.", show_default=False)
    ] = None,
    force: Force = False,
) -> None:
    """Write the JSON Schema of a kind of file: with it an editor completes and checks keys while you type."""
    if out is not None:
        must_be_new_file("--out", out, (".json",), force)
    document = json_schema(_model_of(kind), f"anser {kind}")
    if out is None:
        answer(lambda: document)
        line(json.dumps(document, indent=1))
        return
    with written_file("--out", out, force) as file:
        write_file(file, schema_text(_model_of(kind), f"anser {kind}"))
    answer(lambda: {"format_version": 1, "file": str(out)})
    line(f"{out}: written")


def _model_of(kind: str) -> type[Table]:
    if kind == "study":
        from anser.campaigns.study import Study  # here: the others need no libraries of statistics

        return Study
    return {"scenario": Scenario, "aircraft": AirframeFile}[kind]


@about("anser new mine.toml")
def new(path: Annotated[Path, typer.Argument(help="File to write; it must not exist.", show_default=False)]) -> None:
    """Write a commented scenario to start from, and beside it the schema with which an editor checks it."""
    start(path, write_starter, SCENARIO_SCHEMA, "anser check")


def start(path: Path, write: Callable[[Path], Path], schema_name: str, check_by: str) -> None:
    """Write a file to start from, with its schema beside it, and say so."""
    beside = path.with_name(schema_name)
    known = beside.exists()
    write(path)
    answer(lambda: {"format_version": 1, "file": str(path), "schema": str(beside)})
    line(f"{path}: written. Next: {check_by} {path}")
    say(f"{beside}: {'there already, left alone' if known else 'written: its schema, for editors'}")
