"""Aircraft by file: the schema, reading it, what a scenario makes of its names; `build` needs JAX."""

from anser.scenario.airframe_file.reading import (
    ENTRY_POINTS,
    SUFFIXES,
    airframe_values,
    entry_points,
    known_types,
    library_file,
    read_airframe,
    unknown_type,
)
from anser.scenario.airframe_file.schema import AirframeFile, validate_airframe
from anser.scenario.airframe_file.template import airframe_starter, write_airframe_starter

__all__ = [
    "ENTRY_POINTS",
    "SUFFIXES",
    "AirframeFile",
    "airframe_starter",
    "airframe_values",
    "entry_points",
    "known_types",
    "library_file",
    "read_airframe",
    "unknown_type",
    "validate_airframe",
    "write_airframe_starter",
]
