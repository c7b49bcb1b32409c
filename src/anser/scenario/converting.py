"""Scenario files of one format written in the other: they differ in the planner that is meant where none is named."""

import re
import tomllib

from anser.scenario.errors import Problem, ScenarioError, plain
from anser.scenario.load import loads
from anser.scenario.schema import DEFAULT_PLANNERS, FORMAT

_FORMAT = re.compile(r"^(\s*format\s*=\s*)\d+", re.MULTILINE)
_FLEET = re.compile(r"^[ \t]*\[[ \t]*fleet[ \t]*\][^\n]*(?:\n|$)", re.MULTILINE)


def convert(text: str, source: str = "<string>", to: int = FORMAT) -> str:
    """The text of a scenario in another format; its comments stay, and it flies as it did.

    Parameters
    ----------
    text
        TOML of a valid scenario.
    source
        What to call it in messages.
    to
        The format wanted.

    Raises
    ------
    ScenarioError
        It is no valid scenario, or so written that its format or its table of the fleet is not found.
    """
    scenario = loads(text, source)
    if scenario.format == to:
        return text
    converted = _FORMAT.sub(rf"\g<1>{to}", text, count=1)
    if "planner" not in scenario.fleet.model_fields_set:
        line = f'planner = "{scenario.fleet.planner}"  # format {scenario.format} meant it; default of format {to}: '
        line += f'"{DEFAULT_PLANNERS[to]}"\n'
        converted = _FLEET.sub(lambda found: found[0].rstrip("\n") + "\n" + line, converted, count=1)
    wanted = scenario.model_dump(exclude={"format"})
    try:
        same = loads(converted, source).model_dump(exclude={"format"}) == wanted
    except (ScenarioError, tomllib.TOMLDecodeError):
        same = False
    if not same:
        expected = f'a line "format = {scenario.format}" and a table [fleet], both written out, which can be changed'
        raise ScenarioError(source, [Problem("", f"a file of format {plain(float(scenario.format))}", expected)])
    return converted
