"""Suspect points of the library's F-16: of TP-1538's tables, or of those of a reduction."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from anser.aircraft import GriddedTable, suspect_points, tables_of_variant
from anser.scenario.airframe_file.linting import Finding
from anser.scenario.airframe_file.linting_tables import suspicion
from anser.scenario.library import library_data

_NAMES = {"dh": "elevator"}  # as TP-1538 calls its horizontal tail


def f16_findings(variant: str) -> tuple[Finding, ...]:
    """What stands out in the tables of a variant, the worst first; see `anser.aircraft.suspect_points`."""
    names, tables = _tp1538() if variant == "tp1538" else _reduced(variant)
    found = []
    for point in suspect_points(tables):
        of = names.get(point.table, ("alpha", "beta"))
        where = ", ".join(f"{name} {value:g} deg" for name, value in zip(of, point.place, strict=True))
        place = "all tables" if point.table == "all" else f"table {point.table}"
        found.append(Finding(place, f"{where}: {suspicion(point)}"))
    return tuple(found)


def _tp1538() -> tuple[dict[str, tuple[str, ...]], dict[str, GriddedTable]]:
    """What each table is over, and the tables."""
    data = library_data("tp1538")
    values = {name: np.asarray(one["values"], dtype=float) for name, one in data["tables"].items()}
    names, tables = _gridded(data["tables"], values, data["breakpoints_deg"])
    plain = {name: [axis.rstrip("12") for axis in of] for name, of in names.items()}
    return {name: tuple(_NAMES.get(one, one) for one in of) for name, of in plain.items()}, tables


def _reduced(variant: str) -> tuple[dict[str, tuple[str, ...]], dict[str, GriddedTable]]:
    data = library_data("f16")
    axes = {**data["axes"], "elevator_deg": data["variants"][variant]["elevator_axis_deg"]}
    of = {name: one for name, one in data["tables"].items() if not name.startswith("T_")}
    names, tables = _gridded(of, tables_of_variant(data, variant), axes)
    return {name: tuple(axis.removesuffix("_deg") for axis in one) for name, one in names.items()}, tables


def _gridded(
    tables: Mapping[str, Any], values: Mapping[str, np.ndarray], axes: Mapping[str, Sequence[float]]
) -> tuple[dict[str, tuple[str, ...]], dict[str, GriddedTable]]:
    return (
        {name: tuple(one["axes"]) for name, one in tables.items()},
        {
            name: GriddedTable(tuple(np.asarray(axes[axis], dtype=float) for axis in one["axes"]), values[name])
            for name, one in tables.items()
        },
    )
