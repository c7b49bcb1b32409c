"""Ground clearance: whether a descent can still be ended above the floor, and the pull that ends it.

It stands above every plan and guidance: it reckons with what the aircraft does now, not with what is planned.
"""

import equinox as eqx
import jax.numpy as jnp

from anser.control.feedback import wrapped
from anser.control.gains import LoopGains
from anser.control.limits import FlightLimits
from anser.control.path_motion import PathMotion, path_motion
from anser.control.velocity_loop import LIFT_SHARE, lift_at
from anser.planning import PathCommand
from anser.planning.level_off import level_off_height, pull_needed
from anser.sensing import Belief, velocity_over_ground_n
from anser.shapes import Flag, Scalar

ERROR_ALLOWED_M = 30.0
"""How far below the least altitude the errors of flight may take an aircraft before it breaks off."""
_PULL_SHARE = 0.75  # part of the pull that the guard reckons with: drag costs speed, and so lift, on the way
_PULL_FIRST = 3.0  # m/s^2: from this pull on its lift is served before any turn
_ONSET = 0.5  # 1/s, with which a channel without gain of its own is taken to follow


class GroundClearance(eqx.Module):
    """What stands between an aircraft and the ground.

    Attributes
    ----------
    lost
        Whether the height left above the floor no longer suffices to end the descent: to be broken off at once.
    pull
        Acceleration normal to the path, beyond carrying the weight, that keeps the aircraft above its least altitude,
        within what it can give, m/s^2; 0 for an aircraft that does not sink.
    normal_most
        Greatest acceleration normal to the path that lift and load factor give, m/s^2.
    motion
        What the aircraft does now.
    """

    lost: Flag
    pull: Scalar
    normal_most: Scalar
    motion: PathMotion


def ground_clearance(belief: Belief, limits: FlightLimits) -> GroundClearance:
    """Look from the present motion down to the ground, which is at altitude 0.

    Parameters
    ----------
    belief
        What the aircraft believes of itself.
    limits
        Its least altitude, angle of attack and load factor.

    Notes
    -----
    The floor is the least altitude less 30 m, at least the ground: paths may run along the least altitude, and neither
    their tracking (metres) nor the end of a level-off may count as lost. The height needed is that of
    `anser.planning.level_off.level_off_height` with three quarters of the pull that 0.9 of the lift at alpha_max, or
    the greatest load factor, leaves beyond the weight.
    """
    state, now, mass = belief.state, belief.now, belief.airframe.mass_properties.mass
    gravity, altitude = now.earth.gravity, -state.position_n[2]
    sink = velocity_over_ground_n(now, state)[2]
    motion = path_motion(now, now.wrench.force_b, state.velocity_b, mass, gravity)
    beside_b = now.propulsive.force_b
    lift = LIFT_SHARE * lift_at(belief.airframe, now, state.rates_b, state.surfaces, beside_b, limits.alpha_max)
    most = jnp.clip(lift / mass, 0.0, limits.load_factor_max * gravity)
    spare = jnp.maximum(most - gravity, 0.0)
    V_dot, gamma_dot, _ = motion.path_rates
    fall = -(V_dot * jnp.sin(motion.gamma) + motion.V * jnp.cos(motion.gamma) * gamma_dot)
    needed = level_off_height(motion.V, sink, fall, motion.mu, _PULL_SHARE * spare)
    floor = jnp.maximum(limits.altitude_min - ERROR_ALLOWED_M, 0.0)
    height_available = altitude - limits.altitude_min
    wanted = pull_needed(motion.V, sink, motion.mu, height_available)
    return GroundClearance(
        lost=needed > altitude - floor,
        pull=jnp.minimum(wanted, spare),
        normal_most=most,
        motion=motion,
    )


def levelled_off(command: PathCommand, clearance: GroundClearance, gains: LoopGains, gravity: Scalar) -> PathCommand:
    """Command with at least the pull that the ground demands; it turns only as far as lift is left for that.

    Where the command asks for that pull by itself and its turn leaves the lift for it, it is returned as it is.

    Parameters
    ----------
    command
        What the guidance asks for, through the air.
    clearance
        As of now.
    gains
        With which the controller follows (V, gamma, chi).
    gravity
        m/s^2.
    """
    motion = clearance.motion
    V = jnp.maximum(motion.V, 1.0)
    _, gamma_gain, chi_gain = jnp.maximum(gains.proportional, _ONSET)
    _, gamma_feed, chi_feed = gains.feed_forward
    asked = V * (gamma_gain * (command.gamma - motion.gamma) + gamma_feed * command.gamma_dot)
    lacking = jnp.where(clearance.pull > 0.0, jnp.maximum(clearance.pull - asked, 0.0), 0.0)
    gamma = command.gamma + lacking / (V * gamma_gain)

    up = gravity * jnp.cos(motion.gamma) + jnp.maximum(clearance.pull, 0.0)
    left = jnp.maximum(clearance.normal_most**2 - up**2, 1e-6)
    change = wrapped(command.chi - motion.chi)
    side = jnp.abs(V * jnp.cos(motion.gamma) * (chi_gain * change + chi_feed * command.chi_dot))
    # only as far as the ground demands a pull: the share of a turn in level flight is the velocity loop's affair
    needed = jnp.clip(clearance.pull / _PULL_FIRST, 0.0, 1.0)
    share = 1 - needed * (1 - jnp.minimum(1.0, jnp.sqrt(left) / jnp.maximum(side, 1e-3)))
    return eqx.tree_at(
        lambda c: (c.gamma, c.chi, c.chi_dot),
        command,
        (gamma, jnp.where(share < 1.0, motion.chi + share * change, command.chi), share * command.chi_dot),
    )
