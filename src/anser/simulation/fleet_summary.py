"""The running summary of a fleet's flight: what is kept where nothing else of a flight is."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from anser.numerics import in_precision
from anser.planning import separation_ratio
from anser.planning.separation import Separation
from anser.sensing import Instant
from anser.shapes import Count, Scalar, ScalarLike
from anser.simulation.closed_loop import HOLD
from anser.simulation.recorder import AbstractRecorder, AircraftSample, FleetSample
from anser.spatial import safe_hypot, safe_norm

ARRIVAL_MARGIN_S = 10.0
"""How long after its planned arrival an aircraft may still arrive."""


class Speeds(eqx.Module):
    """Airspeed of each aircraft so far: its integral over time (m), least and greatest (m/s)."""

    integral: Float[Array, " aircraft"]
    least: Float[Array, " aircraft"]
    greatest: Float[Array, " aircraft"]

    def until(self, part: Array, length_s: ScalarLike, before: Array, now: Array) -> "Speeds":
        """With a part (0..1) of one more interval, over which the airspeed changes evenly from `before`."""
        end = before + part * (now - before)
        return Speeds(
            self.integral + 0.5 * part * length_s * (before + end),
            jnp.minimum(self.least, end),
            jnp.maximum(self.greatest, end),
        )


class FleetSummary(eqx.Module):
    """What a flight came to, sample by sample; leading axis aircraft but for `separation_min`.

    Attributes
    ----------
    arrival_time, miss
        Time of the closest pass of the moving rendezvous (s) and distance then (m), up to 10 s after the planned
        arrival; between samples the offset is linear in time.
    speeds_until_arrival
        Up to then, without gusts; their integral over the arrival time is the mean airspeed.
    position_error_max
        Up to then, while the plan is flown, m: in the hold there is no planned point. -inf where none was flown.
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

    arrival_time: Float[Array, " aircraft"]
    miss: Float[Array, " aircraft"]
    speeds_until_arrival: Speeds
    position_error_max: Float[Array, " aircraft"]
    clearance_min: Float[Array, " aircraft"]
    tables_left_time: Float[Array, " aircraft"]
    first_status: Int[Array, " aircraft"]
    last_status: Int[Array, " aircraft"]
    separation_min: Scalar
    separation_ratio_min: Scalar
    finite: Bool[Array, " aircraft"]


