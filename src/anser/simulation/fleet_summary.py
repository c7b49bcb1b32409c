"""Running summary of a fleet's flight, in place of a recorded history."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from anser.numerics.arrays import cast_to_precision, select_rows
from anser.parts.perception import Instant
from anser.planning.certified.task import KeepOuts
from anser.planning.separation import Separation, closest_fraction, keep_out_room, separation_ratio
from anser.shapes import Integer, Scalar, ScalarLike
from anser.simulation.closed_loop import HOLD, is_off_plan
from anser.simulation.recorders import AbstractRecorder, AircraftSample, FleetSample
from anser.spatial.rotations import safe_hypot, safe_norm

ARRIVAL_MARGIN_S = 10.0
"""Time after the planned arrival in which a pass of the rendezvous still counts as an arrival, s."""
_SQUARE_MIN = 1e-30  # m^2: keeps derivatives finite for a constant offset


class AirspeedStatistics(eqx.Module):
    """Airspeed of each aircraft since the start: time integral (m), minimum (m/s) and maximum (m/s)."""

    integral: Float[Array, " aircraft"]
    minimum: Float[Array, " aircraft"]
    maximum: Float[Array, " aircraft"]

    def over_interval(
        self, part: Array, length_s: ScalarLike, start_speed: Array, end_speed: Array
    ) -> "AirspeedStatistics":
        """Return the statistics extended by the first `part` (0..1) of an interval of `length_s` seconds.

        The airspeed (m/s) changes linearly from `start_speed` to `end_speed` over the whole interval.
        """
        end = start_speed + part * (end_speed - start_speed)
        return AirspeedStatistics(
            self.integral + 0.5 * part * length_s * (start_speed + end),
            jnp.minimum(self.minimum, end),
            jnp.maximum(self.maximum, end),
        )


class FleetSummary(eqx.Module):
    """Results of a fleet's flight up to the latest sample, SI units.

    The pass is the point of the flight nearest to the moving rendezvous, while the aircraft flies the plan and at most
    10 s after the planned arrival; `anser.results.arrival.arrival_outcome` decides whether the pass is an arrival.
    Positions are interpolated linearly between samples.
    """

    pass_time: Float[Array, " aircraft"]  #: Time of the pass, s; NaN if there is no pass.
    #: Distance from the rendezvous at the pass, m; infinite if there is no pass.
    pass_distance: Float[Array, " aircraft"]
    #: Statistics of the airspeed without gusts up to the pass; integral divided by `pass_time` is the mean airspeed.
    speeds_until_pass: AirspeedStatistics
    #: Greatest distance from the planned position at the samples up to the pass, m. Samples in the hold, which has no
    #: planned position, do not count; -inf if no sample counts.
    position_error_until_pass: Float[Array, " aircraft"]
    #: Statistics of the airspeed up to `off_plan_time`, or up to the latest sample while the plan is flown.
    speeds_on_plan: AirspeedStatistics
    #: Greatest distance from the planned position up to `off_plan_time` or the latest sample, m.
    position_error_on_plan: Float[Array, " aircraft"]
    #: Time of the first sample with an `is_off_plan` status, s; infinite if there is no such sample.
    off_plan_time: Float[Array, " aircraft"]
    clearance_min: Float[Array, " aircraft"]  #: Least distance from the goal at the samples, m.
    tables_left_time: Float[Array, " aircraft"]  #: Time outside the range of the airframe's data, s.
    first_status: Int[Array, " aircraft"]  #: First non-zero status, index into `STATUS_MESSAGES`; 0: no event.
    last_status: Int[Array, " aircraft"]  #: Last non-zero status, index into `STATUS_MESSAGES`; 0: no event.
    #: Least distance between any two aircraft, also between the samples, m; infinite for a single aircraft.
    separation_min: Scalar
    #: Least ratio of distance to required separation at the samples; infinite if no separation is required.
    separation_ratio_min: Scalar
    #: Least distance outside the keep-outs at the samples, m; negative inside, infinite if there are no keep-outs.
    keep_out_room_min: Float[Array, " aircraft"]
    finite: Bool[Array, " aircraft"]  #: Whether position and airspeed were finite at every sample.


class _PreviousSample(NamedTuple):
    """Signals of the previous sample."""

    position_n: Float[Array, "aircraft 3"]  # NED, m
    offset_n: Float[Array, "aircraft 3"]  # from the aircraft to the rendezvous, NED, m
    airspeed: Float[Array, " aircraft"]  # without gusts, m/s


class SummaryRecorder(AbstractRecorder):
    """Recorder that keeps a summary of the flight so far and stores no time history.

    The recorder's state is the pair (summary, signals of the previous sample).
    """

    separation: Separation | None = None  #: Separation required of the fleet; None: no requirement.
    last_sample: Integer | None = None  #: Number of the last sample that the summary includes; None: no limit.
    keep_outs: KeepOuts | None = None  #: Keep-outs (cylinders that no path may enter); None: no keep-outs.
    stride: int = eqx.field(static=True, default=1)

    def init(self, aircraft: int) -> tuple[FleetSummary, _PreviousSample]:
        """Return the recorder's state before the first sample; `aircraft` is the number of aircraft."""
        zero, infinite = jnp.zeros(aircraft), jnp.full(aircraft, jnp.inf)
        code = jnp.zeros(aircraft, dtype=jnp.int32)
        speeds = AirspeedStatistics(zero, infinite, -infinite)
        summary = FleetSummary(
            pass_time=jnp.full(aircraft, jnp.nan),
            pass_distance=infinite,
            speeds_until_pass=speeds,
            position_error_until_pass=-infinite,
            speeds_on_plan=speeds,
            position_error_on_plan=-infinite,
            off_plan_time=infinite,
            clearance_min=infinite,
            tables_left_time=zero,
            first_status=code,
            last_status=code,
            separation_min=jnp.asarray(jnp.inf),
            separation_ratio_min=jnp.asarray(jnp.inf),
            keep_out_room_min=infinite,
            finite=jnp.ones(aircraft, dtype=bool),
        )
        return summary, _PreviousSample(jnp.zeros((aircraft, 3)), jnp.zeros((aircraft, 3)), zero)

    def update(
        self, recorder_state: tuple[FleetSummary, _PreviousSample], sample: FleetSample, instant: Instant
    ) -> tuple[FleetSummary, _PreviousSample]:
        """Return the recorder's state after one more sample; unchanged after `last_sample`."""

        def extended() -> tuple[FleetSummary, _PreviousSample]:
            inputs = cast_to_precision(sample.rows(_summary_inputs), float)  # also for flights in float32
            return self.include(recorder_state, inputs, instant.number, cast_to_precision(instant.step, float))

        return (
            extended()
            if self.last_sample is None
            else jax.lax.cond(instant.number <= self.last_sample, extended, lambda: recorder_state)
        )

    def include(
        self,
        recorder_state: tuple[FleetSummary, _PreviousSample],
        inputs: dict[str, Array],
        number: Integer,
        step: ScalarLike,
    ) -> tuple[FleetSummary, _PreviousSample]:
        """Return the recorder's state after sample `number`; `step` is the sampling period, s.

        `inputs` must be the results of `_summary_inputs` with a leading axis of aircraft.
        """
        past, previous = recorder_state
        time = number * step
        position_n, offset_n, airspeed = inputs["position_n"], inputs["offset_n"], inputs["airspeed"]
        has_interval = number > 0
        length_s = jnp.where(has_interval, step, 0.0)
        # The first sample has no previous sample: the interval has length 0.
        current = _PreviousSample(position_n, offset_n, airspeed)
        previous = jax.tree.map(lambda a, b: jnp.where(has_interval, a, b), previous, current)
        time_left_s = inputs["arrival_time"] + ARRIVAL_MARGIN_S - (time - length_s)
        part = closest_fraction(previous.offset_n, offset_n - previous.offset_n, _SQUARE_MIN)
        part = jnp.clip(jnp.minimum(part, time_left_s / step), 0.0, 1.0)
        distance = jnp.where(time_left_s >= 0.0, _offset_length(previous.offset_n, offset_n, part), jnp.inf)
        on_plan = jnp.isinf(past.off_plan_time)
        is_closer = on_plan & (distance < past.pass_distance)
        speeds_to_part = past.speeds_on_plan.over_interval(part, length_s, previous.airspeed, airspeed)
        speeds_to_end = past.speeds_on_plan.over_interval(
            jnp.ones_like(airspeed), length_s, previous.airspeed, airspeed
        )
        error_max = jnp.maximum(past.position_error_on_plan, inputs["position_error"])
        error_to_part = jnp.where(part < 1.0, past.position_error_on_plan, error_max)
        pass_time, pass_distance, speeds_until_pass, error_until_pass = select_rows(
            is_closer,
            (time - length_s + part * length_s, distance, speeds_to_part, error_to_part),
            (past.pass_time, past.pass_distance, past.speeds_until_pass, past.position_error_until_pass),
        )
        speeds_on_plan, error_on_plan = select_rows(
            on_plan, (speeds_to_end, error_max), (past.speeds_on_plan, past.position_error_on_plan)
        )
        code = inputs["status"]
        summary = FleetSummary(
            pass_time=pass_time,
            pass_distance=pass_distance,
            speeds_until_pass=speeds_until_pass,
            position_error_until_pass=error_until_pass,
            speeds_on_plan=speeds_on_plan,
            position_error_on_plan=error_on_plan,
            off_plan_time=jnp.where(on_plan & is_off_plan(code), time, past.off_plan_time),
            clearance_min=jnp.minimum(past.clearance_min, inputs["clearance"]),
            tables_left_time=past.tables_left_time + jnp.where(inputs["outside_tables"], length_s, 0.0),
            first_status=jnp.where(past.first_status == 0, code, past.first_status),
            last_status=jnp.where(code == 0, past.last_status, code),
            separation_min=jnp.minimum(past.separation_min, _interval_separation(previous.position_n, position_n)),
            separation_ratio_min=jnp.minimum(past.separation_ratio_min, self._ratio(position_n)),
            keep_out_room_min=jnp.minimum(past.keep_out_room_min, self._keep_out_room(position_n, time)),
            finite=past.finite & jnp.isfinite(airspeed) & jnp.all(jnp.isfinite(position_n), axis=1),
        )
        return summary, current

    def _ratio(self, position_n: Float[Array, "aircraft 3"]) -> Scalar:
        """Return the least ratio of distance to required separation of any two aircraft; infinite if there is none."""
        count = position_n.shape[0]
        if self.separation is None or count < 2:
            return jnp.asarray(jnp.inf)
        i, j = jnp.triu_indices(count, 1)
        offset_n = position_n[j] - position_n[i]
        horizontal, vertical = safe_hypot(offset_n[:, 0], offset_n[:, 1]), jnp.abs(offset_n[:, 2])
        return jnp.min(separation_ratio(horizontal, vertical, self.separation.horizontal, self.separation.vertical))

    def _keep_out_room(self, position_n: Float[Array, "aircraft 3"], time: Scalar) -> Float[Array, " aircraft"]:
        """Return each aircraft's distance outside the nearest keep-out, m; negative inside, infinite if none exists."""
        if self.keep_outs is None or self.keep_outs.radius.shape[0] == 0:
            return jnp.full(position_n.shape[0], jnp.inf)
        volumes = self.keep_outs

        def room(aircraft_n: Array) -> Scalar:
            offset_n = volumes.position_n + time * volumes.velocity_n - aircraft_n[None, :2]
            distance = safe_hypot(offset_n[:, 0], offset_n[:, 1])
            return jnp.min(keep_out_room(distance, -aircraft_n[2], volumes.radius, volumes.bottom, volumes.top))

        return jax.vmap(room)(position_n)

    def output(self, sample: FleetSample, instant: Instant) -> None:
        """Return None: the recorder stores no rows."""


