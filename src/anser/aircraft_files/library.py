"""Loading of airframes by name or path: library aircraft, entry points of other packages, and aircraft files."""

import functools
import json
import os
from importlib import resources
from pathlib import Path
from typing import Any

import jax

from anser.aircraft.airframe import AbstractAirframe, refuse_impossible_body
from anser.aircraft.derivative_aircraft import DerivativeAircraft
from anser.aircraft.f16 import F16, AbstractF16, f16_engine_from_data, f16_from_data
from anser.aircraft.global_model import F16Global, global_f16_from_data
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

_concrete = jax.ensure_compile_time_eval()
"""Decorator for loaders of cached airframes: the arrays are concrete even if JAX traces the first caller."""


@functools.cache
def library_data(name: str) -> dict[str, Any]:
    """Read a JSON data file of `anser.aircraft` by its name without suffix; the cached result must not be modified."""
    return json.loads(resources.files("anser.aircraft").joinpath(f"data/{name}.json").read_text(encoding="utf-8"))


@functools.cache
@_concrete
def load_f16(variant: str = "textbook", x_cg_over_c: float | None = None) -> F16:
    """Load an F-16 with the reduced tables of Stevens & Lewis, variant "textbook", "s119" or "founding".

    `x_cg_over_c` is the centre of gravity as a fraction of the mean chord; None: value of the variant. Raises
    ValueError if the variant is unknown.
    """
    return f16_from_data(library_data("f16"), variant, x_cg_over_c)


@functools.cache
@_concrete
def load_tp1538(x_cg_over_c: float | None = None) -> F16TP1538:
    """Load the complete F-16 of NASA TP-1538.

    `x_cg_over_c` is the centre of gravity as a fraction of the mean chord; None: value of the report.
    """
    return tp1538_from_data(library_data("tp1538"), f16_engine_from_data(library_data("f16")), x_cg_over_c)


@functools.cache
@_concrete
def load_global_f16(x_cg_over_c: float | None = None) -> F16Global:
    """Load the F-16 with the global aerodynamic model, with actuators and engine of the textbook's F-16.

    `x_cg_over_c` is the centre of gravity as a fraction of the mean chord; None: value of the source.
    """
    textbook = load_f16()
    return global_f16_from_data(library_data("f16-global"), textbook.actuators, textbook.engine, x_cg_over_c)


@_concrete
def load_airframe(name: str = "f16", variant: str = "textbook", x_cg_over_c: float | None = None) -> AbstractAirframe:
    """Load an airframe from the library, an aircraft file or an entry point of another package.

    Parameters
    ----------
    name
        Element of `sources.AIRFRAMES`, name of an entry point, or path of an aircraft file.
    variant
        Element of `VARIANTS["f16"]` if `name` is "f16"; must be "textbook" for other aircraft.
    x_cg_over_c
        Centre of gravity of the F-16 as a fraction of the mean chord; None: value of the variant.

    Raises
    ------
    ValueError
        Any of these faults:

        - the name or variant is unknown (the message lists the known names);
        - a variant or `x_cg_over_c` is given for another aircraft than the F-16;
        - an entry point returns no airframe, or an airframe with an impossible mass or inertia.
    ScenarioError
        An aircraft file cannot be read or is invalid.
    """
    if name == "f16":
        if variant not in VARIANTS[name]:
            raise ValueError(f"F-16 variant {variant!r}: known are {', '.join(VARIANTS[name])}")
        loaders = {"tp1538": load_tp1538, "global": load_global_f16}
        return loaders[variant](x_cg_over_c) if variant in loaders else load_f16(variant, x_cg_over_c)
    if variant != "textbook":
        raise ValueError(f"variant: arrived {variant!r} with {name!r}; expected none: the F-16 alone has variants")
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
    """Whether a name is the path of an aircraft file (suffix .toml) or of a DAVE-ML file (suffix .dml).

    `read_airframe` refuses the path of a DAVE-ML file, because a DAVE-ML file alone is no aircraft.
    """
    return Path(name).suffix in (*SUFFIXES, DAVE_ML_SUFFIX)


def airframe_of_table(
    kind: str, variant: str, x_cg_over_c: float | None, file: AirframeFile | DaveMlFile | None
) -> AbstractAirframe:
    """Build the airframe of a scenario's [[aircraft]] table from the aircraft file `file`.

    If `file` is None, load the airframe type `kind`; the other arguments are explained in `load_airframe`.
    """
    return load_airframe(kind, variant, x_cg_over_c) if file is None else build_airframe(file)


@functools.cache
def _load_entry_point(name: str) -> AbstractAirframe:
    point = entry_points()[name]
    airframe = point.load()()
    if not isinstance(airframe, AbstractAirframe):
        raise ValueError(f"entry point {name!r} ({point.value}): gave {type(airframe).__name__}; expected an airframe")
    refuse_impossible_body(airframe, f"entry point {name!r} ({point.value})")
    return airframe


def span_of(airframe: AbstractAirframe) -> Any:
    """Return the wing span of an airframe, m. Raises ValueError if the airframe has none."""
    if isinstance(airframe, AbstractF16 | DerivativeAircraft):
        return airframe.span
    span = getattr(airframe, "span", None)
    if span is None:
        raise ValueError(f"{type(airframe).__name__}: has no attribute span, which turbulence asks for")
    return span


@functools.cache
@_concrete
def load_body(name: str) -> SimpleBody:
    """Load an unpowered rigid body of the library (sphere or brick) by a name of `sources.BODIES`.

    Raises ValueError if the name is unknown.
    """
    return body_from_data(library_data("bodies"), name)
