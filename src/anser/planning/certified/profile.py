"""Profiles: altitude and airspeed over time, chosen before the horizontal route, and the drift of the air on the way.

Vertical speed and airspeed change by smoothsteps, so that the acceleration is continuous; the aircraft's initial
acceleration fades out.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from anser.environment.environment import AbstractWind
from anser.numerics.integration import gauss_legendre
from anser.planning.limits import PathLimits
from anser.shapes import Flag, Scalar, ScalarLike, Vector3

CURVATURE_FRACTION = 0.98
"""Fraction, used by the paths, of the greatest curvature that bank angle and load factor allow."""
_RULE = gauss_legendre(4)
_FADE_S = 3.0  # duration in which the initial acceleration fades out
CLIMB_ACCELERATION = 1.0  # m/s^2: a tenth of g, with little effect on the bank angle
_SPEED_RATES = (0.8, 0.8)  # m/s^2, gain and loss
_SHORTEST_RAMP_S = 2.0
_GENTLE_RAMP_S = 20.0  # greatest duration of the ramp of a small change of climb
_LEVEL_OFF_ROUNDS = 3
_DETOUR_RATE, _DETOUR_ACCELERATION = 3.44, 24.0  # greatest slope and second derivative of 64 (s (1 - s))^3
_FADING_RATE = 0.053  # greatest slope of t^2/2 (1 - t)^4
KINKS = 5
"""Number of `Profile.kinks`: times at which higher derivatives of a profile jump."""
_SQUARE_MIN = 1.0  # (m/s)^2: keeps the horizontal airspeed of a vertical path finite; such a path is refused


class ProfileState(eqx.Module):
    """Altitude (m), vertical speed and airspeed (m/s) and their rates (m/s^2) at one time."""

    altitude: Scalar
    climb: Scalar  # over the ground, m/s
    climb_dot: Scalar
    speed: Scalar  # airspeed, m/s
    speed_dot: Scalar


class Profile(eqx.Module):
    """Altitude and airspeed as functions of time, from 0 to `duration` (s); `at` evaluates both.

    The vertical speed over the ground changes from `climb_0` to `plateau` and to `climb_1` (m/s), each in `climb_ramp`
    seconds. The airspeed changes from `speed_0` to `speed_1` (m/s) in `speed_ramp` seconds, and to `speed_2` in
    `speed_ramp_2` seconds. Initial rates have the suffix `_dot_0`.
    """

    duration: Scalar
    altitude_0: Scalar
    climb_0: Scalar
    climb_1: Scalar
    climb_dot_0: Scalar
    plateau: Scalar
    climb_ramp: Scalar
    detour: Scalar  # greatest additional altitude, m
    speed_0: Scalar
    speed_1: Scalar
    speed_2: Scalar
    speed_dot_0: Scalar
    speed_ramp: Scalar
    speed_ramp_2: Scalar

    @property
    def kinks(self) -> Float[Array, "5"]:
        """Times, s after the start, at which higher derivatives jump, in this order.

        - ends of: first change of climb, first change of airspeed, initial acceleration
        - starts of: last change of climb, last change of airspeed
        """
        fade = jnp.minimum(_FADE_S, 0.5 * self.duration)
        late = self.duration - jnp.stack([self.climb_ramp, self.speed_ramp_2])
        return jnp.concatenate([jnp.stack([self.climb_ramp, self.speed_ramp, fade]), late])

    @property
    def speed_max(self) -> Scalar:
        """Greatest airspeed, without the effect of the initial acceleration, m/s."""
        return jnp.maximum(self.speed_0, jnp.maximum(self.speed_1, self.speed_2))

    @property
    def speed_min(self) -> Scalar:
        """Least airspeed, without the effect of the initial acceleration, m/s."""
        return jnp.minimum(self.speed_0, jnp.minimum(self.speed_1, self.speed_2))

    @property
    def speed_mean(self) -> Scalar:
        """Mean airspeed, m/s."""
        early = 0.5 * self.speed_ramp * (self.speed_0 - self.speed_1)
        late = 0.5 * self.speed_ramp_2 * (self.speed_2 - self.speed_1)
        # the last term: integral of `_fading_speed` over time
        fading = self.speed_dot_0 * (jnp.square(jnp.minimum(_FADE_S, 0.5 * self.duration)) / 20.0)
        return self.speed_1 + (early + late + fading) / self.duration

    @property
    def climb_bounds(self) -> tuple[Scalar, Scalar]:
        """Upper bounds of the magnitude of the vertical speed over the ground, m/s, and of its rate, m/s^2."""
        end_speed_max = jnp.maximum(jnp.abs(self.climb_0), jnp.abs(self.climb_1))
        change = jnp.maximum(jnp.abs(self.plateau - self.climb_0), jnp.abs(self.climb_1 - self.plateau))
        fade = jnp.minimum(_FADE_S, 0.5 * self.duration)
        detour = jnp.abs(self.detour)
        climb = jnp.maximum(end_speed_max, jnp.abs(self.plateau)) + _DETOUR_RATE * detour / self.duration
        climb = climb + _FADING_RATE * jnp.abs(self.climb_dot_0) * fade
        rate = 1.5 * change / self.climb_ramp + _DETOUR_ACCELERATION * detour / self.duration**2
        rate = rate + jnp.abs(self.climb_dot_0)
        return climb, rate

    def at(self, t: ScalarLike) -> ProfileState:
        """Return altitude, vertical speed, airspeed and the rates of both speeds `t` seconds after the start."""
        ramp, total = self.climb_ramp, self.duration
        rise, rise_dot, risen = _smoothstep(t / ramp)
        fall, fall_dot, fallen = _smoothstep((t - total + ramp) / ramp)
        first_change, last_change = self.plateau - self.climb_0, self.climb_1 - self.plateau
        fade = jnp.minimum(_FADE_S, 0.5 * total)
        e0, e1, e2 = _fading(t, fade)
        s = t / total
        b0 = 64 * (s * (1 - s)) ** 3
        b1 = 192 * (s * (1 - s)) ** 2 * (1 - 2 * s) / total
        b2 = 384 * s * (1 - s) * (1 - 5 * s + 5 * s * s) / total**2
        early, early_dot, _ = _smoothstep(t / self.speed_ramp)
        late, late_dot, _ = _smoothstep((t - total + self.speed_ramp_2) / self.speed_ramp_2)
        up, up_late = self.speed_1 - self.speed_0, self.speed_2 - self.speed_1
        f0, f1 = _fading_speed(t, fade)
        return ProfileState(
            altitude=self.altitude_0
            + self.climb_0 * t
            + ramp * (first_change * risen + last_change * fallen)
            + self.climb_dot_0 * e0
            + self.detour * b0,
            climb=self.climb_0 + first_change * rise + last_change * fall + self.climb_dot_0 * e1 + self.detour * b1,
            climb_dot=(first_change * rise_dot + last_change * fall_dot) / ramp
            + self.climb_dot_0 * e2
            + self.detour * b2,
            speed=self.speed_0 + up * early + up_late * late + self.speed_dot_0 * f0,
            speed_dot=up * early_dot / self.speed_ramp + up_late * late_dot / self.speed_ramp_2 + self.speed_dot_0 * f1,
        )


def _smoothstep(u: ScalarLike) -> tuple[Scalar, Scalar, Scalar]:
    """Return value, slope and integral from 0 of the smoothstep, which rises from 0 at u = 0 to 1 at u = 1."""
    v = jnp.clip(u, 0.0, 1.0)
    return v * v * (3 - 2 * v), 6 * v * (1 - v), v**3 * (1 - 0.5 * v) + jnp.maximum(u - 1.0, 0.0)


def _fading(t: ScalarLike, fade: ScalarLike) -> tuple[Scalar, Scalar, Scalar]:
    """Return t^2/2 (1 - t/fade)^4 and its first two derivatives by t; all are 0 after t = fade."""
    q = jnp.maximum(1.0 - t / fade, 0.0)
    k = 1.0 / fade
    return (
        0.5 * t * t * q**4,
        t * q**4 - 2 * k * t * t * q**3,
        q**4 - 8 * k * t * q**3 + 6 * k * k * t * t * q**2,
    )


def _fading_speed(t: ScalarLike, fade: ScalarLike) -> tuple[Scalar, Scalar]:
    """Return t (1 - t/fade)^3 and its derivative; both are 0 after t = fade."""
    q = jnp.maximum(1.0 - t / fade, 0.0)
    return t * q**3, q**3 - 3 * t / fade * q**2


Rates = tuple[ScalarLike, ScalarLike]


def speed_ramp(begin: ScalarLike, end: ScalarLike, duration: ScalarLike, rates: Rates = _SPEED_RATES) -> Scalar:
    """Return the duration, s, of a change of airspeed from `begin` to `end` (m/s) within rates of gain and loss.

    `rates` are the greatest gain and loss, m/s^2. The result is at least 2 s, and at most 0.8 of the profile's
    `duration` (s).
    """
    rate = jnp.where(jnp.asarray(end) > begin, rates[0], rates[1])
    return jnp.clip(1.5 * jnp.abs(end - begin) / rate, _SHORTEST_RAMP_S, 0.8 * duration)


def mean_to_last_speed(
    mean: ScalarLike, speed_0: ScalarLike, duration: ScalarLike, rates: Rates = _SPEED_RATES
) -> Scalar:
    """Return the final airspeed, m/s, of a profile with one change of airspeed whose mean airspeed is `mean` (m/s).

    The change begins at the start, with the airspeed `speed_0`. `rates` are the greatest gain and loss, m/s^2.
    """
    # final change = (mean - speed_0) / (1 - ramp / (2 duration)), with a ramp in proportion to the final change
    change = jnp.asarray(mean - speed_0, dtype=float)
    size = jnp.abs(change)
    rate = jnp.where(change > 0.0, rates[0], rates[1])
    root = 1.0 - 3.0 * size / (rate * duration)
    final_change = 2.0 * size / (1.0 + jnp.sqrt(jnp.where(root > 0.0, root, 1.0)) * (root > 0.0))
    ramp = jnp.clip(1.5 * final_change / rate, _SHORTEST_RAMP_S, 0.8 * duration)
    return speed_0 + change / (1.0 - 0.5 * ramp / duration)


def last_to_mean_speed(
    final_speed: ScalarLike, speed_0: ScalarLike, duration: ScalarLike, rates: Rates = _SPEED_RATES
) -> Scalar:
    """Return the mean airspeed, m/s, of a profile with one change of airspeed from `speed_0` to `final_speed` (m/s).

    The change begins at the start of `duration` (s); `rates` are the greatest gain and loss of airspeed, m/s^2.
    """
    return final_speed + 0.5 * speed_ramp(speed_0, final_speed, duration, rates) / duration * (speed_0 - final_speed)


def make_profile(
    duration: ScalarLike,  # s
    # initial and final altitude, m; initial and final vertical speed over the ground, m/s, and its initial rate, m/s^2
    altitudes: tuple[ScalarLike, ScalarLike],
    climbs: tuple[ScalarLike, ScalarLike],
    climb_dot_0: ScalarLike,
    detour: ScalarLike,  # greatest additional altitude in the middle, m
    # initial, middle and final airspeed, m/s; initial rate, and greatest rates of gain and loss, m/s^2
    speeds: tuple[ScalarLike, ScalarLike, ScalarLike],
    speed_dot_0: ScalarLike,
    rates: Rates = _SPEED_RATES,
) -> Profile:
    """Make the profile from an initial to a final altitude and vertical speed, with two changes of airspeed."""
    duration = jnp.asarray(duration, dtype=float)
    rise = jnp.asarray(altitudes[1] - altitudes[0], dtype=float)
    shortest = jnp.clip(duration / 8, jnp.minimum(_SHORTEST_RAMP_S, duration / 3), _GENTLE_RAMP_S)
    ramp = duration / 3
    for _ in range(_LEVEL_OFF_ROUNDS):
        plateau = (rise - 0.5 * (climbs[0] + climbs[1]) * ramp) / (duration - ramp)
        change = jnp.maximum(jnp.abs(plateau - climbs[0]), jnp.abs(plateau - climbs[1]))
        ramp = jnp.clip(1.5 * change / CLIMB_ACCELERATION, shortest, duration / 2.5)
    plateau = (rise - 0.5 * (climbs[0] + climbs[1]) * ramp) / (duration - ramp)
    numbers = (
        duration,
        altitudes[0],
        climbs[0],
        climbs[1],
        climb_dot_0,
        plateau,
        ramp,
        detour,
        *speeds,
        speed_dot_0,
        speed_ramp(speeds[0], speeds[1], duration, rates),
        speed_ramp(speeds[1], speeds[2], duration, rates),
    )
    return Profile(*(jnp.asarray(x, dtype=float) for x in numbers))


class TabulatedProfile(eqx.Module):
    """Profile in a wind, with length and drift tabulated at equally spaced times from the start to the end."""

    profile: Profile  # the tabulated profile
    wind: AbstractWind  # motion of the air over the ground
    lengths: Float[Array, " times"]  # horizontal length flown through the air since the start, m
    drifts_n: Float[Array, "times 3"]  # displacement of the air since the start, NED, m

    @property
    def length(self) -> Scalar:
        """Length of the whole horizontal path through the air, m."""
        return self.lengths[..., -1]

    @property
    def drift_n(self) -> Vector3:
        """Displacement of the air from the start to the end of the profile, NED, m."""
        return self.drifts_n[..., -1, :]

    def rates(self, t: ScalarLike) -> tuple[Scalar, Vector3]:
        """Return horizontal airspeed, m/s, and wind, NED, m/s, `t` seconds after the start."""
        return horizontal_speed(self.profile, self.wind, t)

    def flown_at(self, t: ScalarLike) -> tuple[Scalar, Vector3]:
        """Return the horizontal length flown through the air, m, and the drift of the air, NED, m, at `t` (s)."""
        count = self.lengths.shape[0] - 1
        step = self.profile.duration / count
        k = jnp.clip(jnp.floor(t / step).astype(jnp.int32), 0, count - 1)
        length, drift = flown_between(self.profile, self.wind, k * step, t - k * step)
        return self.lengths[k] + length, self.drifts_n[k] + drift

    def time_at(self, length: ScalarLike) -> Scalar:
        """Return the time, s after the start, at which a horizontal length (m) has been flown through the air."""
        count = self.lengths.shape[0] - 1
        step = self.profile.duration / count
        k = jnp.clip(jnp.searchsorted(self.lengths, length, side="right") - 1, 0, count - 1)
        span = jnp.maximum(self.lengths[k + 1] - self.lengths[k], 1e-9)
        t = step * (k + jnp.clip((length - self.lengths[k]) / span, 0.0, 1.0))
        for _ in range(2):
            short = length - self.lengths[k] - flown_between(self.profile, self.wind, k * step, t - k * step)[0]
            t = jnp.clip(t + short / self.rates(t)[0], k * step, (k + 1) * step)
        return t


def horizontal_speed(profile: Profile, wind: AbstractWind, t: ScalarLike) -> tuple[Scalar, Vector3]:
    """Return horizontal airspeed, m/s, and wind at the profile's altitude, NED, m/s, `t` seconds after the start."""
    state = profile.at(t)
    wind_n = wind.at(jnp.stack([jnp.zeros(()), jnp.zeros(()), -state.altitude]), t)
    air_climb = state.climb + wind_n[2]
    return jnp.sqrt(jnp.maximum(state.speed**2 - air_climb**2, _SQUARE_MIN)), wind_n


