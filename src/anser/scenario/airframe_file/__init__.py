"""Aircraft by file: the schema, reading it, what a scenario makes of its names; building one loads JAX on first use."""

import importlib
from typing import TYPE_CHECKING, Any

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

if TYPE_CHECKING:
    from anser.scenario.airframe_file.build import build_airframe

__all__ = [
    "ENTRY_POINTS",
    "SUFFIXES",
    "AirframeFile",
    "airframe_values",
    "build_airframe",
    "entry_points",
    "known_types",
    "library_file",
    "read_airframe",
    "unknown_type",
    "validate_airframe",
]


def __getattr__(name: str) -> Any:
    """Load what builds arrays on first use."""
    if name != "build_airframe":
        raise AttributeError(f"module 'anser.scenario.airframe_file' has no attribute {name!r}")
    return getattr(importlib.import_module("anser.scenario.airframe_file.build"), name)
