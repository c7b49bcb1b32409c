"""Envelope survey: steady flight at every point of the trim map, and step commands flown from there."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from anser.aircraft.airframe import AbstractAirframe
from anser.analysis.survey_outcomes import OUTCOMES, REASONS, flight_coordinates, flight_variables
from anser.analysis.surveys import (
    Survey,
    SurveyResult,
    flight_attributes,
    is_beyond_limits,
    sample_count,
    select_rows,
)
from anser.analysis.trim_maps import (
    COMMANDS,
    GRID_DIMENSIONS,
    TrimMap,
    accepted_errors,
    command_meanings,
    speed_scale,
    survey_limits,
    trim_map,
)
from anser.analysis.trim_points import Inversion, resolve_airframe, survey_gains
from anser.compiling.options import compiled
from anser.control.gains import AutopilotGains
from anser.control.limits import FlightLimits
from anser.environment.environment import Environment, standard_environment
from anser.missions.batches import Progress
from anser.results.variable_labels import flag_attributes, scatter_rows, unit_attributes
from anser.simulation.survey_flight import SurveySummary, survey_flight
from anser.steady.trim import TRIM_OBSTACLES, TrimPoint, TrimTarget
from anser.units import RAD_DEG


def _map_variables(trims: TrimMap) -> dict[str, Any]:
    points = trims.points
    trimmable, solved = np.asarray(points.trimmable), np.asarray(points.trim.converged)
    stop = np.where(trimmable, 0, 1 + np.asarray(points.obstacles).argmax(axis=1)).astype(np.int32)

    def solved_variable(values: Any, unit: str, long_name: str, *dimensions: str) -> Any:
        array = np.asarray(values)
        solved_values = np.where(solved.reshape(-1, *(1,) * (array.ndim - 1)), array, np.nan)
        return trims.variable(
            solved_values * RAD_DEG if unit == "degree" else solved_values, unit, long_name, *dimensions
        )

    stop_labels = flag_attributes("What stops the steady flight, the first of several", ("none", *TRIM_OBSTACLES))
    return {
        "trimmable": trims.variable(trimmable, "1", "Whether the steady flight can be flown"),
        "trim_stop": (GRID_DIMENSIONS, trims.gridded(stop), stop_labels),
        "with_reserve": trims.with_reserve(),
        "alpha_deg": solved_variable(points.trim.alpha, "degree", "Angle of attack"),
        "bank_deg": solved_variable(points.trim.mu, "degree", "Bank about the velocity vector"),
        "power_percent": solved_variable(points.trim.power, "percent", "Engine power"),
        "load_factor": solved_variable(points.load_factor, "1", "Normal load factor"),
        "surface_deg": solved_variable(points.trim.state.surfaces, "degree", "Deflection", "surface"),
        "power_left": solved_variable(points.power_margin, "1", "Power left up to the full, part of it"),
        "power_spare": solved_variable(points.power_above_idle, "1", "Power that can be taken back, part of the full"),
        "surface_left": solved_variable(
            points.surface_margin, "1", "Way left to the stop, part of that from the middle", "surface"
        ),
    }


@dataclasses.dataclass(frozen=True)
class EnvelopeSurvey(SurveyResult):
    """Result of an envelope survey.

    Its dataset has the trim map over (condition, altitude, mach) and the flights over (condition, altitude, mach,
    command); NaN without a flight.
    """

    def counts(self, *, with_reserve: bool = False) -> dict[str, dict[str, int]]:
        """Return the number of flights by "outcome: reason" for each condition.

        `with_reserve` selects the flights from points with a reserve of power and surface travel.
        """
        outcome, reason = self.dataset["outcome"].values, self.dataset["reason"].values
        if with_reserve:
            outcome = np.where(self.dataset["with_reserve"].values[..., None], outcome, 0)
        counts = {}
        for outcome_index, outcome_name in enumerate(OUTCOMES[1:], start=1):
            for reason_index, reason_name in enumerate(REASONS):
                number = ((outcome == outcome_index) & (reason == reason_index)).sum(axis=(1, 2, 3))
                if number.any():
                    name = outcome_name if reason_name == "none" else f"{outcome_name}: {reason_name}"
                    counts[name] = dict(zip(self.dataset["condition"].values.tolist(), number.tolist(), strict=True))
        return counts

    def shortfalls(self) -> list[str]:
        """List the failed flights that started with reserve and met no known limit, one line per flight."""
        data = self.dataset
        unexplained = data["with_reserve"] & (data["reason"] == REASONS.index("unexplained"))
        lines = []
        for c, a, m, k in np.argwhere(unexplained.transpose("condition", "altitude", "mach", "command").values):
            flight = data.isel(condition=c, altitude=a, mach=m, command=k)
            lines.append(
                f"{flight.condition_meaning.item()}, {flight.altitude.item():.0f} m, Mach {flight.mach.item():.3f}, "
                f"{flight.command_meaning.item()}: no limit explains why it failed"
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

    Each of `CONDITIONS` is trimmed at each point of the grid, and each of `COMMANDS` is flown from each trimmable
    point, under the velocity loop with `survey_limits` and the gains of `survey_gains`. Speed steps of another aircraft
    than an F-16 are in proportion to the airspeed.

    Parameters
    ----------
    aircraft, variant
        Aircraft: see `resolve_airframe`.
    inversion
        Inversion of the autopilot: of the onboard model, or incremental.
    coarse
        Coarse grid; for the F-16 3 x 5 instead of 16 x 18 points.
    altitudes_m, machs
        Axes of the grid; None: 250 m to 15 km and Mach 0.15 to 0.95 for the F-16, see `default_axes`.
    limits
        Limits of the autopilot; None: `survey_limits`.
    duration_s, step_s
        Duration of a flight; sampling period of the autopilot.
    progress
        Called with a description of the current work and the completed part, 0..1.

    Raises
    ------
    ValueError
        No airframe has this name, an axis is not of increasing numbers, or a flight has fewer than 100 samples.
    """
    count = sample_count(duration_s, step_s)
    survey = Survey(progress)
    airframe, attributes = resolve_airframe(aircraft, variant)
    environment = standard_environment()
    trims = trim_map(survey, airframe, environment, altitudes_m, machs, coarse=coarse)
    limits = survey_limits(airframe, trims.airspeeds) if limits is None else limits
    flown = np.repeat(np.asarray(trims.points.trimmable)[:, None], len(COMMANDS), axis=1)
    point_index, command_index = np.nonzero(flown)
    trim, target = select_rows((trims.points.trim, trims.targets), point_index)
    common_gains, row_gains = survey_gains(airframe, environment, trim, step_s, inversion)
    scale = speed_scale(airframe, np.asarray(target.speed))
    sizes = np.array([command.size for command in COMMANDS])[command_index]
    sizes[:, 0] *= scale
    tolerances = accepted_errors(sizes, scale)
    flights, outcomes = survey.fly(
        f"flying {len(point_index)} flights",
        _fly,
        (airframe, environment, common_gains, limits),
        (trim, target, sizes, tolerances, row_gains),
        jnp.asarray(step_s),
        count,
        tolerances=tolerances,
        start_beyond=is_beyond_limits(trim, target.speed, limits),
    )
    data = _map_variables(trims)
    for name, (values, labels, dimensions) in flight_variables(flights, outcomes).items():
        data[name] = ((*GRID_DIMENSIONS, "command", *dimensions), trims.gridded(scatter_rows(values, flown)), labels)
    coordinates = {
        **trims.coordinates("Steady flight that is left"),
        "command": ("command", np.array([c.name for c in COMMANDS]), unit_attributes("", "Step of the path command")),
        "command_meaning": ("command", np.array(command_meanings(airframe))),
        **flight_coordinates(trims.surfaces),
    }
    attributes |= {"inversion": inversion, **flight_attributes(count, step_s, limits)}
    return survey.result(EnvelopeSurvey, data, coordinates, attributes)


@compiled
def _fly(
    fixed: tuple[AbstractAirframe, Environment, AutopilotGains, FlightLimits],
    rows: tuple[TrimPoint, TrimTarget, jax.Array, jax.Array, AutopilotGains | None],
    step: jax.Array,
    count: int,
) -> SurveySummary:
    airframe, environment, common_gains, limits = fixed

    def fly_step(
        trim: TrimPoint,
        target: TrimTarget,
        size: jax.Array,
        tolerance: jax.Array,
        row_gains: AutopilotGains | None,
    ) -> SurveySummary:
        gains = common_gains if row_gains is None else row_gains
        return survey_flight(airframe, environment, gains, limits, trim, target, size, tolerance, step, count)

    return jax.vmap(fly_step)(*rows)
