"""Gains of an aircraft's autopilot: given, published, or its own."""

import functools
import math
from collections.abc import Sequence

import equinox as eqx
from jaxtyping import Array

from anser.control import AutopilotGains, LoopGains, designed_gains, published_gains
from anser.numerics import as_array
from anser.scenario.build_aircraft import build_airframe_of
from anser.scenario.build_own import has_own, own_of, with_own_gains
from anser.scenario.schema import Scenario
from anser.scenario.schema_aircraft import Aircraft, AttitudeGains, Gains, RateGains, VelocityGains


def gains_of(scenario: Scenario, aircraft: Aircraft) -> AutopilotGains:
    """Gains of one aircraft's autopilot: given, published (of the F-16), or the aircraft's own."""
    given = build_gains(aircraft)
    if not has_own(aircraft):
        return given
    return with_own_gains(given, aircraft, own_of(scenario, aircraft, build_airframe_of(aircraft)))


def build_gains(aircraft: Aircraft) -> AutopilotGains:
    """Gains of one aircraft's autopilot."""
    return _built_gains(aircraft.gains)  # pyright: ignore[reportArgumentType] - frozen, so it has a hash


@functools.lru_cache(maxsize=256)
def _built_gains(gains: Gains) -> AutopilotGains:
    bandwidth = gains.sensor_bandwidth_rad_s if gains.inversion == "incremental" else 0.0
    return eqx.tree_at(
        lambda g: (g.rates, g.attitude, g.velocity, g.sensor_bandwidth),
        published_gains(),
        (_loop(gains.rates), _loop(gains.attitude), _loop(gains.velocity), as_array(bandwidth)),
    )


def _loop(gains: RateGains | AttitudeGains | VelocityGains) -> LoopGains:
    def channels(values: Sequence[float]) -> Array:
        return as_array(values)

    others = channels(gains.derivative), channels(gains.feed_forward)
    if gains.bandwidth_rad_s is not None:
        damping = (math.inf,) * 3 if gains.damping is None else gains.damping
        return designed_gains(channels(gains.bandwidth_rad_s), channels(damping), *others)
    return LoopGains(channels(gains.proportional), channels(gains.integral), *others)
