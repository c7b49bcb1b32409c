"""Ground clearance: the height needed to level off from a descent.

Whether that height is left above the floor, and the pull that ends the descent.
"""

import equinox as eqx
import jax.numpy as jnp

from anser.constants import STANDARD_GRAVITY_M_S2
from anser.control.feedback import wrap_angle
from anser.control.gains import LoopGains
from anser.control.limits import FlightLimits
from anser.control.onboard_model import PathMotion, path_motion
from anser.control.velocity_loop import LIFT_SHARE, lift_at_alpha
from anser.parts.paths import PathCommand
from anser.parts.perception import Belief, velocity_over_ground_n
from anser.shapes import Flag, Scalar, ScalarLike

REACTION_S = 1.0
"""Time until the pull that is asked for acts: the attitude loop's 0.5 s and as much for the lift to build up."""
ROLL_RATE_RAD_S = 1.0
"""Mean rate at which a bank is rolled out; the attitude loop begins with 2 rad/s per rad and ends exponentially."""
BANK_WITH_FULL_LIFT = jnp.pi / 3
"""Bank up to which the autopilot keeps its lift while it rolls; from 30 deg more on it has let go of it."""
_BANK_LET_GO = jnp.pi / 6
_SPEED_MIN = 1.0  # m/s
_PULL_MIN = 0.1  # of gravity: what is reckoned with where lift hardly carries the weight


def level_off_height(
    speed: ScalarLike, sink: ScalarLike, fall: ScalarLike, bank: ScalarLike, pull: ScalarLike
) -> Scalar:
    """Height lost from now until the flight is level, m; 0 for one that does not sink.

    Parameters
    ----------
    speed
        Airspeed, m/s.
    sink
        Vertical speed, down positive, m/s.
    fall
        Downward acceleration now, m/s^2: a path that is being pushed over steepens until the pull acts.
    bank
        Bank about the velocity, rad; it is rolled out first, beyond 60 deg without lift.
    pull
        Acceleration normal to the path, upward, beyond that which carries the weight, m/s^2.

    Notes
    -----
    In the time t = 1 s + |bank| / (1 rad/s) the aircraft falls sink t + fall t^2 / 2. The pull then turns the path from
    -gamma to level with normal acceleration a = `pull`: V d(gamma)/dt = a and dV/dt = g sin(gamma), without drag and
    thrust, give d(V^2)/d(cos gamma) = (2 g / a) V^2, and with energy kept the height is
    V^2/2g (exp(2 g (1 - cos gamma)/a) - 1): the circular arc V^2 (1 - cos gamma)/a where that is short. `pull` is
    reckoned from carrying the whole weight, though only cos(gamma) of it is to be carried, and drag brakes: both lie on
    the safe side.
    """
    gravity = STANDARD_GRAVITY_M_S2
    amount = jnp.abs(bank)
    time = REACTION_S + amount / ROLL_RATE_RAD_S
    unloaded = gravity * jnp.clip((amount - BANK_WITH_FULL_LIFT) / _BANK_LET_GO, 0.0, 1.0)
    down = jnp.maximum(jnp.clip(fall, 0.0, 2 * gravity), unloaded)
    fallen = jnp.maximum(sink * time + 0.5 * down * time**2, 0.0)
    sink_then = jnp.maximum(sink + down * time, 0.0)
    square = jnp.maximum(speed, _SPEED_MIN) ** 2 + 2 * gravity * fallen
    return fallen + _arc(square, sink_then, jnp.maximum(pull, _PULL_MIN * gravity))


def required_pull(speed: ScalarLike, sink: ScalarLike, bank: ScalarLike, height_available: ScalarLike) -> Scalar:
    """Acceleration normal to the path, beyond carrying the weight, that ends a descent within a height (m), m/s^2.

    Speed, sink and bank as for `level_off_height`. Where no height is available the pull is that of an arc as short as
    what is fallen in a third of a second, and 1 m.
    """
    down = jnp.maximum(sink, 0.0)
    time = REACTION_S + jnp.abs(bank) / ROLL_RATE_RAD_S
    left = jnp.maximum(height_available - down * time, down / 3 + 1.0)
    square = jnp.maximum(speed, _SPEED_MIN) ** 2
    return square * _one_minus_cosine(down**2 / square) / left


def _arc(speed_squared: Scalar, sink: Scalar, pull: Scalar) -> Scalar:
    gravity = STANDARD_GRAVITY_M_S2
    turned = _one_minus_cosine(sink**2 / speed_squared)
    return speed_squared / (2 * gravity) * jnp.expm1(2 * gravity * turned / pull)


def _one_minus_cosine(sine_squared: Scalar) -> Scalar:
    """1 - cos of an angle from the square of its sine, without cancellation; 1 from the vertical on."""
    square = jnp.minimum(sine_squared, 1.0 - 1e-9)
    return square / (1 + jnp.sqrt(1 - square))


ALTITUDE_ERROR_ALLOWED_M = 30.0
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

    is_lost: Flag
    pull: Scalar
    normal_acceleration_max: Scalar
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
    `level_off_height` with three quarters of the pull that 0.9 of the lift at alpha_max, or the greatest load factor,
    leaves beyond the weight.
    """
    state, now, mass = belief.state, belief.condition, belief.airframe.mass_properties.mass
    gravity, altitude = now.earth.gravity, -state.position_n[2]
    sink = velocity_over_ground_n(now, state)[2]
    motion = path_motion(now, now.wrench.force_b, state.velocity_b, mass, gravity)
    other_force_b = now.propulsive.force_b
    lift = LIFT_SHARE * lift_at_alpha(
        belief.airframe, now, state.rates_b, state.surfaces, other_force_b, limits.alpha_max
    )
    most = jnp.clip(lift / mass, 0.0, limits.load_factor_max * gravity)
    spare = jnp.maximum(most - gravity, 0.0)
    V_dot, gamma_dot, _ = motion.path_rates
    fall = -(V_dot * jnp.sin(motion.gamma) + motion.V * jnp.cos(motion.gamma) * gamma_dot)
    needed = level_off_height(motion.V, sink, fall, motion.mu, _PULL_SHARE * spare)
    floor = jnp.maximum(limits.altitude_min - ALTITUDE_ERROR_ALLOWED_M, 0.0)
    height_available = altitude - limits.altitude_min
    wanted = required_pull(motion.V, sink, motion.mu, height_available)
    return GroundClearance(
        is_lost=needed > altitude - floor,
        pull=jnp.minimum(wanted, spare),
        normal_acceleration_max=most,
        motion=motion,
    )


def level_off_command(
    command: PathCommand, clearance: GroundClearance, gains: LoopGains, gravity: Scalar
) -> PathCommand:
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
    left = jnp.maximum(clearance.normal_acceleration_max**2 - up**2, 1e-6)
    change = wrap_angle(command.chi - motion.chi)
    side = jnp.abs(V * jnp.cos(motion.gamma) * (chi_gain * change + chi_feed * command.chi_dot))
    # only as far as the ground demands a pull: the share of a turn in level flight is the velocity loop's affair
    needed = jnp.clip(clearance.pull / _PULL_FIRST, 0.0, 1.0)
    share = 1 - needed * (1 - jnp.minimum(1.0, jnp.sqrt(left) / jnp.maximum(side, 1e-3)))
    return eqx.tree_at(
        lambda c: (c.gamma, c.chi, c.chi_dot),
        command,
        (gamma, jnp.where(share < 1.0, motion.chi + share * change, command.chi), share * command.chi_dot),
    )
