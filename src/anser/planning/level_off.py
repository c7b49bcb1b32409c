"""Height that an aircraft needs to end a descent: what it falls before it pulls, and the arc of the pull."""

import jax.numpy as jnp

from anser.constants import STANDARD_GRAVITY_M_S2
from anser.shapes import Scalar, ScalarLike

REACTION_S = 1.0
"""Time until the pull that is asked for acts: the attitude loop's 0.5 s and as much for the lift to build up."""
ROLL_RATE_RAD_S = 1.0
"""Mean rate at which a bank is rolled out; the attitude loop begins with 2 rad/s per rad and ends exponentially."""
BANK_HELD = jnp.pi / 3
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
    unloaded = gravity * jnp.clip((amount - BANK_HELD) / _BANK_LET_GO, 0.0, 1.0)
    down = jnp.maximum(jnp.clip(fall, 0.0, 2 * gravity), unloaded)
    fallen = jnp.maximum(sink * time + 0.5 * down * time**2, 0.0)
    sink_then = jnp.maximum(sink + down * time, 0.0)
    square = jnp.maximum(speed, _SPEED_MIN) ** 2 + 2 * gravity * fallen
    return fallen + _arc(square, sink_then, jnp.maximum(pull, _PULL_MIN * gravity))


def pull_needed(speed: ScalarLike, sink: ScalarLike, bank: ScalarLike, height_available: ScalarLike) -> Scalar:
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
