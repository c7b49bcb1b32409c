"""Stability margins of the autopilot: at one trim point with the responses, and over the trim map of the envelope."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr

from anser.aircraft import AbstractAirframe, AbstractF16
from anser.compiling import compiled, enable_compilation_cache
from anser.control import AutopilotGains, FlightLimits
from anser.environment import Environment, standard_environment
from anser.execution.batches import Clock, Progress, Study, in_batches, silent
from anser.execution.conditions import ConditionError, Inversion, airframe_of, gains_for, map_points, own_gains
from anser.execution.envelope_cases import described, survey_limits, trim_map
from anser.results import (
    CLOSED_LOOP,
    finite_or_none,
    margin_dataset,
    margin_map_dataset,
    margin_table,
    plain_attributes,
)
from anser.simulation import (
    HELD_BACK,
    LoopAnalysis,
    LoopCase,
    LoopResponse,
    MemoryFields,
    TrimPoint,
    analyse_loops,
    breakpoints,
    loop_memory,
    nearest_trims,
    trim_target,
)

_FORMAT_VERSION = 1
_BATCH = 32
"""Points of one compiled call: the responses of more do not stay in the processors' caches."""


@dataclasses.dataclass(frozen=True)
class MarginSurvey(Study):
    """Margins over the envelope; the dataset: see `anser.results.margin_map_dataset`."""

    def counts(self) -> dict[str, int]:
        """Points by what the closed loop is there."""
        states = self.dataset["closed_loop"].values
        return {what: int((states == k).sum()) for k, what in enumerate(CLOSED_LOOP)}

    def shortfalls(self) -> list[str]:
        """Points where the loop is unstable or, at some breakpoints, a margin falls short; one line each."""
        names = self.dataset["breakpoint"].values.tolist()
        lines = []
        states = self.dataset["closed_loop"].values
        for c, a, m in np.argwhere(
            (states == CLOSED_LOOP.index("unstable")) | self.dataset["short"].values.any(axis=-1)
        ):
            of = self.dataset.isel(condition=c, altitude=a, mach=m)
            place = f"{of.condition_meaning.item()}, {of.altitude.item():.0f} m, Mach {of.mach.item():.3f}"
            if states[c, a, m] == CLOSED_LOOP.index("unstable"):
                lines.append(f"{place}: unstable, pole {_pole(of)}")
                continue
            for name in names:
                at = of.sel(breakpoint=name)
                if at["short"].item():
                    lines.append(
                        f"{place}, {name}: {at['gain_margin_db'].item():.1f} dB, "
                        f"{at['phase_margin_deg'].item():.1f} deg"
                    )
        return lines

    def document(self) -> dict[str, Any]:
        """Counts and the table of the breakpoints, plain data for JSON."""
        return {
            "format_version": _FORMAT_VERSION,
            "survey": plain_attributes(self.dataset.attrs),
            "points": self.counts(),
            "with_reserve": int(self.dataset["with_reserve"].sum()),
            "compile_s": round(self.compile_s, 3),
            "run_s": round(self.run_s, 3),
            "breakpoints_with_reserve": margin_table(self.dataset),
            "breakpoints_all": margin_table(self.dataset, with_reserve=False),
            "shortfalls": self.shortfalls(),
        }


def margins_at(
    aircraft: str | AbstractAirframe = "f16",
    variant: str = "textbook",
    *,
    speed_m_s: float,
    altitude_m: float,
    inversion: Inversion = "model",
    step_s: float = 0.01,
    gains: AutopilotGains | None = None,
) -> xr.Dataset:
    """Margins of the whole autopilot in level flight, in the standard atmosphere and still air.

    One loop at a time is broken, all others stay closed.

    Parameters
    ----------
    aircraft, variant
        Of the library, or an airframe.
    speed_m_s, altitude_m
        True airspeed and geometric altitude.
    inversion
        What the autopilot inverts.
    step_s
        Of the autopilot's samples.
    gains
        Instead of the published ones of the F-16, or of the aircraft's own.

    Returns
    -------
    xr.Dataset
        As `anser.results.margin_dataset` makes it.

    Raises
    ------
    ConditionError
        There is no such steady flight, a command of the autopilot stands at a limit in it, or the closed loop is
        unstable: no margin exists. The message says which.
    ValueError
        No such airframe.
    """
    enable_compilation_cache()
    airframe, of = airframe_of(aircraft, variant)
    environment, limits = standard_environment(), _limits_around(airframe, speed_m_s)
    target = trim_target(speed_m_s, altitude_m)
    points = map_points(airframe, environment, jax.tree.map(lambda leaf: leaf[None], target))
    if not bool(points.trimmable[0]):
        raise ConditionError(nearest_trims(airframe, environment, target).message())
    trim = jax.tree.map(lambda leaf: leaf[0], points.trim)
    wanted = own_gains(airframe, environment, trim, step_s, inversion) if gains is None else gains_for(inversion, gains)
    # the survey's batch, filled with the one point: compiled once for both
    trims = jax.tree.map(lambda leaf: jnp.repeat(leaf, _BATCH, axis=0), points.trim)
    analysed = _analyse(
        airframe, environment, wanted, limits, trims, jnp.asarray(step_s), loop_memory(wanted, airframe)
    )
    found, response = jax.tree.map(lambda leaf: leaf[0], analysed)
    attributes = {**of, "speed_m_s": speed_m_s, "altitude_m": altitude_m, "inversion": inversion}
    dataset = margin_dataset(found, response, breakpoints(airframe), step_s, attributes)
    state = CLOSED_LOOP[dataset["closed_loop"].item()]
    if state == "held_back":
        which = ", ".join(name for name, at in zip(HELD_BACK, dataset["limited"].values, strict=True) if at)
        raise ConditionError(
            f"The autopilot does not hold this flight: its command stands at a limit ({which}), where the loop is open."
        )
    if state == "unstable":
        raise ConditionError(f"The closed loop is unstable, pole {_pole(dataset)}: there are no margins.")
    return dataset


