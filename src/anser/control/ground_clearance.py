"""Ground clearance: the height needed to level off from a descent, and the pull-up that ends the descent."""

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
"""Time until a commanded pull-up acts, s: 0.5 s of the attitude loop and 0.5 s for the lift to build up."""
ROLL_RATE_RAD_S = 1.0
"""Mean roll rate of a roll-out, rad/s; the attitude loop starts with 2 rad/s per rad and ends exponentially."""
BANK_WITH_FULL_LIFT = jnp.pi / 3
"""Bank up to which the autopilot keeps full lift while rolling out, rad; at 30 deg more, the lift is zero."""
_LIFT_FADE_RANGE = jnp.pi / 6
_SPEED_MIN = 1.0  # m/s
_PULL_MIN = 0.1  # of gravity: least assumed pull if the lift hardly carries the weight


def level_off_height(
    speed: ScalarLike,  # airspeed, m/s
    sink: ScalarLike,  # vertical speed, down positive, m/s
    fall: ScalarLike,  # present downward acceleration, m/s^2, assumed to last until the pull acts
    bank: ScalarLike,  # bank about the velocity, rad; the aircraft rolls out first, without lift beyond 60 deg
    pull: ScalarLike,  # upward acceleration normal to the path, in addition to carrying the weight, m/s^2
) -> Scalar:
    """Compute the height lost until the flight is level, m; 0 for an aircraft that does not sink before the pull acts.

    Notes
    -----
    Before the pull acts, for t = 1 s + |bank| / (1 rad/s), the aircraft falls by sink t + fall t^2 / 2. The pull
    a = `pull` then turns the path from the descent angle gamma to level. From V gamma_dot = -a and V_dot = g sin(gamma)
    follows d(V^2)/d(cos gamma) = (2 g / a) V^2, without drag and thrust. The conserved energy gives the height of the
    pull-up, V^2 / (2 g) (exp(2 g (1 - cos gamma) / a) - 1). The height is conservative, because drag brakes and only
    cos(gamma) of the weight acts normal to the path.
    """
    gravity = STANDARD_GRAVITY_M_S2
    bank_magnitude = jnp.abs(bank)
    delay = REACTION_S + bank_magnitude / ROLL_RATE_RAD_S
    unloaded_fall_rate = gravity * jnp.clip((bank_magnitude - BANK_WITH_FULL_LIFT) / _LIFT_FADE_RANGE, 0.0, 1.0)
    fall_rate = jnp.maximum(jnp.clip(fall, 0.0, 2 * gravity), unloaded_fall_rate)
    height_before_pull = jnp.maximum(sink * delay + 0.5 * fall_rate * delay**2, 0.0)
    sink_at_pull = jnp.maximum(sink + fall_rate * delay, 0.0)
    speed_squared = jnp.maximum(speed, _SPEED_MIN) ** 2 + 2 * gravity * height_before_pull
    return height_before_pull + _arc_height(speed_squared, sink_at_pull, jnp.maximum(pull, _PULL_MIN * gravity))


def required_pull(speed: ScalarLike, sink: ScalarLike, bank: ScalarLike, height_available: ScalarLike) -> Scalar:
    """Compute the acceleration normal to the path (m/s^2), in addition to carrying the weight, that ends a descent.

    The descent ends within `height_available` (m). For the other arguments, see `level_off_height`. The pull-up is
    assumed to take at least the height lost in a third of a second, plus 1 m.
    """
    sink_speed = jnp.maximum(sink, 0.0)
    delay = REACTION_S + jnp.abs(bank) / ROLL_RATE_RAD_S
    arc_height = jnp.maximum(height_available - sink_speed * delay, sink_speed / 3 + 1.0)
    speed_squared = jnp.maximum(speed, _SPEED_MIN) ** 2
    return speed_squared * _one_minus_cosine(sink_speed**2 / speed_squared) / arc_height


def _arc_height(speed_squared: Scalar, sink: Scalar, pull: Scalar) -> Scalar:
    gravity = STANDARD_GRAVITY_M_S2
    one_minus_cosine = _one_minus_cosine(sink**2 / speed_squared)
    return speed_squared / (2 * gravity) * jnp.expm1(2 * gravity * one_minus_cosine / pull)


def _one_minus_cosine(sine_squared: Scalar) -> Scalar:
    """Compute 1 - cos(angle) from sin(angle)^2 without cancellation; a square above 1 counts as 1 (vertical)."""
    limited_square = jnp.minimum(sine_squared, 1.0 - 1e-9)
    return limited_square / (1 + jnp.sqrt(1 - limited_square))


ALTITUDE_ERROR_ALLOWED_M = 30.0
"""Depth below the least altitude, m, down to which an aircraft need not leave its plan."""
_PULL_SHARE = 0.75  # share of the available pull: drag reduces speed and lift during the pull-up
_FULL_PRIORITY_PULL = 3.0  # m/s^2: pull from which the level-off takes the lift before any turn
_GAIN_MIN = 0.5  # 1/s: least gain of a channel, also for loops without gain