def _summary_inputs(sample: AircraftSample) -> dict[str, Array]:
    plan, approach, state = sample.plan, sample.approach, sample.truth.state
    assert plan is not None
    assert approach is not None
    assert sample.reference_n is not None
    return {
        "position_n": state.position_n,
        "offset_n": approach.rendezvous_n - state.position_n,
        "airspeed": sample.truth.condition.air_data.V if sample.flow is None else sample.flow.airspeed,
        "clearance": safe_norm(approach.to_goal_n),
        "position_error": jnp.where(approach.phase == HOLD, -jnp.inf, safe_norm(sample.reference_n - state.position_n)),
        "arrival_time": plan.arrival_time,
        "outside_tables": sample.truth.airframe.outside_tables(sample.truth.condition.air_data),
        "status": sample.status,
    }


def _offset_length(start_n: Array, end_n: Array, part: Array) -> Array:
    """Return the lengths of offsets interpolated between `start_n` and `end_n` at the fraction `part` (0..1)."""
    return jax.vmap(safe_norm)(start_n + part[:, None] * (end_n - start_n))


def _interval_separation(start_n: Array, end_n: Array) -> Scalar:
    """Return the least distance (m) between aircraft on lines from `start_n` to `end_n`; infinite for one aircraft."""
    count = end_n.shape[0]
    if count < 2:
        return jnp.asarray(jnp.inf)
    i, j = jnp.triu_indices(count, 1)
    first_n, last_n = start_n[j] - start_n[i], end_n[j] - end_n[i]
    return jnp.min(_offset_length(first_n, last_n, closest_fraction(first_n, last_n - first_n, _SQUARE_MIN)))
