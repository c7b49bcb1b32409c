"""Gains of the three loops; the published ones ([TH], theory section 5) are the defaults."""

import equinox as eqx

from anser.numerics import as_array
from anser.shapes import Scalar, Vector3


class LoopGains(eqx.Module):
    """Gains of one loop, one value per channel, shape (3,) each.

    nu = feed_forward r_dot + proportional e + integral (time integral of e) + derivative e_dot, e = r - y.
    Units: proportional 1/s, integral 1/s^2, derivative and feed-forward none.
    """

    proportional: Vector3
    integral: Vector3
    derivative: Vector3
    feed_forward: Vector3


class AutopilotGains(eqx.Module):
    """Gains of the whole autopilot.

    Attributes
    ----------
    rates
        Channels P, Q, R.
    attitude
        Channels mu, alpha, beta.
    velocity
        Channels V, gamma, chi.
    attitude_command_bandwidth, rates_command_bandwidth, surfaces_command_bandwidth
        Bandwidths of the filters that differentiate the commands passed inwards, for the feed-forward, rad/s.
    actuator_bandwidth
        Bandwidth that the allocation asks of the actuators by inverting their lag, 1/s.
    surface_bandwidth
        Bandwidth of the low-pass filter on the deflections that the outer loops see, rad/s.
    engine_bandwidth
        Bandwidth that the throttle asks of the engine by inverting its lag, 1/s.
    sensor_bandwidth
        Bandwidth of the filter on what the sensors say beyond the model, rad/s: above 0 the inversion is incremental, 0
        is model-based.
    """

    rates: LoopGains
    attitude: LoopGains
    velocity: LoopGains
    attitude_command_bandwidth: Scalar
    rates_command_bandwidth: Scalar
    surfaces_command_bandwidth: Scalar
    actuator_bandwidth: Scalar
    surface_bandwidth: Scalar
    engine_bandwidth: Scalar
    sensor_bandwidth: Scalar


def loop_gains(
    proportional: float, integral: float = 0.0, derivative: float = 0.0, feed_forward: float = 1.0
) -> LoopGains:
    """Build the same gains for all three channels of a loop."""
    return LoopGains(*(as_array([g] * 3) for g in (proportional, integral, derivative, feed_forward)))


def published_gains() -> AutopilotGains:
    """Gains of [TH] (theory section 5), for model-based inversion."""
    return AutopilotGains(
        rates=loop_gains(10.0, 0.25, 1.0),
        attitude=loop_gains(2.0),
        velocity=loop_gains(1.0, 0.025),
        attitude_command_bandwidth=as_array(4.0),
        rates_command_bandwidth=as_array(3.0),
        surfaces_command_bandwidth=as_array(20.0),
        actuator_bandwidth=as_array(40.0),
        surface_bandwidth=as_array(0.5),
        engine_bandwidth=as_array(5.0),
        sensor_bandwidth=as_array(0.0),
    )
