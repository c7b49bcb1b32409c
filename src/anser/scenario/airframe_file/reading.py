"""Where aircraft come from: files beside a scenario, files and F-16 of the library, entry points of other packages.

Reading needs no JAX; what builds arrays is in `anser.scenario.library`.
"""

import copy
import difflib
import functools
import importlib.metadata
import os
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any

from anser.input_files import XML_ENCODINGS, read_file, xml_text
from anser.scenario.airframe_file.schema import AirframeFile
from anser.scenario.airframe_file.schema_dave_ml import PARTS, DaveMlFile
from anser.scenario.airframe_file.validating import validate_airframe
from anser.scenario.airframe_names import AIRFRAMES, FILES
from anser.scenario.errors import reason_of, refused, show
from anser.scenario.toml_text import read_text, telling_lines, values_of

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
    with telling_lines(read_text(path, "aircraft"), source):
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
        raise refused(source, "a DAVE-ML file", words)
    if Path(source).suffix not in SUFFIXES:
        words = f"the path of an aircraft file, whose name ends with {' or '.join(SUFFIXES)}"
        raise refused(source, f"a name that ends with {show(Path(source).suffix)}", words)
    return _with_texts(values_of(read_text(path, "aircraft"), source), Path(source).parent, source)


def _with_texts(values: dict[str, Any], folder: Path | Traversable, source: str) -> dict[str, Any]:
    """Values of an aircraft file, the texts of DAVE-ML files in the places of their paths."""
    named = values.get("dave_ml")
    if not isinstance(named, dict):
        return values
    held = dict(named)
    for part in PARTS:
        path = named.get(part)
        if isinstance(path, str):
            held[part] = {"file": Path(path).name, "text": _text_of(folder.joinpath(path), f"dave_ml.{part}", source)}
    return {**values, "dave_ml": held}


def _text_of(path: Path | Traversable, key: str, source: str) -> str:
    """Text of a DAVE-ML file in the encoding that it declares."""
    try:
        content = read_file(path)
    except (OSError, ValueError) as error:
        arrived = f"{show(str(path))}, which cannot be read ({reason_of(error)})"
        raise refused(source, arrived, "the path of a DAVE-ML file, seen from the aircraft file", key) from None
    try:
        return xml_text(content)
    except LookupError as error:
        arrived = f"{show(str(path))} in {error.args[0]}"
        raise refused(source, arrived, f"one of {', '.join(XML_ENCODINGS)}", key) from None
    except UnicodeDecodeError as error:
        arrived = f"{show(str(path))}, which is not {error.encoding}"
        raise refused(source, arrived, "a text in the encoding that it declares", key) from None


@functools.cache
def _values_of_library(name: str) -> dict[str, Any]:
    place = resources.files("anser").joinpath(*FILES[name].split("/"))  # its own package would bring JAX
    text = place.joinpath(f"{name}.toml").read_text(encoding="utf-8")
    return _with_texts(values_of(text, f"{name}.toml of anser"), place, f"{name}.toml of anser")


def library_values(name: str) -> dict[str, Any]:
    """What a file of the library holds."""
    return copy.deepcopy(_values_of_library(name))


@functools.cache
def library_file(name: str) -> AirframeFile | DaveMlFile:
    """Aircraft file of the library, one of `anser.scenario.airframe_names.FILES`."""
    return validate_airframe(library_values(name), f"{name}.toml of anser")


@functools.cache
def entry_points() -> dict[str, importlib.metadata.EntryPoint]:
    """Airframes that installed packages offer, by name; those of the library come first."""
    found = importlib.metadata.entry_points(group=ENTRY_POINTS)
    return {one.name: one for one in sorted(found, key=lambda one: one.name) if one.name not in AIRFRAMES}


def origin_of(name: str) -> str:
    """What an entry point names, and the distribution with its version; empty for another name."""
    point = entry_points().get(name)
    if point is None:
        return ""
    return point.value if point.dist is None else f"{point.value} of {point.dist.name} {point.dist.version}"


def known_types() -> tuple[str, ...]:
    """Names of all airframes: the library's, then those of entry points."""
    return (*AIRFRAMES, *entry_points())


def unknown_type(name: str) -> str:
    """What would be right instead of a name that no airframe has."""
    near = difflib.get_close_matches(name, known_types(), n=1)
    return (f'perhaps "{near[0]}"; ' if near else "") + f"one of {', '.join(known_types())}"


def is_file(name: str) -> bool:
    """Whether an airframe of the library is an aircraft file."""
    return name in FILES
