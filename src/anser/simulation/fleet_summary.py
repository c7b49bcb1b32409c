"""The running summary of a fleet's flight: what is kept where nothing else of a flight is."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from anser.numerics.arrays import cast_to_precision
from anser.parts.perception import Instant
from anser.planning.separation import Separation, separation_ratio
from anser.shapes import Count, Scalar, ScalarLike
from anser.simulation.closed_loop import HOLD, is_off_plan
from anser.simulation.recorders import AbstractRecorder, AircraftSample, FleetSample
from anser.spatial.rotations import safe_hypot, safe_norm

ARRIVAL_MARGIN_S = 10.0
"""How long after its planned arrival an aircraft may still arrive."""


class AirspeedStatistics(eqx.Module):
    """Airspeed of each aircraft so far: its integral over time (m), least and greatest (m/s)."""

    integral: Float[Array, " aircraft"]
    minimum: Float[Array, " aircraft"]
    maximum: Float[Array, " aircraft"]

    def over_interval(self, part: Array, length_s: ScalarLike, before: Array, condition: Array) -> "AirspeedStatistics":
        """With a part (0..1) of one more interval, over which the airspeed changes evenly from `before`."""
        end = before + part * (condition - before)
        return AirspeedStatistics(
            self.integral + 0.5 * part * length_s * (before + end),
            jnp.minimum(self.minimum, end),
            jnp.maximum(self.maximum, end),
        )


class FleetSummary(eqx.Module):
    """What a flight came to, sample by sample; leading axis aircraft but for `separation_min`.

    Attributes
    ----------
    pass_time, pass_distance
        Time of the closest pass of the moving rendezvous (s) and distance then (m), up to 10 s after the planned
        arrival and as long as the plan is flown; between samples the offset is linear in time. Whether this pass is an
        arrival is decided by `anser.results.arrival_outcome`.
    speeds_until_pass
        Up to then, without gusts; their integral over the time of the pass is the mean airspeed.
    position_error_until_pass
        Greatest up to then, while the plan is flown, m: in the hold there is no planned point. -inf where none was
        flown.
    speeds_on_plan, position_error_on_plan
        The same up to `off_plan_time`, or so far.
    off_plan_time
        Time of the first sample with a status for which `is_off_plan` holds, s; infinite before.
    clearance_min
        Least distance from the goal, m.
    tables_left_time
        How long the airframe was outside its data, s.
    first_status, last_status
        The first that was not 0, and the last; index into `STATUS_MESSAGES`.
    separation_min, separation_ratio_min
        Least distance of any two aircraft, m, and at the samples least ratio of distance to separation; infinite for
        one, and where no separation is given.
    finite
        Whether every recorded number of each was one.
    """

    pass_time: Float[Array, " aircraft"]
    pass_distance: Float[Array, " aircraft"]
    speeds_until_pass: AirspeedStatistics
    position_error_until_pass: Float[Array, " aircraft"]
    speeds_on_plan: AirspeedStatistics
    position_error_on_plan: Float[Array, " aircraft"]
    off_plan_time: Float[Array, " aircraft"]
    clearance_min: Float[Array, " aircraft"]
    tables_left_time: Float[Array, " aircraft"]
    first_status: Int[Array, " aircraft"]
    last_status: Int[Array, " aircraft"]
    separation_min: Scalar
    separation_ratio_min: Scalar
    finite: Bool[Array, " aircraft"]


class _PreviousSample(NamedTuple):
    """The sample before, of each aircraft."""

    position_n: Float[Array, "aircraft 3"]
    offset_n: Float[Array, "aircraft 3"]
    airspeed: Float[Array, " aircraft"]


class SummaryRecorder(AbstractRecorder):
    """The running summary; no rows. Memory is the summary so far and the sample before.

    Attributes
    ----------
    separation
        That is asked of the fleet; None: none.
    last
        Number of the last sample that counts; None: all do.
    """

    separation: Separation | None = None
    last_sample: Count | None = None
    stride: int = eqx.field(static=True, default=1)

    def init(self, aircraft: int) -> tuple[FleetSummary, _PreviousSample]:
        """Summary of no sample."""
        zero, none = jnp.zeros(aircraft), jnp.full(aircraft, jnp.inf)
        code = jnp.zeros(aircraft, dtype=jnp.int32)
        speeds = AirspeedStatistics(zero, none, -none)
        summary = FleetSummary(
            pass_time=jnp.full(aircraft, jnp.nan),
            pass_distance=none,
            speeds_until_pass=speeds,
            position_error_until_pass=-none,
            speeds_on_plan=speeds,
            position_error_on_plan=-none,
            off_plan_time=none,
            clearance_min=none,
            tables_left_time=zero,
            first_status=code,
            last_status=code,
            separation_min=jnp.asarray(jnp.inf),
            separation_ratio_min=jnp.asarray(jnp.inf),
            finite=jnp.ones(aircraft, dtype=bool),
        )
        return summary, _PreviousSample(jnp.zeros((aircraft, 3)), jnp.zeros((aircraft, 3)), zero)

    def update(
        self, recorder_state: tuple[FleetSummary, _PreviousSample], sample: FleetSample, instant: Instant
    ) -> tuple[FleetSummary, _PreviousSample]:
        """Summary with one more sample, and with the interval that ends with it."""

        def included() -> tuple[FleetSummary, _PreviousSample]:
            now = cast_to_precision(sample.rows(_of_one), float)  # also of a flight in float32
            return self.include(recorder_state, now, instant.number, cast_to_precision(instant.step, float))

        return (
            included()
            if self.last_sample is None
            else jax.lax.cond(instant.number <= self.last_sample, included, lambda: recorder_state)
        )

    def include(
        self,
        recorder_state: tuple[FleetSummary, _PreviousSample],
        condition: dict[str, Array],
        number: Count,
        step: ScalarLike,
    ) -> tuple[FleetSummary, _PreviousSample]:
        """Summary with the values of one more sample, by the keys of `_of_one`; leading axis aircraft."""
        before, last = recorder_state
        time = number * step
        position_n, offset_n, airspeed = condition["position_n"], condition["offset_n"], condition["airspeed"]
        begun = number > 0
        length_s = jnp.where(begun, step, 0.0)
        # The first sample closes no interval: it is one of no length.
        last = jax.tree.map(
            lambda a, b: jnp.where(begun, a, b),
            last,
            _PreviousSample(position_n, offset_n, airspeed),
        )
        left_s = condition["arrival_time"] + ARRIVAL_MARGIN_S - (time - length_s)
        part, distance = _nearest(last.offset_n, offset_n)
        part = jnp.clip(jnp.minimum(part, left_s / step), 0.0, 1.0)
        distance = jnp.where(left_s >= 0.0, _distance(last.offset_n, offset_n, part), jnp.inf)
        on_plan = jnp.isinf(before.off_plan_time)
        nearer = on_plan & (distance < before.pass_distance)
        until = before.speeds_on_plan.over_interval(part, length_s, last.airspeed, airspeed)
        whole = before.speeds_on_plan.over_interval(jnp.ones_like(airspeed), length_s, last.airspeed, airspeed)
        error_max = jnp.maximum(before.position_error_on_plan, condition["position_error"])
        error_until = jnp.where(part < 1.0, before.position_error_on_plan, error_max)
        pass_time, pass_distance, speeds_until_pass, error_until_pass = _select(
            nearer,
            (time - length_s + part * length_s, distance, until, error_until),
            (before.pass_time, before.pass_distance, before.speeds_until_pass, before.position_error_until_pass),
        )
        speeds_on_plan, error_on_plan = _select(
            on_plan, (whole, error_max), (before.speeds_on_plan, before.position_error_on_plan)
        )
        code = condition["status"]
        summary = FleetSummary(
            pass_time=pass_time,
            pass_distance=pass_distance,
            speeds_until_pass=speeds_until_pass,
            position_error_until_pass=error_until_pass,
            speeds_on_plan=speeds_on_plan,
            position_error_on_plan=error_on_plan,
            off_plan_time=jnp.where(on_plan & is_off_plan(code), time, before.off_plan_time),
            clearance_min=jnp.minimum(before.clearance_min, condition["clearance"]),
            tables_left_time=before.tables_left_time + jnp.where(condition["outside_tables"], step, 0.0),
            first_status=jnp.where(before.first_status == 0, code, before.first_status),
            last_status=code,
            separation_min=jnp.minimum(before.separation_min, _least_separation(last.position_n, position_n)),
            separation_ratio_min=jnp.minimum(before.separation_ratio_min, self._ratio(position_n)),
            finite=before.finite & jnp.isfinite(airspeed) & jnp.all(jnp.isfinite(position_n), axis=1),
        )
        return summary, _PreviousSample(position_n, offset_n, airspeed)

    def _ratio(self, position_n: Float[Array, "aircraft 3"]) -> Scalar:
        """Least ratio of distance to separation of any two of a fleet at a sample."""
        count = position_n.shape[0]
        if self.separation is None or count < 2:
            return jnp.asarray(jnp.inf)
        first, second = jnp.triu_indices(count, 1)
        apart_n = position_n[second] - position_n[first]
        level, height = safe_hypot(apart_n[:, 0], apart_n[:, 1]), jnp.abs(apart_n[:, 2])
        return jnp.min(separation_ratio(level, height, self.separation.horizontal, self.separation.vertical))

    def output(self, sample: FleetSample, instant: Instant) -> None:
        """None."""


def _select(condition: Bool[Array, " aircraft"], new: Any, old: Any) -> Any:
    """The new leaves of the aircraft for which the condition holds, and the old ones of the others."""
    return jax.tree.map(lambda one, other: jnp.where(condition, one, other), new, old)


def _of_one(sample: AircraftSample) -> dict[str, Array]:
    approach, state = sample.approach, sample.truth.state
    assert approach is not None
    assert sample.reference_n is not None
    return {
        "position_n": state.position_n,
        "offset_n": approach.rendezvous_n - state.position_n,
        "airspeed": sample.truth.condition.air_data.V if sample.flow is None else sample.flow.airspeed,
        "clearance": safe_norm(approach.to_goal_n),
        "position_error": jnp.where(approach.phase == HOLD, -jnp.inf, safe_norm(sample.reference_n - state.position_n)),
        "arrival_time": approach.plan.arrival_time,
        "outside_tables": sample.truth.airframe.outside_tables(sample.truth.condition.air_data),
        "status": sample.status,
    }


def _nearest(start_n: Array, end_n: Array) -> tuple[Array, Array]:
    """Part of the way from one offset to another at which it is shortest, and its length there, m; rows of (n, 3)."""
    along_n = end_n - start_n
    square = jnp.sum(along_n**2, axis=-1)
    part = jnp.clip(-jnp.sum(start_n * along_n, axis=-1) / jnp.where(square > 0.0, square, 1.0), 0.0, 1.0)
    return part, _distance(start_n, end_n, part)


def _distance(start_n: Array, end_n: Array, part: Array) -> Array:
    """Length of an offset a part of the way from one to another, m; rows of (n, 3)."""
    return jax.vmap(safe_norm)(start_n + part[:, None] * (end_n - start_n))


def _least_separation(before_n: Array, now_n: Array) -> Scalar:
    """Least distance of any two of a fleet over one interval, m."""
    count = now_n.shape[0]
    if count < 2:
        return jnp.asarray(jnp.inf)
    first, second = jnp.triu_indices(count, 1)
    return jnp.min(_nearest(before_n[second] - before_n[first], now_n[second] - now_n[first])[1])