def _limits_around(airframe: AbstractAirframe, speed_m_s: float) -> FlightLimits:
    """Limits of the survey, which suit an F-16; of another airframe half to twice the airspeed asked about."""
    limits = survey_limits()
    if isinstance(airframe, AbstractF16):
        return limits
    ends = jnp.asarray(0.5 * speed_m_s, dtype=float), jnp.asarray(2.0 * speed_m_s, dtype=float)
    limits = eqx.tree_at(lambda own: (own.speed_min, own.speed_max), limits, ends)
    return eqx.tree_at(lambda own: (own.alpha_min, own.alpha_max), limits, airframe.alpha_range)


def survey_margins(
    aircraft: str | AbstractAirframe = "f16",
    variant: str = "textbook",
    *,
    inversion: Inversion = "model",
    coarse: bool = False,
    altitudes_m: Sequence[float] | None = None,
    machs: Sequence[float] | None = None,
    step_s: float = 0.01,
    gains: AutopilotGains | None = None,
    progress: Progress | None = None,
) -> MarginSurvey:
    """Margins at every point of the envelope's trim map that can be flown steadily, in the standard atmosphere.

    The steady flights are the envelope survey's `CONDITIONS`, its limits `survey_limits`.

    Parameters
    ----------
    aircraft, variant, inversion, step_s, gains
        As of `margins_at`.
    coarse, altitudes_m, machs, progress
        As of `anser.execution.survey`.

    Raises
    ------
    ValueError
        No such airframe, an axis that is not of increasing numbers, or no point of the grid can be flown.
    """
    enable_compilation_cache()
    on_progress = progress or silent
    airframe, of = airframe_of(aircraft, variant)
    environment, limits = standard_environment(), survey_limits()
    wanted = gains_for(inversion, gains)
    clock, memory = Clock(), loop_memory(wanted, airframe)
    on_progress("trimming", 0.0)
    trims = trim_map(clock, airframe, environment, altitudes_m, machs, coarse=coarse)
    which = np.flatnonzero(np.asarray(trims.points.trimmable))
    total = which.size

    def of_batch(numbers: np.ndarray) -> LoopAnalysis:
        some = jax.tree.map(lambda leaf: leaf[which[numbers]], trims.points.trim)
        return clock.run(_analyse, airframe, environment, wanted, limits, some, jnp.asarray(step_s), memory)[0]

    found = in_batches(
        of_batch, total, _BATCH, lambda k: on_progress(f"breaking the loops at {total} points", k / total)
    )
    attributes = {**of, "inversion": inversion, **described(limits)}
    dataset = margin_map_dataset(trims, found, breakpoints(airframe), step_s, attributes)
    return MarginSurvey(dataset, clock.compile_s, clock.run_s)


def margin_document(dataset: xr.Dataset) -> dict[str, Any]:
    """Margins of one trim point, as `margins_at` finds them, in plain data for JSON; what is infinite is None."""
    rows = []
    for name in dataset["breakpoint"].values.tolist():
        of = dataset.sel(breakpoint=name)
        figures = {key: of[key].item() for key, of_key in dataset.data_vars.items() if of_key.dims == ("breakpoint",)}
        rows.append(
            {
                "breakpoint": name,
                **{key: value if key == "short" else finite_or_none(value) for key, value in figures.items()},
            }
        )
    return {
        "format_version": _FORMAT_VERSION,
        "condition": plain_attributes(dataset.attrs),
        "actuators_disk_margin": dataset["actuators_disk_margin"].item(),
        "breakpoints": rows,
    }


@compiled
def _analyse(
    airframe: AbstractAirframe,
    environment: Environment,
    gains: AutopilotGains,
    limits: FlightLimits,
    trims: TrimPoint,
    step: jax.Array,
    memory: MemoryFields,
) -> tuple[LoopAnalysis, LoopResponse]:
    def one(trim: TrimPoint) -> tuple[LoopAnalysis, LoopResponse]:
        return analyse_loops(LoopCase(airframe, environment, gains, limits, trim, step), memory)

    return jax.vmap(one)(trims)


def _pole(at: xr.Dataset) -> str:
    real, imaginary = at["pole_real_1_s"].item(), at["pole_imag_1_s"].item()
    return f"{real:+.3g} 1/s" if not imaginary else f"{real:+.3g} +- {imaginary:.3g}i 1/s"
