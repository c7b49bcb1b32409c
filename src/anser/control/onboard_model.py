"""The on-board model of dynamic inversion, evaluated once per sample for all loops."""

import equinox as eqx

from anser.aircraft import AbstractAirframe, AircraftState, Condition, Wrench, angular_acceleration
from anser.control.allocation import SurfaceMoments, surface_moments
from anser.control.authority import Authority, surface_authority
from anser.control.gains import AutopilotGains
from anser.control.limits import FlightLimits
from anser.control.memory import AutopilotState
from anser.control.model_residual import ModelResidual
from anser.control.path_motion import PathMotion, path_motion
from anser.numerics import times3
from anser.sensing import Belief
from anser.shapes import ScalarLike, Vector


class OnboardModel(eqx.Module):
    """On-board model at one instant, which the loops invert.

    The forces in `now` and `slow` are those of the model of `airframe`, plus the residual that the sensors measure
    where the inversion is incremental.

    The two outer loops see the forces as they are with `surfaces_slow`, low-passed deflections: the lift of the moving
    elevator, differentiated twice on its way through the feed-forward, would come back to the elevator with a loop gain
    above one (a limit cycle at the rate limit). Neglecting fast surface forces in the slow loops is the two-time-scale
    assumption of dynamic inversion.
    """

    airframe: AbstractAirframe
    limits: FlightLimits
    state: AircraftState
    now: Condition
    slow: Condition
    surfaces_slow: Vector
    moments: SurfaceMoments
    authority: Authority
    residual: ModelResidual
    motion: PathMotion
    gravity: ScalarLike
    step: ScalarLike


def onboard_model(
    belief: Belief, limits: FlightLimits, gains: AutopilotGains, memory: AutopilotState, step: ScalarLike
) -> OnboardModel:
    """Evaluate the on-board model of what an aircraft believes; `step` is the sampling period, s."""
    airframe, state, now, gravity = belief.airframe, belief.state, belief.now, belief.now.earth.gravity
    mass_properties = airframe.mass_properties
    residual = memory.residual.advanced(
        mass_properties.mass * belief.specific_force_b - now.wrench.force_b,
        state.rates_b,
        angular_acceleration(mass_properties, state.rates_b, now.wrench.moment_b),
        gains.sensor_bandwidth,
        step,
    )
    residual_wrench = Wrench(residual.force_b, times3(mass_properties.inertia_b, residual.acceleration_b))
    now = eqx.tree_at(lambda c: c.aerodynamic, now, now.aerodynamic + residual_wrench)
    surfaces_slow = memory.surfaces_slow
    slow_wrench = airframe.aerodynamics(now.air_data, state.rates_b, surfaces_slow) + residual_wrench
    slow = eqx.tree_at(lambda c: c.aerodynamic, now, slow_wrench)
    motion = path_motion(now, slow.wrench.force_b, state.velocity_b, mass_properties.mass, gravity)
    moments = surface_moments(airframe, now, state.rates_b, state.surfaces)
    authority = surface_authority(airframe.actuators, mass_properties, moments, surfaces_slow)
    return OnboardModel(
        airframe, limits, state, now, slow, surfaces_slow, moments, authority, residual, motion, gravity, step
    )
