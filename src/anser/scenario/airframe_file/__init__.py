"""Aircraft by file: the schema, reading it, what a scenario makes of its names; `build` needs JAX."""

from anser.scenario.airframe_file.reading import (
    DAVE_ML_SUFFIX,
    ENTRY_POINTS,
    SUFFIXES,
    airframe_values,
    entry_points,
    known_types,
    library_file,
    origin_of,
    read_airframe,
    unknown_type,
)
from anser.scenario.airframe_file.schema import AirframeFile
from anser.scenario.airframe_file.schema_dave_ml import DaveMlFile
from anser.scenario.airframe_file.template import airframe_starter, write_airframe_starter
from anser.scenario.airframe_file.validating import is_file, validate_airframe

__all__ = [
    "DAVE_ML_SUFFIX",
    "ENTRY_POINTS",
    "SUFFIXES",
    "AirframeFile",
    "DaveMlFile",
    "airframe_starter",
    "airframe_values",
    "entry_points",
    "is_file",
    "known_types",
    "library_file",
    "origin_of",
    "read_airframe",
    "unknown_type",
    "validate_airframe",
    "write_airframe_starter",
]
