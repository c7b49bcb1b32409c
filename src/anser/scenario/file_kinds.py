"""Files of scenarios, studies and aircraft: told apart where one arrives in the place of another."""

from collections.abc import Mapping
from typing import Any, Literal

from anser.scenario.errors import refused

Kind = Literal["scenario", "study", "aircraft"]
_OWN: dict[Kind, frozenset[str]] = {
    "scenario": frozenset({"timing", "fleet", "aircraft", "goal"}),
    "study": frozenset({"scenario", "sampling", "vary", "rare"}),
    "aircraft": frozenset({"mass", "surface", "aerodynamics", "dave_ml"}),
}
"""Tables by which each is known: no other kind has them."""


def must_be(kind: Kind, values: Mapping[str, Any], source: str) -> None:
    """Refuse values that have nothing of this kind of file and something of another (ScenarioError)."""
    if _OWN[kind] & values.keys():
        return
    for other, own in _OWN.items():
        if own & values.keys():
            command = {
                "scenario": f"anser check {source}",
                "study": f"anser {'rare' if 'rare' in values else 'campaign'} {source} --out FOLDER",
                "aircraft": f"anser aircraft check {source}",
            }[other]
            raise refused(source, f"{_file_of(other)}, by its tables", f"{_file_of(kind)}; for this one: {command}")


def _file_of(kind: Kind) -> str:
    return f"{'an' if kind == 'aircraft' else 'a'} {kind} file"
