"""Options that change a scenario on the way: --set and --planner; values by path, as the file would hold them."""

import itertools
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Annotated, Literal

import typer

from anser.cli.console import RefusedError, print_note
from anser.config.errors import ScenarioError, describe_value
from anser.config.key_paths import indexed_path
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
        show_default=False,
    ),
]
PlannerName = Annotated[
    Literal["certified", "published", "decentralised"] | None,
    typer.Option(help="In the place of the file's fleet.planner.", show_default=False),
]


def load_with_overrides(
    path: Path, settings: Sequence[str] = (), planner: str | None = None, *, with_trim_maps: bool = True
) -> Scenario:
    """Load a scenario, put other values in their places, and print its cautions; `built` as of `cautions`."""
    scenario = load(path)
    given = parse_overrides([*settings, *([f"fleet.planner={planner}"] if planner is not None else [])])
    if given:
        (first, value), *more = given.items()
        try:
            scenario = scenario.replace(first, value, *itertools.chain(*more))
            _refuse_idle(scenario, given)
        except ScenarioError as error:
            words = ", ".join(f"{one} = {value}" for one, value in given.items())
            raise ScenarioError(f"{path} with {words}", error.problems) from None
    for caution in find_cautions(scenario, with_trim_maps=with_trim_maps):
        print_note(f"caution: {caution}")
    return scenario


def _refuse_idle(scenario: Scenario, paths: Iterable[str]) -> None:
    """Refuse options --set that change nothing (ScenarioError)."""
    numbers = {indexed_path(scenario, path) for path in paths}
    idle = [problem for problem in unused_key_problems(scenario) if problem.path in numbers]
    if idle:
        raise ScenarioError("", idle)


def parse_overrides(texts: Sequence[str]) -> dict[str, object]:
    """By path, the values of options --set of the form PATH=VALUE."""
    found: dict[str, object] = {}
    for text in texts:
        path, value = split_assignment(text, "PATH=VALUE, such as wind.speed_m_s=8")
        if path in found:
            raise RefusedError(f"--set: arrived {path} twice; expected it once")
        found[path] = parse_value(value)
    return found


def split_assignment(text: str, expected: str) -> tuple[str, str]:
    """What stands before and behind the equals sign of an option --set."""
    path, sign, value = (part.strip() for part in text.partition("="))
    if not sign or not path or not value:
        raise RefusedError(f"--set: arrived {text!r}; expected {expected}")
    return path, value


def parse_value(text: str) -> object:
    """A number, a truth value, a list or a table of TOML where it reads as one, else the text itself."""
    word = text.strip()
    if word in ("true", "false"):
        return word == "true"
    for kind in (int, float):
        try:
            return kind(word)
        except ValueError:
            continue
    if word.startswith(("[", "{", '"', "'")):
        try:
            return parse_toml(f"value = {word}", "--set")["value"]
        except ScenarioError as error:
            reason = error.problems[0].expected
            raise RefusedError(f"--set: arrived {describe_value(word)}; expected a value of TOML ({reason})") from None
    return word
