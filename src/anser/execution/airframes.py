"""What there is of airframes, and what one is: for people and for documents."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from anser.aircraft import AbstractAirframe, DaveMlEngine, ElectricPropeller, JetEngine, NoEngine, PistonPropeller
from anser.aircraft.f16_engine import F16Engine
from anser.compiling import enable_compilation_cache
from anser.execution.airframe_survey import flown_airspeeds
from anser.scenario import AIRFRAMES, VARIANTS, load_airframe
from anser.scenario.airframe_file import AirframeFile, DaveMlFile, entry_points, library_file, read_airframe
from anser.scenario.airframe_file.checking import Compared, compare
from anser.scenario.airframe_file.linting import Finding, lint
from anser.scenario.airframe_file.model_check import ModelCheck, check_model
from anser.scenario.airframe_names import FILES
from anser.scenario.f16_tables import f16_findings
from anser.scenario.library import is_path
from anser.units import RAD_DEG


@dataclass(frozen=True)
class ListedAirframe:
    """One airframe of a list; without numbers where an entry point could not be loaded, whose `problem` says why."""

    name: str
    origin: str
    mass_kg: float | None = None
    span_m: float | None = None
    airspeed_m_s: tuple[float, float] | None = None
    surfaces: tuple[str, ...] = ()
    problem: str | None = None


def list_airframes() -> list[ListedAirframe]:
    """Airframes of the library, then those of entry points."""
    found = [_listed(name, "library, file" if name in FILES else "library") for name in AIRFRAMES]
    for name, point in entry_points().items():
        origin = f"entry point {point.value}"
        try:
            found.append(_listed(name, origin))
        except (ImportError, AttributeError, TypeError, ValueError) as error:
            found.append(ListedAirframe(name, origin, problem=f"{type(error).__name__}: {error}"))
    return found


def _listed(name: str, origin: str) -> ListedAirframe:
    airframe = load_airframe(name)
    span = getattr(airframe, "span", None)
    return ListedAirframe(
        name,
        origin,
        float(airframe.mass_properties.mass),
        None if span is None else float(span),
        flown_airspeeds(airframe),
        airframe.actuators.names,
    )


def file_of(name: str) -> AirframeFile | DaveMlFile | None:
    """Aircraft file of a name of the library or of a path; None for another airframe."""
    if is_path(name):
        return read_airframe(name)
    return library_file(name) if name in FILES else None


_ENGINES: dict[type, str] = {
    DaveMlEngine: "thrust as its DAVE-ML file has it",
    ElectricPropeller: "electric motor with propeller",
    F16Engine: "jet engine of the F-16",
    JetEngine: "jet engine",
    NoEngine: "none",
    PistonPropeller: "piston engine with propeller",
}
"""In words; another one, from code of a user's own, has the name of its class."""


def described_airframe(airframe: AbstractAirframe) -> list[tuple[str, str, str]]:
    """Quantities of an airframe: name, value, unit."""
    properties, actuators = airframe.mass_properties, airframe.actuators
    J = np.asarray(properties.inertia_b)
    rows = [("mass", f"{float(properties.mass):.6g}", "kg")]
    rows += [(f"J{axis}", f"{J[k, k]:.6g}", "kg m^2") for k, axis in enumerate(("xx", "yy", "zz"))]
    rows += [
        (f"J{name}", f"{-J[at]:.6g}", "kg m^2")
        for name, at in (("xy", (0, 1)), ("xz", (0, 2)), ("yz", (1, 2)))
        if J[at] != 0.0
    ]
    for words, name, unit in (
        ("span", "span", "m"),
        ("wing area", "wing_area", "m^2"),
        ("mean chord", "mean_chord", "m"),
    ):
        value = getattr(airframe, name, None)
        rows += [] if value is None else [(words, f"{float(value):.6g}", unit)]
    lower, upper = (np.asarray(end) * RAD_DEG for end in (actuators.lower, actuators.upper))
    for k, name in enumerate(actuators.names):
        speed, lag = float(actuators.rate_limit[k]) * RAD_DEG, float(actuators.time_constant[k])
        rows.append((name, f"{lower[k]:.4g} to {upper[k]:.4g}", f"deg, {speed:.4g} deg/s, lag {lag:.3g} s"))
    kind = type(airframe.engine)
    rows.append(("engine", _ENGINES.get(kind, kind.__name__), ""))
    for words, ends in (("angles of attack", airframe.alpha_range), ("sideslip angles", airframe.beta_range)):
        low, high = (float(end) * RAD_DEG for end in ends)
        rows.append((f"data valid for {words}", f"{low:.4g} to {high:.4g}", "deg"))
    low, high = flown_airspeeds(airframe)
    rows.append(("data valid for airspeeds", f"{low:.4g} to {high:.4g}", "m/s"))
    return rows


def trimmed_speeds(dataset: Any) -> tuple[float, float] | None:
    """Slowest and fastest airspeed of a survey at which level flight is within all limits; None: at none."""
    speeds: Sequence[float] = dataset["airspeed"].values[dataset["trimmable"].values]
    return (float(min(speeds)), float(max(speeds))) if len(speeds) else None


def check_dave_ml(path: str) -> ModelCheck:
    """Check data of a DAVE-ML file compared with what comes out, what looks wrong, inputs and outputs.

    Raises
    ------
    ScenarioError
        No DAVE-ML file.
    """
    enable_compilation_cache()
    return check_model(path)


def check_airframe(aircraft: str, variant: str = "textbook") -> tuple[tuple[Compared, ...], tuple[Finding, ...]]:
    """Check data of an aircraft compared with what comes out, and what looks wrong: of the F-16, points of its tables.

    Raises
    ------
    ValueError
        An airframe of an entry point: no file or table of it is known.
    ScenarioError
        No valid aircraft file.
    """
    enable_compilation_cache()
    file = file_of(aircraft)
    if file is not None:
        return compare(file), lint(file)
    if aircraft not in VARIANTS:
        raise ValueError(f"{aircraft!r} is an airframe in code, without a file or tables that could be checked")
    return (), f16_findings(variant)