def flown_between(profile: Profile, wind: AbstractWind, begin: ScalarLike, span: ScalarLike) -> tuple[Scalar, Vector3]:
    """Return the horizontal length flown through the air, m, and the displacement of the air, NED, m, in a time span.

    The span begins `begin` seconds after the start and lasts `span` seconds. The profile must have no kink within the
    span for an accurate result.
    """
    speeds, winds = jax.vmap(lambda u: horizontal_speed(profile, wind, begin + span * u))(jnp.asarray(_RULE.nodes))
    weights = span * jnp.asarray(_RULE.weights)
    return jnp.sum(weights * speeds), jnp.sum(weights[:, None] * winds, axis=0)


def tabulate(profile: Profile, wind: AbstractWind, intervals: int) -> TabulatedProfile:
    """Tabulate length through the air and drift of the air at the `intervals` + 1 bounds of equal time intervals."""
    step = profile.duration / intervals
    lengths, drifts = jax.vmap(lambda k: flown_between(profile, wind, k * step, step))(
        jnp.asarray(np.arange(intervals) * 1.0)
    )
    return TabulatedProfile(
        profile,
        wind,
        jnp.concatenate([jnp.zeros(1), jnp.cumsum(lengths)]),
        jnp.concatenate([jnp.zeros((1, 3)), jnp.cumsum(drifts, axis=0)]),
    )


