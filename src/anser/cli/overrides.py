"""Options that change scenario values by key path: --set and --planner."""

import itertools
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Annotated, Literal

import typer

from anser.cli.console import InputError, print_note
from anser.config.errors import Problem, ScenarioError, describe_value
from anser.config.key_paths import indexed_path, repeated_paths
from anser.config.toml_text import parse_toml
from anser.scenario.cautions import find_cautions
from anser.scenario.files import load
from anser.scenario.schema import Scenario
from anser.scenario.unused_keys import unused_key_problems

Overrides = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        help="PATH=VALUE, such as wind.speed_m_s=8 or aircraft[0].start.altitude_m=1500: in the place of the file's "
        "value, and checked as that; may be given several times.",
    ),
]
PlannerName = Annotated[
    Literal["certified", "published", "decentralised"] | None,
    typer.Option(help="In the place of the file's fleet.planner."),
]


def load_with_overrides(
    path: Path, settings: Sequence[str] = (), planner: str | None = None, *, with_trim_maps: bool = True
) -> Scenario:
    """Load a scenario, replace values by the options --set and --planner, and print cautions about the scenario.

    `settings` are texts PATH=VALUE; `with_trim_maps` False omits the cautions that need trims. Raises InputError if an
    option is malformed. Raises ScenarioError if the scenario is invalid, or if a key of an option has no effect or is
    set twice.
    """
    scenario = load(path)
    overrides = parse_overrides([*settings, *([f"fleet.planner={planner}"] if planner is not None else [])])
    if overrides:
        (first_path, value), *other_overrides = overrides.items()
        try:
            scenario = scenario.replace(first_path, value, *itertools.chain(*other_overrides))
            _refuse_idle(scenario, overrides)
        except ScenarioError as error:
            assignments = ", ".join(f"{key_path} = {value}" for key_path, value in overrides.items())
            raise ScenarioError(f"{path} with {assignments}", error.problems) from None
    for caution in find_cautions(scenario, with_trim_maps=with_trim_maps):
        print_note(f"caution: {caution}")
    return scenario


def _refuse_idle(scenario: Scenario, paths: Iterable[str]) -> None:
    repeated = repeated_paths(scenario, paths)
    if repeated is not None:
        raise ScenarioError("", [Problem(repeated[1], f"the key of {repeated[0]} again", "each key once")])
    numbers = {indexed_path(scenario, path) for path in paths}
    idle = [problem for problem in unused_key_problems(scenario) if problem.path in numbers]
    if idle:
        raise ScenarioError("", idle)


def parse_overrides(texts: Sequence[str]) -> dict[str, object]:
    """Return the values of options --set (PATH=VALUE) by key path; raises InputError if malformed or repeated."""
    overrides: dict[str, object] = {}
    for text in texts:
        path, value = split_assignment(text, "PATH=VALUE, such as wind.speed_m_s=8")
        if path in overrides:
            raise InputError(f"--set: arrived {path} twice; expected it once")
        overrides[path] = parse_value(value)
    return overrides


def split_assignment(text: str, expected: str) -> tuple[str, str]:
    """Split an option --set at the equals sign; raises InputError with the text `expected` if a part is missing."""
    path, sign, value = (part.strip() for part in text.partition("="))
    if not sign or not path or not value:
        raise InputError(f"--set: arrived {text!r}; expected {expected}")
    return path, value


def parse_value(text: str) -> object:
    """Return the value of a text in TOML notation (truth value, number, list, table, quoted text) or the text itself.

    Raises InputError if the TOML is malformed.
    """
    word = text.strip()
    if word in ("true", "false"):
        return word == "true"
    for number_type in (int, float):
        try:
            return number_type(word)
        except ValueError:
            continue
    if word.startswith(("[", "{", '"', "'")):
        try:
            return parse_toml(f"value = {word}", "--set")["value"]
        except ScenarioError as error:
            reason = error.problems[0].expected
            raise InputError(f"--set: arrived {describe_value(word)}; expected a value of TOML ({reason})") from None
    return word
