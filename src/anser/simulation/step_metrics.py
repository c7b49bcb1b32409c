"""Figures of a step response: rise and settling time, overshoot, error at the end, what the other channels do."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from anser.shapes import Scalar, ScalarLike, Vector, Vector3

_RISE_FROM, _RISE_TO = 0.1, 0.9
_END = 0.1
"""Last part of the record over which the error at the end is averaged."""


class StepMetrics(eqx.Module):
    """Figures of one response of a loop's three channels.

    Attributes
    ----------
    stepped
        Which channels were commanded; the next four are figures of theirs, 0 for the others.
    rise_time
        From 10 to 90 percent of the step, s; infinite where 90 percent is not reached.
    settling_time
        From the step until the error stays within the band, s; infinite where it does not before the record ends.
    overshoot
        Beyond the command, part of the step; 0 without overshoot.
    final_error
        Command minus output, mean of the last tenth of the record, part of the step.
    coupling
        Largest departure of the channels that were not commanded, in their own units; 0 for the commanded ones.
    surface_use
        Largest part of the way from trim to the stop that each surface went.
    """

    stepped: Bool[Array, "3"]
    rise_time: Vector3
    settling_time: Vector3
    overshoot: Vector3
    final_error: Vector3
    coupling: Vector3
    surface_use: Vector


def step_metrics(
    time: Float[Array, " steps"],
    measured: Float[Array, "steps 3"],
    size: Vector3,
    surfaces: Float[Array, "steps n"],
    surface_limits: tuple[Vector, Vector],
    band: ScalarLike = 0.05,
) -> StepMetrics:
    """Figures of a response to a step at the first sample.

    Parameters
    ----------
    time
        s.
    measured
        Outputs of the loop's channels; angles without jumps of 2 pi.
    size
        Step of each channel, 0 for those that are to stay.
    surfaces
        Deflections, rad.
    surface_limits
        Lower and upper stops, rad.
    band
        Of the settling time, part of the step.
    """
    stepped = size != 0.0
    departure = measured - measured[:1]
    progress = departure / jnp.where(stepped, size, 1.0)[None, :]
    tail = jnp.arange(time.shape[0]) >= round((1.0 - _END) * time.shape[0])
    outside = jnp.abs(progress - 1.0) > band
    settled = jnp.max(jnp.where(outside, time[:, None], -jnp.inf), axis=0)
    lower, upper = surface_limits
    moved = surfaces - surfaces[:1]
    room = jnp.where(moved > 0.0, upper - surfaces[0], surfaces[0] - lower)

    def of_stepped(values: Vector3) -> Vector3:
        return jnp.where(stepped, values, 0.0)

    return StepMetrics(
        stepped=stepped,
        rise_time=of_stepped(_first(time, progress, _RISE_TO) - _first(time, progress, _RISE_FROM)),
        settling_time=of_stepped(jnp.where(outside[-1], jnp.inf, jnp.maximum(settled - time[0], 0.0))),
        overshoot=of_stepped(jnp.maximum(jnp.max(progress, axis=0) - 1.0, 0.0)),
        final_error=of_stepped(1.0 - jnp.sum(jnp.where(tail[:, None], progress, 0.0), axis=0) / jnp.sum(tail)),
        coupling=jnp.where(stepped, 0.0, jnp.max(jnp.abs(departure), axis=0)),
        surface_use=jnp.max(jnp.abs(moved) / jnp.maximum(room, 1e-9), axis=0),
    )


def _first(time: Float[Array, " steps"], progress: Float[Array, "steps 3"], level: float) -> Vector3:
    """First time at which each channel has come so far, linear between samples; infinite if it never has."""

    def one(channel: Float[Array, " steps"]) -> Scalar:
        there = channel >= level
        k = jnp.argmax(there)
        before = jnp.maximum(k - 1, 0)
        rise = channel[k] - channel[before]
        part = jnp.where(rise > 0.0, (level - channel[before]) / jnp.where(rise > 0.0, rise, 1.0), 1.0)
        crossing = time[before] + jnp.clip(part, 0.0, 1.0) * (time[k] - time[before])
        return jnp.where(jnp.any(there), crossing, jnp.inf)

    return jnp.stack([one(progress[:, k]) for k in range(3)])