def profile_excess(table: TabulatedProfile, limits: PathLimits, gravity: ScalarLike) -> Float[Array, "6"]:
    """Return the six greatest excesses over the limits at the times of the table, in this order; negative within.

    - least and greatest airspeed, m/s
    - climb rate through the air, m/s
    - least and greatest altitude, m
    - acceleration or deceleration along the path, m/s^2
    """
    profile = table.profile
    times = profile.duration * jnp.linspace(0.0, 1.0, table.lengths.shape[0])

    def excess_at(t: Scalar) -> Float[Array, "6"]:
        state = profile.at(t)
        climb = state.climb + table.rates(t)[1][2]
        along = state.speed_dot + gravity * climb / jnp.maximum(state.speed, 1.0)
        faster, slower = limits.along(state.speed, 1.0 + state.climb_dot / gravity)
        return jnp.stack(
            [
                limits.speed_min - state.speed,
                state.speed - limits.speed_max,
                jnp.abs(climb) - limits.climb_rate_max,
                limits.altitude_min - state.altitude,
                state.altitude - limits.altitude_max,
                jnp.maximum(along - faster, -along - slower),
            ]
        )

    return jnp.max(jax.vmap(excess_at)(times), axis=0)


def within_profile_limits(excess: Float[Array, "6"]) -> Flag:
    """Return whether all six excesses of `profile_excess` are at most 0, to rounding."""
    return jnp.all(excess <= 1e-9)
