"""Sources of aircraft: names of the library, aircraft files and entry points of other packages.

Reading and validating an aircraft file, its data ranges, and the starter file. Without JAX.
"""

import copy
import difflib
import functools
import importlib.metadata
import os
from dataclasses import dataclass
from importlib import resources
from importlib.resources import files
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
"""Airframes of the library that are aircraft files: folder of each within this package."""
AIRFRAMES = ("f16", *LIBRARY_FILES)
BODIES = ("dragless-sphere", "sphere", "undamped-brick", "brick")
VARIANTS = {"f16": ("textbook", "s119", "founding", "tp1538")}
"""Variants of the airframes that have any."""


_RATES = {f"{row}_{kind}dot" for row in COEFFICIENTS for kind in ("alpha", "beta")}


def validate_airframe(values: dict[str, Any], source: str) -> AirframeFile | DaveMlFile:
    """Validate an aircraft that is at hand as nested dictionaries and lists, as its TOML file would hold them.

    One with a table `dave_ml`, whose files are held as tables of their name and text, is built by them.

    Raises
    ------
    ScenarioError
        If it is no valid one; the message names file, key, what arrived and what would be right.
    """
    check_file_kind("aircraft", values, source)
    version = values.get("format")
    if "format" in values and version != 1:
        raise ScenarioError(source, [Problem("format", describe_value(version), "1, the format that this anser reads")])
    kind = DaveMlFile if "dave_ml" in values else AirframeFile
    try:
        file = kind.model_validate(values)
    except ValidationError as error:
        problems = validation_problems(error, kind, values)
        raise ScenarioError(source, [_explain_rate_derivative(problem) for problem in problems]) from None
    if isinstance(file, DaveMlFile):
        from anser.aircraft_files.build import model_problems  # here: it loads JAX

        problems = model_problems(file)
        if problems:
            raise ScenarioError(source, problems)
    return file


def is_aircraft_file(value: object) -> TypeGuard[AirframeFile | DaveMlFile]:
    """Whether a value is an aircraft that was validated."""
    return isinstance(value, AirframeFile | DaveMlFile)


def _explain_rate_derivative(problem: Problem) -> Problem:
    """Say more of a derivative that this model cannot have."""
    key = problem.path.rpartition(".")[2]
    if key not in _RATES:
        return problem
    words = (
        f"no derivative by the rate of an angle: added to {key[:2]}_q (or _r), it acts nearly the same in slow motion"
    )
    return Problem(problem.path, problem.arrived, words, problem.whom)


ENTRY_POINTS = "anser.airframes"
"""Group of entry points that name callables, without arguments, that return an `AbstractAirframe`."""
SUFFIXES = (".toml",)
"""Of the files that an aircraft is read from."""
DAVE_ML_SUFFIX = ".dml"
"""Of those that only an aircraft file names."""


def read_airframe(path: str | os.PathLike[str]) -> AirframeFile | DaveMlFile:
    """Read and validate the file of an aircraft.

    Raises
    ------
    ScenarioError
        If the file cannot be read or is no valid aircraft; the message says where and what would be right.
    """
    source = os.fspath(path)
    values = airframe_values(path)
    with attach_line_numbers(read_text(path, "aircraft"), source):
        return validate_airframe(values, source)


def airframe_values(path: str | os.PathLike[str]) -> dict[str, Any]:
    """What the file of an aircraft holds, not validated yet.

    The one door for files of aircraft: another format is told by its suffix here.

    Raises
    ------
    ScenarioError
        If the file cannot be read, or is of a kind that no aircraft is read from.
    """
    source = os.fspath(path)
    if Path(source).suffix == DAVE_ML_SUFFIX:
        words = "an aircraft file (.toml) that names it under [dave_ml]: a DAVE-ML file has no actuators"
        raise problem_error(source, "a DAVE-ML file", words)
    if Path(source).suffix not in SUFFIXES:
        words = f"the path of an aircraft file, whose name ends with {' or '.join(SUFFIXES)}"
        raise problem_error(source, f"a name that ends with {describe_value(Path(source).suffix)}", words)
    return _insert_dave_ml_texts(parse_toml(read_text(path, "aircraft"), source), Path(source).parent, source)


def _insert_dave_ml_texts(values: dict[str, Any], folder: Path | Traversable, source: str) -> dict[str, Any]:
    """Values of an aircraft file, the texts of DAVE-ML files in the places of their paths."""
    named = values.get("dave_ml")
    if not isinstance(named, dict):
        return values
    held = dict(named)
    for part in DAVE_ML_PARTS:
        path = named.get(part)
        if isinstance(path, str):
            held[part] = {"file": Path(path).name, "text": _text_of(folder.joinpath(path), f"dave_ml.{part}", source)}
    return {**values, "dave_ml": held}


