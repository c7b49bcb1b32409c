"""Which kind of aircraft file values are, and whether they are a valid one."""

from typing import Any, TypeGuard

from pydantic import ValidationError

from anser.derivative_names import COEFFICIENTS
from anser.scenario.airframe_file.schema import AirframeFile
from anser.scenario.airframe_file.schema_dave_ml import DaveMlFile
from anser.scenario.errors import Problem, ScenarioError, show
from anser.scenario.file_kinds import must_be
from anser.scenario.schema_problems import problems_from

_RATES = {f"{row}_{kind}dot" for row in COEFFICIENTS for kind in ("alpha", "beta")}


def validate_airframe(values: dict[str, Any], source: str) -> AirframeFile | DaveMlFile:
    """Validate an aircraft that is at hand as nested dictionaries and lists, as its TOML file would hold them.

    One with a table `dave_ml`, whose files are held as tables of their name and text, is built by them.

    Raises
    ------
    ScenarioError
        If it is no valid one; the message names file, key, what arrived and what would be right.
    """
    must_be("aircraft", values, source)
    version = values.get("format")
    if "format" in values and version != 1:
        raise ScenarioError(source, [Problem("format", show(version), "1, the format that this anser reads")])
    kind = DaveMlFile if "dave_ml" in values else AirframeFile
    try:
        file = kind.model_validate(values)
    except ValidationError as error:
        problems = problems_from(error, kind, values)
        raise ScenarioError(source, [_plainer(problem) for problem in problems]) from None
    if isinstance(file, DaveMlFile):
        from anser.scenario.airframe_file.build_dave_ml import model_problems  # here: it loads JAX

        problems = model_problems(file)
        if problems:
            raise ScenarioError(source, problems)
    return file


def is_file(value: object) -> TypeGuard[AirframeFile | DaveMlFile]:
    """Whether a value is an aircraft that was validated."""
    return isinstance(value, AirframeFile | DaveMlFile)


def _plainer(problem: Problem) -> Problem:
    """Say more of a derivative that this model cannot have."""
    key = problem.path.rpartition(".")[2]
    if key not in _RATES:
        return problem
    words = (
        f"no derivative by the rate of an angle: added to {key[:2]}_q (or _r), it acts nearly the same in slow motion"
    )
    return Problem(problem.path, problem.arrived, words, problem.whom)