class _PreviousSample(NamedTuple):
    """The sample before, of each aircraft, and what had come up to then."""

    position_n: Float[Array, "aircraft 3"]
    offset_n: Float[Array, "aircraft 3"]
    airspeed: Float[Array, " aircraft"]
    speeds: Speeds
    position_error_max: Float[Array, " aircraft"]


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
    last: Count | None = None
    every: int = eqx.field(static=True, default=1)

    def init(self, aircraft: int) -> tuple[FleetSummary, _PreviousSample]:
        """Summary of no sample."""
        zero, none = jnp.zeros(aircraft), jnp.full(aircraft, jnp.inf)
        code = jnp.zeros(aircraft, dtype=jnp.int32)
        speeds = Speeds(zero, none, -none)
        summary = FleetSummary(
            arrival_time=jnp.full(aircraft, jnp.nan),
            miss=none,
            speeds_until_arrival=speeds,
            position_error_max=-none,
            clearance_min=none,
            tables_left_time=zero,
            first_status=code,
            last_status=code,
            separation_min=jnp.asarray(jnp.inf),
            separation_ratio_min=jnp.asarray(jnp.inf),
            finite=jnp.ones(aircraft, dtype=bool),
        )
        return summary, _PreviousSample(jnp.zeros((aircraft, 3)), jnp.zeros((aircraft, 3)), zero, speeds, -none)

    def take(
        self, memory: tuple[FleetSummary, _PreviousSample], sample: FleetSample, instant: Instant
    ) -> tuple[FleetSummary, _PreviousSample]:
        """Summary with one more sample, and with the interval that ends with it."""
        if self.last is None:
            return self._taken(memory, sample, instant)
        return jax.lax.cond(instant.number <= self.last, lambda: self._taken(memory, sample, instant), lambda: memory)

    def _taken(
        self, memory: tuple[FleetSummary, _PreviousSample], sample: FleetSample, instant: Instant
    ) -> tuple[FleetSummary, _PreviousSample]:
        before, last = memory
        now = in_precision(sample.rows(_of_one), float)  # also of a flight in float32
        step = in_precision(instant.step, float)
        time = instant.number * step
        position_n, offset_n, airspeed = now["position_n"], now["offset_n"], now["airspeed"]
        begun = instant.number > 0
        length_s = jnp.where(begun, step, 0.0)
        # The first sample closes no interval: it is one of no length.
        last = jax.tree.map(
            lambda a, b: jnp.where(begun, a, b),
            last,
            last._replace(position_n=position_n, offset_n=offset_n, airspeed=airspeed),
        )
        left_s = now["arrival_time"] + ARRIVAL_MARGIN_S - (time - length_s)
        part, distance = _nearest(last.offset_n, offset_n)
        part = jnp.clip(jnp.minimum(part, left_s / step), 0.0, 1.0)
        distance = jnp.where(left_s >= 0.0, _distance(last.offset_n, offset_n, part), jnp.inf)
        nearer = distance < before.miss
        until = last.speeds.until(part, length_s, last.airspeed, airspeed)
        error_max = jnp.maximum(last.position_error_max, now["position_error"])
        error_until = jnp.where(part < 1.0, last.position_error_max, error_max)
        arrived = jax.tree.map(
            lambda new, old: jnp.where(nearer, new, old),
            (time - length_s + part * length_s, distance, until, error_until),
            (before.arrival_time, before.miss, before.speeds_until_arrival, before.position_error_max),
        )
        code = now["status"]
        summary = FleetSummary(
            arrival_time=arrived[0],
            miss=arrived[1],
            speeds_until_arrival=arrived[2],
            position_error_max=arrived[3],
            clearance_min=jnp.minimum(before.clearance_min, now["clearance"]),
            tables_left_time=before.tables_left_time + jnp.where(now["outside_tables"], step, 0.0),
            first_status=jnp.where(before.first_status == 0, code, before.first_status),
            last_status=code,
            separation_min=jnp.minimum(before.separation_min, _least_separation(last.position_n, position_n)),
            separation_ratio_min=jnp.minimum(before.separation_ratio_min, self._ratio(position_n)),
            finite=before.finite & jnp.isfinite(airspeed) & jnp.all(jnp.isfinite(position_n), axis=1),
        )
        whole = last.speeds.until(jnp.ones_like(airspeed), length_s, last.airspeed, airspeed)
        return summary, _PreviousSample(position_n, offset_n, airspeed, whole, error_max)

    def _ratio(self, position_n: Float[Array, "aircraft 3"]) -> Scalar:
        """Least ratio of distance to separation of any two of a fleet at a sample."""
        count = position_n.shape[0]
        if self.separation is None or count < 2:
            return jnp.asarray(jnp.inf)
        first, second = jnp.triu_indices(count, 1)
        apart_n = position_n[second] - position_n[first]
        level, height = safe_hypot(apart_n[:, 0], apart_n[:, 1]), jnp.abs(apart_n[:, 2])
        return jnp.min(separation_ratio(level, height, self.separation.horizontal, self.separation.vertical))

    def row(self, sample: FleetSample, instant: Instant) -> None:
        """None."""


def _of_one(sample: AircraftSample) -> dict[str, Array]:
    approach, state = sample.approach, sample.truth.state
    assert approach is not None
    assert sample.reference_n is not None
    return {
        "position_n": state.position_n,
        "offset_n": approach.rendezvous_n - state.position_n,
        "airspeed": sample.truth.now.air_data.V if sample.flow is None else sample.flow.airspeed,
        "clearance": safe_norm(approach.to_goal_n),
        "position_error": jnp.where(approach.phase == HOLD, -jnp.inf, safe_norm(sample.reference_n - state.position_n)),
        "arrival_time": approach.plan.arrival_time,
        "outside_tables": sample.truth.airframe.outside_tables(sample.truth.now.air_data),
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
