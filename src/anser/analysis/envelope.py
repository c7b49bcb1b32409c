"""Envelope survey: steady flight at every point of the trim map.

Step commands flown from there, and the dataset of their outcomes.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr

from anser.aircraft.airframe import AbstractAirframe
from anser.analysis.survey_outcomes import (
    OUTCOMES,
    REASONS,
    FlightOutcomes,
    classify_flights,
    flight_coordinates,
    flight_variables,
)
from anser.analysis.trim_maps import (
    COMMANDS,
    CONDITIONS,
    GRID_DIMENSIONS,
    TrimMap,
    limit_attributes,
    survey_limits,
    tolerance_of,
    trim_map,
)
from anser.analysis.trim_points import Inversion, gains_for, resolve_airframe
from anser.compiling.options import compiled, enable_compilation_cache
from anser.control.gains import AutopilotGains
from anser.control.limits import FlightLimits
from anser.environment.environment import Environment, standard_environment
from anser.missions.batches import BATCH, Progress, Stopwatch, SurveyResult, no_progress, run_in_batches
from anser.results.documents import version_attributes
from anser.results.variable_labels import flag_attributes, scatter_rows, unit_attributes
from anser.simulation.survey_flight import SurveySummary, survey_flight
from anser.steady.trim import TRIM_OBSTACLES, TrimPoint, TrimTarget
from anser.units import RAD_DEG


def envelope_dataset(
    trims: TrimMap,
    commands: Mapping[str, str],
    flown: np.ndarray,
    summaries: SurveySummary,
    verdicts: FlightOutcomes,
    attributes: Mapping[str, str | int | float],
) -> xr.Dataset:
    """Label a survey.

    Parameters
    ----------
    trims
        Steady flights that are left.
    commands
        Names and what they mean.
    flown
        Which point (row) was flown with which command (column).
    summaries, verdicts
        Of the flights, in the order of the true entries of `flown`.
    attributes
        Of the whole dataset.

    Returns
    -------
    xr.Dataset
        Over (condition, altitude, mach) the trim map, over (condition, altitude, mach, command) the flights; NaN where
        nothing was flown.
    """
    data = _map_variables(trims)
    for name, (values, labels, over) in flight_variables(summaries, verdicts).items():
        data[name] = ((*GRID_DIMENSIONS, "command", *over), trims.gridded(scatter_rows(values, flown)), labels)
    coordinates = {
        **trims.coordinates("Steady flight that is left"),
        "command": ("command", np.array(list(commands)), unit_attributes("", "Step of the path command")),
        "command_meaning": ("command", np.array(list(commands.values()))),
        **flight_coordinates(trims.surfaces),
    }
    return xr.Dataset(data, coordinates, {**attributes, **version_attributes()})


def _map_variables(trims: TrimMap) -> dict[str, Any]:
    points = trims.points
    trimmable, solved = np.asarray(points.trimmable), np.asarray(points.trim.converged)
    stop = np.where(trimmable, 0, 1 + np.asarray(points.obstacles).argmax(axis=1)).astype(np.int32)

    def where_solved(values: Any, unit: str, words: str, *over: str) -> Any:
        array = np.asarray(values)
        known = np.where(solved.reshape(-1, *(1,) * (array.ndim - 1)), array, np.nan)
        return trims.variable(known * RAD_DEG if unit == "degree" else known, unit, words, *over)

    stop_labels = flag_attributes("What stops the steady flight, the first of several", ("none", *TRIM_OBSTACLES))
    return {
        "trimmable": trims.variable(trimmable, "1", "Whether the steady flight can be flown"),
        "trim_stop": (GRID_DIMENSIONS, trims.gridded(stop), stop_labels),
        "with_reserve": trims.with_reserve(),
        "alpha_deg": where_solved(points.trim.alpha, "degree", "Angle of attack"),
        "bank_deg": where_solved(points.trim.mu, "degree", "Bank about the velocity vector"),
        "power_percent": where_solved(points.trim.power, "percent", "Engine power"),
        "load_factor": where_solved(points.load_factor, "1", "Normal load factor"),
        "surface_deg": where_solved(points.trim.state.surfaces, "degree", "Deflection", "surface"),
        "power_left": where_solved(points.power_margin, "1", "Power left up to the full, part of it"),
        "power_spare": where_solved(points.power_above_idle, "1", "Power that can be taken back, part of the full"),
        "surface_left": where_solved(
            points.surface_margin, "1", "Way left to the stop, part of that from the middle", "surface"
        ),
    }


@dataclasses.dataclass(frozen=True)
class EnvelopeSurvey(SurveyResult):
    """A survey; its dataset: see `anser.analysis.envelope`."""

    def counts(self, *, with_reserve: bool = False) -> dict[str, dict[str, int]]:
        """Flights by "outcome: reason" for each condition, of all points or of those with reserve."""
        outcome, reason = self.dataset["outcome"].values, self.dataset["reason"].values
        if with_reserve:
            outcome = np.where(self.dataset["with_reserve"].values[..., None], outcome, 0)
        found = {}
        for k, what in enumerate(OUTCOMES[1:], start=1):
            for r, why in enumerate(REASONS):
                number = ((outcome == k) & (reason == r)).sum(axis=(1, 2, 3))
                if number.any():
                    name = what if why == "none" else f"{what}: {why}"
                    found[name] = dict(zip(self.dataset["condition"].values.tolist(), number.tolist(), strict=True))
        return found

    def shortfalls(self) -> list[str]:
        """Flights from points with reserve that failed without a named limit, one line each."""
        data = self.dataset
        bad = data["with_reserve"] & (data["reason"] == REASONS.index("unexplained"))
        lines = []
        for c, a, m, k in np.argwhere(bad.transpose("condition", "altitude", "mach", "command").values):
            of = data.isel(condition=c, altitude=a, mach=m, command=k)
            lines.append(
                f"{of.condition_meaning.item()}, {of.altitude.item():.0f} m, Mach {of.mach.item():.3f}, "
                f"{of.command_meaning.item()}: no limit explains why it failed"
            )
        return lines


def survey_envelope(
    aircraft: str | AbstractAirframe = "f16",
    variant: str = "textbook",
    *,
    inversion: Inversion = "model",
    coarse: bool = False,
    altitudes_m: Sequence[float] | None = None,
    machs: Sequence[float] | None = None,
    limits: FlightLimits | None = None,
    duration_s: float = 30.0,
    step_s: float = 0.01,
    progress: Progress | None = None,
) -> EnvelopeSurvey:
    """Survey an aircraft's envelope in the standard atmosphere, in still air.

    Every one of `CONDITIONS` is trimmed at every point of the grid, and every one of `COMMANDS` is flown from every
    point that can be trimmed, under the velocity loop with the published gains and `survey_limits`.

    Parameters
    ----------
    aircraft, variant
        Of the library, or an airframe.
    inversion
        What the autopilot inverts.
    coarse
        A grid of 3 x 5 instead of 16 x 18 points.
    altitudes_m, machs
        Axes of the grid, instead of 250 m to 15 km and Mach 0.15 to 0.95.
    limits
        Of the autopilot; `survey_limits` without them.
    duration_s, step_s
        Of each flight, and of the autopilot's samples.
    progress
        Called with what is being done and the part that is done, 0..1.

    Raises
    ------
    ValueError
        No such airframe, an axis that is not of increasing numbers, or flights of fewer than 100 samples.
    """
    enable_compilation_cache()
    on_progress = progress or no_progress
    count = round(duration_s / step_s)
    if count < 100:
        raise ValueError(f"duration_s: arrived {duration_s:g} with step_s {step_s:g}; expected 100 samples or more")
    airframe, attributes = resolve_airframe(aircraft, variant)
    environment, gains = standard_environment(), gains_for(inversion)
    limits = survey_limits() if limits is None else limits
    clock = Stopwatch()
    on_progress("trimming", 0.0)
    trims = trim_map(clock, airframe, environment, altitudes_m, machs, coarse=coarse)
    points = trims.points
    flown = np.repeat(np.asarray(points.trimmable)[:, None], len(COMMANDS), axis=1)
    sizes = np.array([command.size for command in COMMANDS])
    tolerances = tolerance_of(sizes)
    which, command = np.nonzero(flown)
    flights = _Flights(points.trim, trims.targets, jnp.asarray(sizes), jnp.asarray(tolerances))
    of, step, total = (airframe, environment, gains, limits), jnp.asarray(step_s), len(which)

    def fly(of_batch: np.ndarray) -> SurveySummary:
        return clock.run(_fly, of, flights, jnp.asarray(which[of_batch]), jnp.asarray(command[of_batch]), step, count)

    summaries = run_in_batches(fly, total, BATCH, lambda done: on_progress(f"flying {total} flights", done / total))
    dataset = envelope_dataset(
        trims,
        {c.name: c.meaning for c in COMMANDS},
        flown,
        summaries,
        classify_flights(
            summaries, tolerances[command], count * step_s, _beyond(points.trim, trims.airspeeds, limits)[which]
        ),
        {
            **attributes,
            "inversion": inversion,
            "duration_s": count * step_s,
            "step_s": step_s,
            **limit_attributes(limits),
        },
    )
    return EnvelopeSurvey(dataset, clock.compile_s, clock.run_s)


def _beyond(trim: TrimPoint, airspeeds: np.ndarray, limits: FlightLimits) -> np.ndarray:
    """Whether each point lies beyond limits of the autopilot."""
    alpha, bank = np.asarray(trim.alpha), np.abs(np.asarray(trim.mu))
    speed = np.broadcast_to(airspeeds.ravel(), (len(CONDITIONS), airspeeds.size)).ravel()
    return (
        (alpha < limits.alpha_min)
        | (alpha > limits.alpha_max)
        | (bank > limits.bank_max)
        | (speed < limits.speed_min)
        | (speed > limits.speed_max)
    )


class _Flights(eqx.Module):
    """What the flights start from, over all points, and their commands."""

    trim: TrimPoint
    target: TrimTarget
    sizes: jax.Array
    tolerances: jax.Array


@compiled
def _fly(
    of: tuple[AbstractAirframe, Environment, AutopilotGains, FlightLimits],
    flights: _Flights,
    which: jax.Array,
    command: jax.Array,
    step: jax.Array,
    count: int,
) -> SurveySummary:
    trims, targets = jax.tree.map(lambda leaf: leaf[which], (flights.trim, flights.target))

    def one(trim: TrimPoint, target: TrimTarget, size: jax.Array, tolerance: jax.Array) -> SurveySummary:
        return survey_flight(*of, trim, target, size, tolerance, step, count)

    return jax.vmap(one)(trims, targets, flights.sizes[command], flights.tolerances[command])
