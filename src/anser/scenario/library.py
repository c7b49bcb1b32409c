"""The airframes that come with anser, read from their data files."""

import functools
import json
from importlib import resources
from typing import Any, Literal, overload

from anser.aircraft import F16, F16TP1538, SimpleBody, body_from_data, engine_from_data, f16_from_data, tp1538_from_data
from anser.scenario.airframe_names import AIRFRAMES, VARIANTS


@functools.cache
def _data(name: str) -> dict[str, Any]:
    return json.loads(resources.files("anser.aircraft").joinpath(f"data/{name}.json").read_text(encoding="utf-8"))


@overload
def load_airframe(
    name: Literal["f16"] = "f16",
    variant: Literal["textbook", "s119", "founding"] = "textbook",
    x_cg_over_c: float | None = None,
) -> F16: ...


@overload
def load_airframe(
    name: str = "f16", variant: str = "textbook", x_cg_over_c: float | None = None
) -> F16 | F16TP1538: ...


def load_airframe(name: str = "f16", variant: str = "textbook", x_cg_over_c: float | None = None) -> F16 | F16TP1538:
    """Build an airframe of the library.

    Parameters
    ----------
    name
        One of `anser.scenario.AIRFRAMES`.
    variant
        One of `anser.scenario.VARIANTS[name]`.
    x_cg_over_c
        Centre of gravity as a fraction of the mean chord; the variant's own where None.

    Raises
    ------
    ValueError
        If the name or variant is unknown; the message lists the known ones.
    """
    return _built(name, variant, x_cg_over_c)


@functools.cache
def _built(name: str, variant: str, x_cg_over_c: float | None) -> F16 | F16TP1538:
    if name not in AIRFRAMES:
        raise ValueError(f"aircraft type {name!r}: known are {', '.join(AIRFRAMES)}")
    if variant not in VARIANTS[name]:
        raise ValueError(f"F-16 variant {variant!r}: known are {', '.join(VARIANTS[name])}")
    if variant == "tp1538":
        return tp1538_from_data(_data(variant), engine_from_data(_data(name)), x_cg_over_c)
    return f16_from_data(_data(name), variant, x_cg_over_c)


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
    return body_from_data(_data("bodies"), name)
