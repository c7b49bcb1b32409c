"""What step tests of an aircraft begin with: where, its gains and limits, and steps of sizes that suit it."""

import dataclasses
import math

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from anser.aircraft import AbstractAirframe, AbstractF16, condition
from anser.compiling import compiled
from anser.control import (
    AutopilotGains,
    FlightLimits,
    automatic_gains,
    default_limits,
    deflection_for_moment,
    surface_moments,
)
from anser.environment import Environment, standard_environment
from anser.execution.airframe_survey import flown_airspeeds
from anser.execution.conditions import Inversion, airframe_of, gains_for, steady_trim
from anser.execution.step_tests import PUBLISHED_PACE, PUBLISHED_STEPS, STEP_S, Pace, StepTest, suited_steps
from anser.numerics import as_array
from anser.scenario.build_own import Own, look_at
from anser.shapes import Scalar
from anser.simulation import ALPHA_LEFT, TrimPoint, trim_target
from anser.units import DEG_RAD, RAD_DEG

_F16_SPEED_M_S, _ALTITUDE_M = 150.0, 1000.0
_PART = 0.5
"""Part of what an aircraft has left that a step takes at most."""
_PATH_TURN = 0.6
"""By how much a held step of the angle of attack may bend the path until it is read, rad: about what the published one
does. A slow aircraft would fly over the top."""
_SIDESLIP_SEEN = _ALPHA_SEEN = 1.0 * DEG_RAD


@dataclasses.dataclass(frozen=True)
class StepCase:
    """A steady level flight that step tests leave.

    Attributes
    ----------
    airframe, trim
        What flies, and how.
    gains, limits
        Of its autopilot: the published ones of the F-16, of another aircraft its own.
    pace
        How slow its loops are, beside the published ones.
    own
        What it can do; None of the F-16.
    """

    airframe: AbstractAirframe
    trim: TrimPoint
    gains: AutopilotGains
    limits: FlightLimits
    pace: Pace
    own: Own | None


def usual_point(airframe: AbstractAirframe) -> tuple[float, float]:
    """Airspeed (m/s) and altitude (m) of an aircraft's step tests: half way, as a ratio, between least and greatest.

    150 m/s of the F-16; 1000 m, or the nearest altitude of the aircraft's data.
    """
    if isinstance(airframe, AbstractF16):
        return _F16_SPEED_M_S, _ALTITUDE_M
    ends = getattr(getattr(airframe, "validity", None), "altitude", (-math.inf, math.inf))
    altitude = min(max(_ALTITUDE_M, float(ends[0])), float(ends[1]))
    known = flown_airspeeds(airframe)
    able = look_at(airframe, altitude, math.sqrt(known[0] * known[1]), known, STEP_S).able
    if math.isnan(able.speed_min):
        return round(math.sqrt(known[0] * known[1])), altitude
    return float(round(math.sqrt(able.speed_min * able.speed_max))), altitude


def step_case(airframe: AbstractAirframe, speed_m_s: float, altitude_m: float, inversion: Inversion) -> StepCase:
    """Trim an aircraft, and find gains and limits of its own.

    Raises
    ------
    ConditionError
        It does not fly level there; the message says why.
    """
    environment, limits = standard_environment(), default_limits()
    trim = steady_trim(airframe, environment, trim_target(speed_m_s, altitude_m))
    if isinstance(airframe, AbstractF16):
        return StepCase(airframe, trim, gains_for(inversion), limits, PUBLISHED_PACE, None)
    own = look_at(airframe, altitude_m, speed_m_s, flown_airspeeds(airframe), STEP_S)
    able, bandwidths = own
    slowest, fastest = min(able.speed_min, speed_m_s), max(able.speed_max, speed_m_s)
    limits = eqx.tree_at(
        lambda one: (one.speed_min, one.speed_max, one.bank_max, one.alpha_min, one.alpha_max),
        limits,
        (
            as_array(slowest),
            as_array(fastest),
            as_array(min(float(limits.bank_max), able.bank_max)),
            *airframe.alpha_range,
        ),
    )
    pace = Pace(*(float(slow / np.min(fast[:2])) for slow, fast in zip(_PUBLISHED, _loops(own), strict=True)))
    gains = gains_for(inversion, automatic_gains(bandwidths))
    return StepCase(airframe, trim, gains, limits, pace, own)


_PUBLISHED = (5.0, 2.0, 1.0)
"""Bandwidths of the published loops, 1/s: rates, attitude, velocity."""


def _loops(own: Own) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return own.bandwidths.rates, own.bandwidths.attitude, own.bandwidths.velocity  # pyright: ignore[reportReturnType]