class GroundClearance(eqx.Module):
    """Result of the check of one aircraft's height: whether to abandon the plan, and the pull-up that is needed."""

    # True: the height above the floor does not suffice to end the descent, and the aircraft must leave its plan at once
    is_lost: Flag
    # acceleration normal to the path, in addition to carrying the weight, that keeps the aircraft above the least
    # altitude, limited to the aircraft's capability, m/s^2; 0 for an aircraft that does not sink
    pull: Scalar
    normal_acceleration_max: Scalar  # greatest acceleration normal to the path, limited by lift and load factor, m/s^2
    motion: PathMotion  # path and attitude angles and their rates, present motion


def ground_clearance(
    belief: Belief,
    limits: FlightLimits,  # least altitude, angle of attack and load factor
) -> GroundClearance:
    """Compute the ground clearance of an aircraft's present motion; the ground is at altitude 0.

    Notes
    -----
    The floor is 30 m below the least altitude, but not below the ground, because paths may follow the least altitude
    with tracking errors of metres. The height needed is `level_off_height` with three quarters of the available pull.
    With the lift L at alpha_max, the available pull is the smaller of 0.9 L / m and the greatest load factor times g,
    minus g.
    """
    state, condition, mass = belief.state, belief.condition, belief.airframe.mass_properties.mass
    gravity, altitude = condition.earth.gravity, -state.position_n[2]
    sink = velocity_over_ground_n(condition, state)[2]
    motion = path_motion(condition, condition.wrench.force_b, state.velocity_b, mass, gravity)
    other_force_b = condition.propulsive.force_b
    lift = LIFT_SHARE * lift_at_alpha(
        belief.airframe, condition, state.rates_b, state.surfaces, other_force_b, limits.alpha_max
    )
    normal_acceleration_max = jnp.clip(lift / mass, 0.0, limits.load_factor_max * gravity)
    pull_max = jnp.maximum(normal_acceleration_max - gravity, 0.0)
    V_dot, gamma_dot, _ = motion.path_rates
    fall = -(V_dot * jnp.sin(motion.gamma) + motion.V * jnp.cos(motion.gamma) * gamma_dot)
    height_needed = level_off_height(motion.V, sink, fall, motion.mu, _PULL_SHARE * pull_max)
    floor = jnp.maximum(limits.altitude_min - ALTITUDE_ERROR_ALLOWED_M, 0.0)
    height_available = altitude - limits.altitude_min
    pull = required_pull(motion.V, sink, motion.mu, height_available)
    return GroundClearance(
        is_lost=height_needed > altitude - floor,
        pull=jnp.minimum(pull, pull_max),
        normal_acceleration_max=normal_acceleration_max,
        motion=motion,
    )


def level_off_command(
    command: PathCommand,  # command of the guidance, through the air
    clearance: GroundClearance,
    gains: LoopGains,  # gains of the controller's velocity loop (V, gamma, chi)
    gravity: Scalar,  # acceleration of gravity, m/s^2
) -> PathCommand:
    """Return the guidance command with the pull-up that ground clearance requires and a turn within the remaining lift.

    The path angle is raised until the velocity loop commands the pull `clearance.pull`. Course change and course rate
    are reduced to the remaining lift: fully for a required pull of 3 m/s^2 or more, in proportion for a smaller pull.
    """
    motion = clearance.motion
    speed = jnp.maximum(motion.V, 1.0)
    _, gamma_gain, chi_gain = jnp.maximum(gains.proportional, _GAIN_MIN)
    _, gamma_feed, chi_feed = gains.feed_forward
    commanded_pull = speed * (gamma_gain * (command.gamma - motion.gamma) + gamma_feed * command.gamma_dot)
    missing_pull = jnp.where(clearance.pull > 0.0, jnp.maximum(clearance.pull - commanded_pull, 0.0), 0.0)
    gamma = command.gamma + missing_pull / (speed * gamma_gain)

    upward_acceleration = gravity * jnp.cos(motion.gamma) + jnp.maximum(clearance.pull, 0.0)
    turn_acceleration_square = jnp.maximum(clearance.normal_acceleration_max**2 - upward_acceleration**2, 1e-6)
    change = wrap_angle(command.chi - motion.chi)
    turn_acceleration = jnp.abs(speed * jnp.cos(motion.gamma) * (chi_gain * change + chi_feed * command.chi_dot))
    # reduced only for a required pull: in level flight the velocity loop limits the turn
    priority = jnp.clip(clearance.pull / _FULL_PRIORITY_PULL, 0.0, 1.0)
    share = 1 - priority * (
        1 - jnp.minimum(1.0, jnp.sqrt(turn_acceleration_square) / jnp.maximum(turn_acceleration, 1e-3))
    )
    return eqx.tree_at(
        lambda c: (c.gamma, c.chi, c.chi_dot),
        command,
        (gamma, jnp.where(share < 1.0, motion.chi + share * change, command.chi), share * command.chi_dot),
    )
