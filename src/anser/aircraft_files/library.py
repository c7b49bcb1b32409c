"""Airframes by name or file: the library's, those of entry points, and aircraft files."""

import functools
import json
import os
from importlib import resources
from pathlib import Path
from typing import Any

from anser.aircraft.airframe import AbstractAirframe, refuse_impossible_body
from anser.aircraft.derivative_aircraft import DerivativeAircraft
from anser.aircraft.f16 import F16, AbstractF16, f16_engine_from_data, f16_from_data
from anser.aircraft.simple_body import SimpleBody, body_from_data
from anser.aircraft.tp1538 import F16TP1538, tp1538_from_data
from anser.aircraft_files.build import build_airframe
from anser.aircraft_files.schema import AirframeFile, DaveMlFile
from anser.aircraft_files.sources import (
    DAVE_ML_SUFFIX,
    LIBRARY_FILES,
    SUFFIXES,
    VARIANTS,
    entry_points,
    library_file,
    read_airframe,
    unknown_type_hint,
)


@functools.cache
def library_data(name: str) -> dict[str, Any]:
    """A data file of the library's airframes, by its name without ending; not to be changed."""
    return json.loads(resources.files("anser.aircraft").joinpath(f"data/{name}.json").read_text(encoding="utf-8"))


@functools.cache
def load_f16(variant: str = "textbook", x_cg_over_c: float | None = None) -> F16:
    """Build the F-16 of the library in one of its reductions.

    Parameters
    ----------
    variant
        One of `anser.scenario.VARIANTS["f16"]` but "tp1538", which is another airframe.
    x_cg_over_c
        Centre of gravity as a fraction of the mean chord; the variant's own where None.

    Raises
    ------
    ValueError
        If the variant is unknown; the message lists the known ones.
    """
    return f16_from_data(library_data("f16"), variant, x_cg_over_c)


@functools.cache
def load_tp1538(x_cg_over_c: float | None = None) -> F16TP1538:
    """Build the complete F-16 of NASA TP-1538; its own centre of gravity (part of the mean chord) where None."""
    return tp1538_from_data(library_data("tp1538"), f16_engine_from_data(library_data("f16")), x_cg_over_c)


def load_airframe(name: str = "f16", variant: str = "textbook", x_cg_over_c: float | None = None) -> AbstractAirframe:
    """Build an airframe.

    Parameters
    ----------
    name
        One of `anser.scenario.AIRFRAMES`, the name of an entry point, or the path of an aircraft file.
    variant, x_cg_over_c
        Of the F-16 alone: see `load_f16`.

    Raises
    ------
    ValueError
        If the name or variant is unknown; the message lists the known ones. Or if an entry point gives no airframe, or
        one of a body that is not possible.
    ScenarioError
        If an aircraft file cannot be read or is none.
    """
    if name == "f16":
        if variant not in VARIANTS[name]:
            raise ValueError(f"F-16 variant {variant!r}: known are {', '.join(VARIANTS[name])}")
        return load_tp1538(x_cg_over_c) if variant == "tp1538" else load_f16(variant, x_cg_over_c)
    if x_cg_over_c is not None:
        raise ValueError(f"x_cg_over_c: arrived {x_cg_over_c} with {name!r}; expected None: the F-16 alone has it")
    if is_aircraft_path(name):
        return build_airframe(read_airframe(name))
    if name in LIBRARY_FILES:
        return build_airframe(library_file(name))
    if name in entry_points():
        return _load_entry_point(name)
    raise ValueError(f"aircraft type {name!r}: {unknown_type_hint(name)}, or the path of an aircraft file")


def is_aircraft_path(name: str | os.PathLike[str]) -> bool:
    """Whether a name is meant as the path of an aircraft file, or of a DAVE-ML file, which reading refuses."""
    return Path(name).suffix in (*SUFFIXES, DAVE_ML_SUFFIX)


def airframe_of_table(
    kind: str, variant: str, x_cg_over_c: float | None, file: AirframeFile | DaveMlFile | None
) -> AbstractAirframe:
    """Airframe of a table [[aircraft]] of a scenario: its file, or its type."""
    return load_airframe(kind, variant, x_cg_over_c) if file is None else build_airframe(file)


@functools.cache
def _load_entry_point(name: str) -> AbstractAirframe:
    point = entry_points()[name]
    made = point.load()()
    if not isinstance(made, AbstractAirframe):
        raise ValueError(f"entry point {name!r} ({point.value}): gave {type(made).__name__}; expected an airframe")
    refuse_impossible_body(made, f"entry point {name!r} ({point.value})")
    return made


def span_of(airframe: AbstractAirframe) -> Any:
    """Wing span (m) of an airframe, which turbulence asks for; ValueError where it has none."""
    if isinstance(airframe, AbstractF16 | DerivativeAircraft):
        return airframe.span
    span = getattr(airframe, "span", None)
    if span is None:
        raise ValueError(f"{type(airframe).__name__}: has no attribute span, which turbulence asks for")
    return span


@functools.cache
def load_body(name: str) -> SimpleBody:
    """Build an unpowered rigid body of the library, for free flight.

    Parameters
    ----------
    name
        One of `anser.scenario.BODIES`.

    Raises
    ------
    ValueError
        If the name is unknown; the message lists the known ones.
    """
    return body_from_data(library_data("bodies"), name)
