"""Commands for scenario files: check, new, convert, schema."""

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Literal

import typer

from anser.aircraft_files.schema import AirframeFile
from anser.cli.app import help_epilog
from anser.cli.arguments import ScenarioPath, complete_shipped
from anser.cli.console import InputError, print_document, print_line, print_note
from anser.cli.folders import Force, must_be_new_file, open_output_file
from anser.cli.overrides import load_with_overrides
from anser.config.errors import ScenarioError, describe_value
from anser.config.file_schema import json_schema, schema_text, write_new_file, write_schema
from anser.config.shipped_files import copy_shipped_file, shipped_files
from anser.config.tables import Table
from anser.config.toml_text import read_text
from anser.files import write_file
from anser.scenario.cautions import find_cautions
from anser.scenario.files import SCENARIO_SCHEMA, write_starter
from anser.scenario.files import convert as as_format
from anser.scenario.schema import Scenario
from anser.scenario.schema_tables import DEFAULT_PLANNERS, FORMAT


@help_epilog("anser check scenarios/three-aircraft.toml", "anser check mine.toml --json")
def check(scenario: ScenarioPath) -> None:
    """Check a scenario file without planning or flying it.

    Good means well-formed and consistent. Use anser plan to test whether a plan exists; the flight may still fail.
    """
    try:
        loaded = load_with_overrides(scenario, with_trim_maps=False)
        if loaded.wind.field is not None:
            from anser.scenario.build_wind_field import check_wind_field  # late import: JAX

            check_wind_field(loaded)
    except ScenarioError as error:
        problems = [dataclasses.asdict(problem) for problem in error.problems]
        print_document(lambda: {"format_version": 1, "file": str(scenario), "good": False, "problems": problems})
        raise
    count = len(loaded.aircraft)
    fleet = "1 aircraft" if count == 1 else f"{count} aircraft"
    goals = "1 goal" if len(loaded.goal) == 1 else f"{len(loaded.goal)} goals"
    print_document(
        lambda: {
            "format_version": 1,
            "file": str(scenario),
            "good": True,
            "name": loaded.name,
            "hash": loaded.hash,
            "aircraft": count,
            "goals": len(loaded.goal),
            "duration_s": loaded.timing.duration_s,
            "cautions": list(find_cautions(loaded, with_trim_maps=False)),
        }
    )
    print_line(f"{scenario}: good. {loaded.name}: {fleet}, {goals}, {loaded.timing.duration_s:g} s.")
    print_line(f"Next: anser plan {scenario}")


@help_epilog("anser convert old.toml new.toml", "anser convert new.toml old.toml --format 1")
def convert(
    scenario: ScenarioPath,
    path: Annotated[Path, typer.Argument(help="File to write; it must not exist.")],
    format_: Annotated[int, typer.Option("--format", help="Format to write: 1 or 2.")] = FORMAT,
) -> None:
    """Write a scenario file in another format, with the same flight and comments."""
    if format_ not in DEFAULT_PLANNERS:
        raise InputError(f"--format: arrived {format_}; expected {' or '.join(map(str, DEFAULT_PLANNERS))}")
    text = as_format(read_text(scenario), str(scenario), format_)
    write_new_file(path, text)
    print_document(lambda: {"format_version": 1, "file": str(path), "format": format_})
    print_line(f"{path}: written in format {format_}. Next: anser check {path}")


@help_epilog("anser schema", "anser schema study --out anser-study.schema.json", "anser schema aircraft")
def schema(
    kind: Annotated[Literal["scenario", "study", "aircraft"], typer.Argument(help="Kind of file.")] = "scenario",
    out: Annotated[Path | None, typer.Option(help="New file, NAME.json; left out: standard output.")] = None,
    force: Force = False,
) -> None:
    """Write the JSON Schema of a kind of file, for completion and checking of keys in editors."""
    must_be_new_file("--out", out, (".json",), force)
    document = json_schema(_model_of(kind), f"anser {kind}")
    if out is None:
        print_document(lambda: document)
        print_line(json.dumps(document, indent=1))
        return
    with open_output_file("--out", out, force) as file:
        write_file(file, schema_text(_model_of(kind), f"anser {kind}"))
    print_document(lambda: {"format_version": 1, "file": str(out)})
    print_line(f"{out}: written")


def _model_of(kind: str) -> type[Table]:
    if kind == "study":
        from anser.campaigns.study import Study  # late import: only studies need statistics libraries

        return Study
    return {"scenario": Scenario, "aircraft": AirframeFile}[kind]


@help_epilog(
    "anser new mine.toml",
    "anser new mine.toml --from three-aircraft",
    "anser new my-study.toml --from how-surely",
)
def new(
    path: Annotated[Path, typer.Argument(help="File to write; it must not exist.")],
    from_: Annotated[
        str | None,
        typer.Option(
            "--from",
            help="Name of a scenario, study or aircraft file that comes with anser, to be copied.",
            autocompletion=complete_shipped,
        ),
    ] = None,
) -> None:
    """Write a commented starter scenario, or a copy of a scenario, study or aircraft file that comes with anser.

    A scenario gets the schema for editors beside it; a copied study gets its scenario.
    """
    if from_ is None:
        write_starter_file(path, write_starter, SCENARIO_SCHEMA, "anser check")
    else:
        _copy_shipped(from_, path)


_NEXT_COMMANDS = {
    "[[aircraft]]": "anser check {}",
    "[[surface]]": "anser aircraft check {}",
    "[rare]": "anser rare {} --out FOLDER",
    "[sampling]": "anser campaign {} --out FOLDER",
}
"""Command to run next on a copied file, by a TOML table that only files of its kind have."""


def _copy_shipped(name: str, path: Path) -> None:
    names = shipped_files()
    if name not in names:
        raise InputError(f"--from: arrived {describe_value(name)}; expected one of {', '.join(names)}")
    text = read_text(names[name])
    is_scenario = "[[aircraft]]" in text
    header = f"#:schema ./{SCENARIO_SCHEMA}\n" if is_scenario else ""
    companions = copy_shipped_file(name, path, lambda copied: header + copied)
    if is_scenario:
        companions.append(write_schema(path, SCENARIO_SCHEMA, Scenario, "anser scenario"))
    print_document(
        lambda: {"format_version": 1, "file": str(path), "from": name, "companions": list(map(str, companions))}
    )
    command = next(command for table, command in _NEXT_COMMANDS.items() if table in text)
    print_line(f"{path}: written, a copy of {name}. Next: {command.format(path)}")
    for companion in companions:
        print_note(f"{companion}: beside it, for {'editors' if companion.name == SCENARIO_SCHEMA else path.name}")


def write_starter_file(path: Path, write: Callable[[Path], Path], schema_name: str, check_command: str) -> None:
    """Write a file at `path` with `write`, and print its path and the next command `check_command`.

    `write` must also write the schema file `schema_name` beside the file, unless there is one. A note on the schema
    says which of the two happened.
    """
    schema_path = path.with_name(schema_name)
    schema_exists = schema_path.exists()
    write(path)
    print_document(lambda: {"format_version": 1, "file": str(path), "schema": str(schema_path)})
    print_line(f"{path}: written. Next: {check_command} {path}")
    print_note(f"{schema_path}: {'there already, left alone' if schema_exists else 'written: its schema, for editors'}")
