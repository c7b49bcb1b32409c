"""Names of all aircraft, reading of aircraft files, data ranges of aircraft, and the starter file.

Aircraft come from the library, from aircraft files and from entry points of other packages. The import of this module
does not import JAX.
"""

import copy
import difflib
import functools
import importlib.metadata
import os
from dataclasses import dataclass
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any, TypeGuard

from pydantic import ValidationError

from anser.aircraft_files.schema import DAVE_ML_PARTS, AirframeFile, DaveMlFile
from anser.airframe_data import COEFFICIENTS
from anser.config.errors import Problem, ScenarioError, check_file_kind, describe_value, os_error_reason, problem_error
from anser.config.file_schema import write_new_file, write_schema
from anser.config.toml_text import attach_line_numbers, parse_toml, read_text
from anser.config.validation_messages import validation_problems
from anser.files import XML_ENCODINGS, decode_xml, read_file

LIBRARY_FILES = {"aerosonde": "aircraft/data", "nasa-f16": "dave_ml/nasa"}
"""Folders, within the package `anser`, of the library airframes that aircraft files define."""
AIRFRAMES = ("f16", *LIBRARY_FILES)
"""Names of the airframes of the library."""
BODIES = ("dragless-sphere", "sphere", "undamped-brick", "brick")
"""Names of the unpowered rigid bodies of the library."""
VARIANTS = {"f16": ("textbook", "s119", "founding", "tp1538", "global")}
"""Variants of library airframes, by airframe."""


_RATE_DERIVATIVES = {f"{coefficient}_{angle}dot" for coefficient in COEFFICIENTS for angle in ("alpha", "beta")}


def validate_airframe(values: dict[str, Any], source: str, *, is_stored: bool = False) -> AirframeFile | DaveMlFile:
    """Validate the values of an aircraft file, nested dictionaries and lists as in TOML, and return the file.

    In a table `dave_ml`, each referenced file must be a table of file name and text. If `is_stored` (file within stored
    results), contradictions between keys are accepted. Raises ScenarioError if the values are invalid. `source` is the
    name of the file in the message.
    """
    check_file_kind("aircraft", values, source)
    version = values.get("format")
    if "format" in values and version != 1:
        raise ScenarioError(source, [Problem("format", describe_value(version), "1, the format that this anser reads")])
    kind = DaveMlFile if "dave_ml" in values else AirframeFile
    try:
        file = kind.model_validate(values, context={"is_stored": is_stored})
    except ValidationError as error:
        problems = validation_problems(error, kind, values)
        raise ScenarioError(source, [_explain_rate_derivative(problem) for problem in problems]) from None
    if isinstance(file, DaveMlFile) and not is_stored:
        from anser.aircraft_files.build import model_problems  # imports JAX

        problems = model_problems(file)
        if problems:
            raise ScenarioError(source, problems)
    return file


def is_aircraft_file(value: object) -> TypeGuard[AirframeFile | DaveMlFile]:
    """Whether a value is a validated aircraft file."""
    return isinstance(value, AirframeFile | DaveMlFile)


def _explain_rate_derivative(problem: Problem) -> Problem:
    """Return `problem`, with advice as expected value if the key is an unsupported derivative such as `Cm_alphadot`."""
    key = problem.path.rpartition(".")[2]
    if key not in _RATE_DERIVATIVES:
        return problem
    explanation = (
        f"no derivative by the rate of an angle: added to {key[:2]}_q (or _r), it acts nearly the same in slow motion"
    )
    return Problem(problem.path, problem.arrived, explanation, problem.subject)


ENTRY_POINTS = "anser.airframes"
"""Group of the entry points for airframes: callables without arguments that return an airframe."""
SUFFIXES = (".toml",)
"""File suffixes of aircraft files."""
DAVE_ML_SUFFIX = ".dml"
"""Suffix of DAVE-ML files, which are referenced from aircraft files."""


def read_airframe(path: str | os.PathLike[str]) -> AirframeFile | DaveMlFile:
    """Read and validate an aircraft file. Raises ScenarioError if the file cannot be read or is no valid aircraft."""
    source = os.fspath(path)
    values = airframe_values(path)
    with attach_line_numbers(read_text(path, "aircraft"), source):
        return validate_airframe(values, source)


