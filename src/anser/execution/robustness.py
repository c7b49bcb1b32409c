"""Robustness study: aircraft that are not what their autopilot believes, flown with both inversions."""

import dataclasses
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np

from anser.aircraft import AbstractF16, F16Dispersion, dispersed_f16
from anser.compiling import compiled, enable_compilation_cache
from anser.control import AutopilotGains, FlightLimits, default_limits
from anser.environment import Environment, standard_environment
from anser.execution.batches import BATCH, Clock, Progress, Study, in_batches, silent
from anser.execution.conditions import ConditionError, Inversion, gains_for
from anser.execution.dispersion import (
    CONDITIONS,
    DELAY_MAX_S,
    FACTORS,
    PARTS,
    Cases,
    FlightPoint,
    alone_cases,
    dispersed_cases,
    dispersion_of,
    spread_cases,
)
from anser.execution.envelope_cases import COMMANDS, described, tolerance_of
from anser.results import judge, robustness_dataset
from anser.scenario import load_airframe
from anser.scenario.schema_aircraft import Gains
from anser.sensing import DelayedSensors, DirectEstimator
from anser.simulation import FlightSummary, MapPoint, TrimPoint, TrimTarget, map_point, survey_flight, trim_target
from anser.units import DEG_RAD

_INVERSIONS: tuple[Inversion, ...] = ("model", "incremental")
_COMMAND = next(command for command in COMMANDS if command.name == "all")
_FLIGHTS_OF_SWEEP = 200


@dataclasses.dataclass(frozen=True)
class RobustnessStudy(Study):
    """A study; its dataset: see `anser.results.robustness_dataset`."""


def robustness_study(
    variant: str = "textbook",
    *,
    flights: int = 1000,
    spread: float = 0.2,
    seed: int = 0,
    sweep: bool = False,
    conditions: Sequence[FlightPoint] = CONDITIONS,
    duration_s: float = 40.0,
    step_s: float = 0.01,
    cases: Cases | None = None,
    progress: Progress | None = None,
) -> RobustnessStudy:
    """Fly dispersed F-16s with the autopilot of the nominal one, in the standard atmosphere and still air.

    Each truth is trimmed in steady level flight and leaves it with the combined command of the envelope survey, under
    the published gains and the default limits: those that a scenario flies with. The autopilot is engaged at that
    instant and knows nothing yet of how the aircraft differs. Both inversions fly the same truths.

    Parameters
    ----------
    variant
        Of the F-16's data.
    flights, spread, seed
        Of the part "dispersed": flights of each inversion, greatest change (0..0.9), and what the draws follow from.
    sweep
        Whether the parts "spread" and "alone" are flown too.
    conditions
        Steady flights that are left.
    duration_s, step_s
        Of each flight, and of the autopilot's samples.
    cases
        What is flown, instead of what `flights`, `spread` and `sweep` say.
    progress
        Called with what is being done and the part that is done, 0..1.

    Raises
    ------
    ConditionError
        The nominal aircraft has no steady flight at a condition, or the command there is beyond the autopilot's speeds.
    ValueError
        No such variant; a number out of range.
    """
    enable_compilation_cache()
    on_progress = progress or silent
    count = round(duration_s / step_s)
    if flights < 1 or not 0.0 <= spread <= 0.9 or count < 100:
        raise ValueError(
            f"arrived flights {flights}, spread {spread:g}, {count} samples; expected 1 or more, 0 to 0.9, 100 or more"
        )
    if cases is None:
        cases = dispersed_cases(flights, spread, seed, len(conditions))
        if sweep:
            cases += spread_cases(_FLIGHTS_OF_SWEEP, seed, len(conditions)) + alone_cases(len(conditions))
    nominal = load_airframe("f16", variant)
    if not isinstance(nominal, AbstractF16):
        raise TypeError(f"expected an F16, not a {type(nominal).__name__}")
    environment, limits = standard_environment(), default_limits()
    points = jax.vmap(trim_target)(
        jnp.asarray([point.speed_m_s for point in conditions]), jnp.asarray([point.altitude_m for point in conditions])
    )
    clock = Clock()

    def trimmed(of: Cases, share: float) -> MapPoint:
        rows = (dispersion_of(of.values)[0], jax.tree.map(lambda leaf: leaf[of.condition], points))
        total = len(of.condition)

        def batch(of_batch: np.ndarray) -> MapPoint:
            return clock.run(_trim, nominal, environment, *jax.tree.map(lambda leaf: leaf[of_batch], rows))

        return in_batches(
            batch, total, BATCH, lambda done: on_progress(f"trimming {total} aircraft", share * done / total)
        )

    _must_be_flown(trimmed(dispersed_cases(len(conditions), 0.0, seed, len(conditions)), 0.0), limits, conditions)
    trims = trimmed(cases, 0.1)
    dispersions, delays = dispersion_of(cases.values)
    targets = jax.tree.map(lambda leaf: leaf[cases.condition], points)
    flown = np.flatnonzero(trims.trimmable)
    alpha = trims.trim.alpha
    beyond = np.asarray((alpha < limits.alpha_min) | (alpha > limits.alpha_max))
    size = np.array(_COMMAND.size)
    tolerance = tolerance_of(size)
    fixed = (nominal, environment, limits, jnp.asarray(size), jnp.asarray(tolerance))
    summaries, verdicts = [], []
    for k, inversion in enumerate(_INVERSIONS):
        gains = gains_for(inversion)

        def fly(of_batch: np.ndarray, gains: AutopilotGains = gains) -> FlightSummary:
            rows = jax.tree.map(lambda leaf: leaf[flown[of_batch]], (dispersions, delays, trims.trim, targets))
            return clock.run(_fly, fixed, gains, *rows, step_s, count)

        def tell(done: int, inversion: str = inversion, k: int = k) -> None:
            on_progress(f"flying {len(flown)} flights, {inversion} inversion", 0.1 + 0.45 * (k + done / len(flown)))

        summaries.append(in_batches(fly, len(flown), BATCH, tell))
        tolerances = np.broadcast_to(tolerance, (len(flown), 3))
        verdicts.append(judge(summaries[-1], tolerances, count * step_s, beyond[flown]))
    dataset = robustness_dataset(
        _INVERSIONS,
        [f"{point.speed_m_s:g} m/s, {point.altitude_m:g} m" for point in conditions],
        {f.name: (f.meaning, f.unit, f.nominal, f.scale) for f in FACTORS},
        PARTS,
        {name: getattr(cases, name) for name in ("part", "condition", "spread", "alone", "values")},
        trims,
        summaries,
        verdicts,
        nominal.actuators.names,
        {
            "aircraft": "f16",
            "variant": variant,
            "command": _COMMAND.meaning,
            "seed": seed,
            "spread_percent": 100 * spread,
            "duration_s": count * step_s,
            "step_s": step_s,
            "sensor_bandwidth_rad_s": Gains().sensor_bandwidth_rad_s,
            "tolerance_airspeed_m_s": float(tolerance[0]),
            "tolerance_path_angle_deg": float(tolerance[1] / DEG_RAD),
            "tolerance_course_deg": float(tolerance[2] / DEG_RAD),
            **described(limits),
        },
    )
    return RobustnessStudy(dataset, clock.compile_s, clock.run_s)


