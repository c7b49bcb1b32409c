"""Where aircraft come from: files beside a scenario, files and F-16 of the library, entry points of other packages.

Reading needs no JAX; what builds arrays is in `anser.scenario.library`.
"""

import copy
import difflib
import functools
import importlib.metadata
import os
from importlib import resources
from pathlib import Path
from typing import Any

from anser.scenario.airframe_file.schema import AirframeFile, validate_airframe
from anser.scenario.airframe_names import AIRFRAMES, FILES
from anser.scenario.errors import refused, show
from anser.scenario.toml_text import read_text, telling_lines, values_of

ENTRY_POINTS = "anser.airframes"
"""Group of entry points that name callables, without arguments, that return an `AbstractAirframe`."""
SUFFIXES = (".toml",)
"""Of the files that an aircraft is read from."""


def read_airframe(path: str | os.PathLike[str]) -> AirframeFile:
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
    if Path(source).suffix not in SUFFIXES:
        words = f"the path of an aircraft file, whose name ends with {' or '.join(SUFFIXES)}"
        raise refused(source, f"a name that ends with {show(Path(source).suffix)}", words)
    return values_of(read_text(path, "aircraft"), source)


@functools.cache
def _values_of_library(name: str) -> dict[str, Any]:
    text = resources.files("anser.aircraft").joinpath(f"data/{name}.toml").read_text(encoding="utf-8")
    return values_of(text, f"{name}.toml of anser")


def library_values(name: str) -> dict[str, Any]:
    """What a file of the library holds."""
    return copy.deepcopy(_values_of_library(name))


@functools.cache
def library_file(name: str) -> AirframeFile:
    """Aircraft file of the library, one of `anser.scenario.airframe_names.FILES`."""
    return validate_airframe(library_values(name), f"{name}.toml of anser")


@functools.cache
def entry_points() -> dict[str, importlib.metadata.EntryPoint]:
    """Airframes that installed packages offer, by name; those of the library come first."""
    found = importlib.metadata.entry_points(group=ENTRY_POINTS)
    return {one.name: one for one in sorted(found, key=lambda one: one.name) if one.name not in AIRFRAMES}


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