def _text_of(path: Path | Traversable, key: str, source: str) -> str:
    """Text of a DAVE-ML file in the encoding that it declares."""
    try:
        content = read_file(path)
    except (OSError, ValueError) as error:
        arrived = f"{describe_value(str(path))}, which cannot be read ({os_error_reason(error)})"
        raise problem_error(source, arrived, "the path of a DAVE-ML file, seen from the aircraft file", key) from None
    try:
        return decode_xml(content)
    except LookupError as error:
        arrived = f"{describe_value(str(path))} in {error.args[0]}"
        raise problem_error(source, arrived, f"one of {', '.join(XML_ENCODINGS)}", key) from None
    except UnicodeDecodeError as error:
        arrived = f"{describe_value(str(path))}, which is not {error.encoding}"
        raise problem_error(source, arrived, "a text in the encoding that it declares", key) from None


@functools.cache
def _values_of_library(name: str) -> dict[str, Any]:
    place = resources.files("anser").joinpath(*LIBRARY_FILES[name].split("/"))  # its own package would bring JAX
    text = place.joinpath(f"{name}.toml").read_text(encoding="utf-8")
    return _insert_dave_ml_texts(parse_toml(text, f"{name}.toml of anser"), place, f"{name}.toml of anser")


def library_values(name: str) -> dict[str, Any]:
    """What a file of the library holds."""
    return copy.deepcopy(_values_of_library(name))


@functools.cache
def library_file(name: str) -> AirframeFile | DaveMlFile:
    """Aircraft file of the library, one of `anser.aircraft_files.sources.LIBRARY_FILES`."""
    return validate_airframe(library_values(name), f"{name}.toml of anser")


@functools.cache
def entry_points() -> dict[str, importlib.metadata.EntryPoint]:
    """Airframes that installed packages offer, by name; those of the library come first."""
    found = importlib.metadata.entry_points(group=ENTRY_POINTS)
    return {one.name: one for one in sorted(found, key=lambda one: one.name) if one.name not in AIRFRAMES}


def entry_point_origin(name: str) -> str:
    """What an entry point names, and the distribution with its version; empty for another name."""
    point = entry_points().get(name)
    if point is None:
        return ""
    return point.value if point.dist is None else f"{point.value} of {point.dist.name} {point.dist.version}"


def aircraft_types() -> tuple[str, ...]:
    """Names of all airframes: the library's, then those of entry points."""
    return (*AIRFRAMES, *entry_points())


def unknown_type_hint(name: str) -> str:
    """What would be right instead of a name that no airframe has."""
    near = difflib.get_close_matches(name, aircraft_types(), n=1)
    return (f'perhaps "{near[0]}"; ' if near else "") + f"one of {', '.join(aircraft_types())}"


def is_library_file(name: str) -> bool:
    """Whether an airframe of the library is an aircraft file."""
    return name in LIBRARY_FILES


ALTITUDE_MAX_M = 15240.0  # the end of the F-16's thrust tables (50,000 ft), [SL] appendix A
SPEED_MAX_M_S = 340.0  # those end at Mach 1
_F16_SPEED_MIN_M_S = 30.0
_F16_ALPHA_DEG = (-10.0, 45.0)


@dataclass(frozen=True)
class AirframeRange:
    """Ranges of one airframe; None: nothing known of it before it is built.

    Parameters
    ----------
    name
        Of the airframe.
    airspeed_m_s, altitude_m, alpha_deg
        Least and greatest.
    by_file
        Whether it is an aircraft file, whose ranges the limits of a scenario follow where it gives none.
    """

    name: str
    airspeed_m_s: tuple[float, float] | None
    altitude_m: tuple[float, float] | None
    alpha_deg: tuple[float, float] | None
    is_from_file: bool


def airframe_range(kind: str, file: AirframeFile | DaveMlFile | None) -> AirframeRange:
    """Ranges of an airframe by its type, or by its file where it has one."""
    if file is None and kind in LIBRARY_FILES:
        file = library_file(kind)
    if file is not None:
        valid = file.validity
        return AirframeRange(file.name, valid.airspeed_m_s, valid.altitude_m, valid.alpha_deg, is_from_file=True)
    if kind == "f16":
        speeds, altitudes = (_F16_SPEED_MIN_M_S, SPEED_MAX_M_S), (0.0, ALTITUDE_MAX_M)
        return AirframeRange(kind, speeds, altitudes, _F16_ALPHA_DEG, is_from_file=False)
    return AirframeRange(kind, None, None, None, is_from_file=False)


AIRCRAFT_SCHEMA = "anser-aircraft.schema.json"
"""Name of the JSON Schema beside an aircraft file, as the first line of the starter has it."""


def airframe_starter() -> str:
    """Text (TOML) of the starter: a light aircraft, every key commented; a valid one."""
    return files("anser.aircraft_files").joinpath("starter.toml").read_text(encoding="utf-8")


def write_airframe_starter(path: str | os.PathLike[str]) -> Path:
    """Write the starter to a new file, and its schema beside it; as `anser.scenario.write_starter`."""
    target = write_new_file(path, airframe_starter())
    write_schema(target, AIRCRAFT_SCHEMA, AirframeFile, "anser aircraft")
    return target