def _must_be_flown(nominal: MapPoint, limits: FlightLimits, conditions: Sequence[FlightPoint]) -> None:
    low, high = float(limits.speed_min), float(limits.speed_max)
    for point, steady in zip(conditions, np.asarray(nominal.trimmable), strict=True):
        if not steady:
            raise ConditionError(
                f"The nominal aircraft has no steady level flight at {point.speed_m_s:g} m/s and {point.altitude_m:g} m"
                " (anser trim says why)."
            )
        if not low <= point.speed_m_s + _COMMAND.speed_m_s <= high or point.speed_m_s < low:
            raise ConditionError(
                f"The autopilot flies {low:g} to {high:g} m/s; {point.speed_m_s:g} m/s and the commanded "
                f"{_COMMAND.speed_m_s:+g} m/s are not within."
            )


@compiled
def _trim(nominal: AbstractF16, environment: Environment, dispersions: F16Dispersion, targets: TrimTarget) -> MapPoint:
    def one(dispersion: F16Dispersion, target: TrimTarget) -> MapPoint:
        return map_point(dispersed_f16(nominal, dispersion), environment, target)

    return jax.vmap(one)(dispersions, targets)


@compiled
def _fly(
    of: tuple[AbstractF16, Environment, FlightLimits, jax.Array, jax.Array],
    gains: AutopilotGains,
    dispersions: F16Dispersion,
    delays: jax.Array,
    trims: TrimPoint,
    targets: TrimTarget,
    step: float,
    count: int,
) -> FlightSummary:
    nominal, environment, limits, size, tolerance = of

    def one(dispersion: F16Dispersion, delay: jax.Array, trim: TrimPoint, target: TrimTarget) -> FlightSummary:
        return survey_flight(
            dispersed_f16(nominal, dispersion),
            environment,
            gains,
            limits,
            trim,
            target,
            size,
            tolerance,
            step,
            count,
            DelayedSensors(delay, DELAY_MAX_S, step),
            DirectEstimator(nominal),
        )

    return jax.vmap(one)(dispersions, delays, trims, targets)