def airframe_values(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Read the values of an aircraft file without validation, with the texts of its DAVE-ML files.

    Raises ScenarioError if the suffix is not ".toml", a file cannot be read, or the text is not TOML.
    """
    source, suffix = os.fspath(path), Path(path).suffix
    if suffix == DAVE_ML_SUFFIX:
        expected = "an aircraft file (.toml) that names it under [dave_ml]: a DAVE-ML file has no actuators"
        raise problem_error(source, "a DAVE-ML file", expected)
    if suffix not in SUFFIXES:
        expected = f"the path of an aircraft file, whose name ends with {' or '.join(SUFFIXES)}"
        raise problem_error(source, f"a name that ends with {describe_value(suffix)}", expected)
    return _insert_dave_ml_texts(parse_toml(read_text(path, "aircraft"), source), Path(source).parent, source)


def _insert_dave_ml_texts(values: dict[str, Any], folder: Path | Traversable, source: str) -> dict[str, Any]:
    """Return the values with the paths of DAVE-ML files, relative to `folder`, replaced by tables of name and text."""
    dave_ml = values.get("dave_ml")
    if not isinstance(dave_ml, dict):
        return values
    with_texts = dict(dave_ml)
    for part in DAVE_ML_PARTS:
        path = dave_ml.get(part)
        if isinstance(path, str):
            text = _text_of(folder.joinpath(path), f"dave_ml.{part}", source)
            with_texts[part] = {"file": Path(path).name, "text": text}
    return {**values, "dave_ml": with_texts}


def _text_of(path: Path | Traversable, key: str, source: str) -> str:
    """Read the text of a DAVE-ML file. Raises ScenarioError if the file cannot be read."""
    try:
        return decode_xml(read_file(path))
    except LookupError as error:
        fault, expected = f" in {error.args[0]}", f"one of {', '.join(XML_ENCODINGS)}"
    except UnicodeDecodeError as error:
        fault, expected = f", which is not {error.encoding}", "a text in the encoding that it declares"
    except (OSError, ValueError) as error:
        fault = f", which cannot be read ({os_error_reason(error)})"
        expected = "the path of a DAVE-ML file, seen from the aircraft file"
    raise problem_error(source, f"{describe_value(str(path))}{fault}", expected, key)


@functools.cache
def _values_of_library(name: str) -> dict[str, Any]:
    # importing the folder's package would import JAX
    folder = resources.files("anser").joinpath(*LIBRARY_FILES[name].split("/"))
    text = folder.joinpath(f"{name}.toml").read_text(encoding="utf-8")
    return _insert_dave_ml_texts(parse_toml(text, f"{name}.toml of anser"), folder, f"{name}.toml of anser")


def library_values(name: str) -> dict[str, Any]:
    """Return the values of a library aircraft file (a name of `LIBRARY_FILES`), as a copy that may be modified."""
    return copy.deepcopy(_values_of_library(name))


@functools.cache
def library_file(name: str) -> AirframeFile | DaveMlFile:
    """Return a validated aircraft file of the library, by a name of `LIBRARY_FILES`."""
    return validate_airframe(library_values(name), f"{name}.toml of anser")


@functools.cache
def entry_points() -> dict[str, importlib.metadata.EntryPoint]:
    """Return the entry points for airframes in installed packages, by name, without names of library airframes."""
    points = importlib.metadata.entry_points(group=ENTRY_POINTS)
    return {point.name: point for point in sorted(points, key=lambda point: point.name) if point.name not in AIRFRAMES}


def entry_point_origin(name: str) -> str:
    """Return object reference, distribution and version of an entry point; an empty text if the name is unknown."""
    point = entry_points().get(name)
    if point is None:
        return ""
    return point.value if point.dist is None else f"{point.value} of {point.dist.name} {point.dist.version}"


def aircraft_types() -> tuple[str, ...]:
    """Return the names of all airframes: library airframes, then entry points."""
    return (*AIRFRAMES, *entry_points())


def unknown_type_hint(name: str) -> str:
    """Return a text, for a message about an unknown name, that suggests names of airframes."""
    matches = difflib.get_close_matches(name, aircraft_types(), n=1)
    return (f'perhaps "{matches[0]}"; ' if matches else "") + f"one of {', '.join(aircraft_types())}"


ALTITUDE_MAX_M = 15240.0  # end of the F-16's thrust tables (50,000 ft), [SL] appendix A
SPEED_MAX_M_S = 340.0  # Mach 1, end of the thrust tables
_F16_SPEED_MIN_M_S = 30.0
_F16_ALPHA_DEG = (-10.0, 45.0)  # textbook's tables
_VARIANTS_ALPHA_DEG = {"tp1538": (-20.0, 90.0), "global": (-4.0, 30.0)}


@dataclass(frozen=True)
class AirframeRange:
    """Ranges (minimum, maximum) of an airframe's data; None if a range is unknown before the airframe is built.

    The default limits of a scenario stay within the range of alpha. If `is_from_file`, these limits also stay within
    the range of airspeed.
    """

    name: str
    airspeed_m_s: tuple[float, float] | None  #: True airspeed.
    altitude_m: tuple[float, float] | None  #: None also if an aircraft file states no range.
    alpha_deg: tuple[float, float] | None
    is_from_file: bool  #: True for the range of an aircraft file.


def airframe_range(kind: str, file: AirframeFile | DaveMlFile | None, variant: str = "textbook") -> AirframeRange:
    """Return the data ranges of the airframe in `file`; if `file` is None, of the airframe type `kind`.

    For "f16" the range of alpha depends on `variant`. If the type has no file and is not "f16", the ranges are None.
    """
    if file is None and kind in LIBRARY_FILES:
        file = library_file(kind)
    if file is not None:
        valid = file.validity
        return AirframeRange(file.name, valid.airspeed_m_s, valid.altitude_m, valid.alpha_deg, is_from_file=True)
    if kind == "f16":
        speeds, altitudes = (_F16_SPEED_MIN_M_S, SPEED_MAX_M_S), (0.0, ALTITUDE_MAX_M)
        alphas = _VARIANTS_ALPHA_DEG.get(variant, _F16_ALPHA_DEG)
        name = f"{kind} ({variant})" if variant in _VARIANTS_ALPHA_DEG else kind
        return AirframeRange(name, speeds, altitudes, alphas, is_from_file=False)
    return AirframeRange(kind, None, None, None, is_from_file=False)


AIRCRAFT_SCHEMA = "anser-aircraft.schema.json"
"""File name of the JSON Schema beside an aircraft file, as in the starter's first line."""


def airframe_starter() -> str:
    """Return the text (TOML) of the starter file: a valid light aircraft with comments on its keys."""
    return resources.files("anser.aircraft_files").joinpath("starter.toml").read_text(encoding="utf-8")


def write_airframe_starter(path: str | os.PathLike[str]) -> Path:
    """Write the starter and, if missing, its JSON Schema; return the path of the starter.

    Raises ScenarioError if `path` exists already or cannot be written.
    """
    target = write_new_file(path, airframe_starter())
    write_schema(target, AIRCRAFT_SCHEMA, AirframeFile, "anser aircraft")
    return target
