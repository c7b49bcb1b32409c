"""Envelope survey: where the aircraft can fly steadily, and whether its autopilot flies commands from there."""

import dataclasses
from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from anser.aircraft import AbstractAirframe
from anser.compiling import compiled, enable_compilation_cache
from anser.control import AutopilotGains, FlightLimits
from anser.environment import Environment, standard_environment
from anser.execution.batches import BATCH, Clock, Progress, Study, in_batches, silent
from anser.execution.conditions import Inversion, airframe_of, gains_for
from anser.execution.envelope_cases import (
    COMMANDS,
    CONDITIONS,
    described,
    survey_limits,
    tolerance_of,
    trim_map,
)
from anser.results import OUTCOMES, REASONS, envelope_dataset, judge
from anser.simulation import FlightSummary, TrimPoint, TrimTarget, survey_flight


@dataclasses.dataclass(frozen=True)
class EnvelopeSurvey(Study):
    """A survey; its dataset: see `anser.results.envelope_dataset`."""

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


def survey(
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
    on_progress = progress or silent
    count = round(duration_s / step_s)
    if count < 100:
        raise ValueError(f"duration_s: arrived {duration_s:g} with step_s {step_s:g}; expected 100 samples or more")
    airframe, attributes = airframe_of(aircraft, variant)
    environment, gains = standard_environment(), gains_for(inversion)
    limits = survey_limits() if limits is None else limits
    clock = Clock()
    on_progress("trimming", 0.0)
    trims = trim_map(clock, airframe, environment, altitudes_m, machs, coarse=coarse)
    points = trims.points
    flown = np.repeat(np.asarray(points.trimmable)[:, None], len(COMMANDS), axis=1)
    sizes = np.array([command.size for command in COMMANDS])
    tolerances = tolerance_of(sizes)
    which, command = np.nonzero(flown)
    flights = _Flights(points.trim, trims.targets, jnp.asarray(sizes), jnp.asarray(tolerances))
    of, step, total = (airframe, environment, gains, limits), jnp.asarray(step_s), len(which)

    def fly(of_batch: np.ndarray) -> FlightSummary:
        return clock.run(_fly, of, flights, jnp.asarray(which[of_batch]), jnp.asarray(command[of_batch]), step, count)

    summaries = in_batches(fly, total, BATCH, lambda done: on_progress(f"flying {total} flights", done / total))
    dataset = envelope_dataset(
        trims,
        {c.name: c.meaning for c in COMMANDS},
        flown,
        summaries,
        judge(summaries, tolerances[command], count * step_s, _beyond(points.trim, trims.airspeeds, limits)[which]),
        {**attributes, "inversion": inversion, "duration_s": count * step_s, "step_s": step_s, **described(limits)},
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
) -> FlightSummary:
    trims, targets = jax.tree.map(lambda leaf: leaf[which], (flights.trim, flights.target))

    def one(trim: TrimPoint, target: TrimTarget, size: jax.Array, tolerance: jax.Array) -> FlightSummary:
        return survey_flight(*of, trim, target, size, tolerance, step, count)

    return jax.vmap(one)(trims, targets, flights.sizes[command], flights.tolerances[command])