def steps_of(case: StepCase) -> tuple[StepTest, ...]:
    """Each channel of each loop alone, then all together: the published sizes, or less where the aircraft has less."""
    if case.own is None:
        return PUBLISHED_STEPS
    able, speed = case.own.able, float(np.linalg.norm(np.asarray(case.trim.state.velocity_b)))
    alpha_left = float(case.airframe.alpha_range[1]) - float(case.trim.alpha) - ALPHA_LEFT
    environment = standard_environment()
    beta_left = float(_sideslip_left(case.airframe, environment, case.trim))
    curving = _PATH_TURN * speed / (float(environment.gravity) * 6.0 * case.pace.attitude)
    alpha_curving = curving / max(float(_load_per_alpha(case.airframe, environment, case.trim)), 1e-6)
    faster = min(speed / 15.0, _PART * (float(case.limits.speed_max) - speed))
    climb = math.asin(min(able.climb_rate_max / speed, 1.0))
    return suited_steps(
        case.pace,
        attitude=(
            _short(min(30.0, 0.75 * RAD_DEG * float(case.limits.bank_max))),
            _short(min(5.0, _PART * RAD_DEG * alpha_left, RAD_DEG * alpha_curving)),
            _short(min(5.0, _PART * RAD_DEG * beta_left)),
        ),
        velocity=(_short(faster), _short(min(3.0, _PART * RAD_DEG * climb)), 20.0),
    )


def _short(value: float) -> float:
    """A number of two digits, not above the value."""
    if value <= 0.0:
        return 0.0
    digit = 10.0 ** (math.floor(math.log10(value)) - 1)
    return round(math.floor(value / digit + 1e-9) * digit, 6)


@compiled
def _load_per_alpha(airframe: AbstractAirframe, environment: Environment, trim: TrimPoint) -> Scalar:
    """Load factor by angle of attack, 1/rad."""
    now = condition(airframe, environment, 0.0, trim.state)
    surfaces, still = trim.state.surfaces, jnp.zeros(3)

    def lift(alpha: Scalar) -> Scalar:
        force_b = airframe.aerodynamics(eqx.tree_at(lambda d: d.alpha, now.air_data, alpha), still, surfaces).force_b
        return force_b[0] * jnp.sin(alpha) - force_b[2] * jnp.cos(alpha)

    weight = airframe.mass_properties.mass * environment.gravity
    return (lift(trim.alpha + _ALPHA_SEEN) - lift(trim.alpha)) / (_ALPHA_SEEN * weight)


def gallery_steps(
    aircraft: str | AbstractAirframe, variant: str = "textbook", at: tuple[float, float] | None = None
) -> tuple[tuple[StepTest, ...], tuple[float, float]]:
    """Tests of an aircraft, and the airspeed (m/s) and altitude (m) that they leave: `at`, or `usual_point`.

    Raises
    ------
    ConditionError
        It does not fly level there.
    ValueError
        No such airframe.
    """
    airframe = airframe_of(aircraft, variant)[0]
    speed_m_s, altitude_m = usual_point(airframe) if at is None else at
    return steps_of(step_case(airframe, speed_m_s, altitude_m, "model")), (speed_m_s, altitude_m)


def step_pace(aircraft: str | AbstractAirframe, variant: str, speed_m_s: float, altitude_m: float) -> Pace:
    """How slow the loops of an aircraft are; raises as `gallery_steps`."""
    return step_case(airframe_of(aircraft, variant)[0], speed_m_s, altitude_m, "model").pace


@compiled
def _sideslip_left(airframe: AbstractAirframe, environment: Environment, trim: TrimPoint) -> Scalar:
    """Sideslip whose moments take all that is left of the surfaces, rad."""
    now = condition(airframe, environment, 0.0, trim.state)
    data, surfaces = now.air_data, trim.state.surfaces
    aside = eqx.tree_at(lambda d: d.beta, data, data.beta + _SIDESLIP_SEEN)
    still = jnp.zeros(3)
    moment_b = airframe.aerodynamics(aside, still, surfaces).moment_b
    moment_b = moment_b - airframe.aerodynamics(data, still, surfaces).moment_b
    actuators = airframe.actuators
    moments = surface_moments(airframe, now, still, surfaces)
    needed = jnp.abs(deflection_for_moment(actuators, moments.slope) @ moment_b)
    left = jnp.minimum(surfaces - actuators.lower, actuators.upper - surfaces)
    commanded = np.flatnonzero(actuators.commanded)
    return _SIDESLIP_SEEN * jnp.min(left[commanded] / jnp.maximum(needed[commanded], 1e-6))
