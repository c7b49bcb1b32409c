"""Tasks of one aircraft: what is commanded, observed, rewarded and counted as success; and a scripted expert."""

import abc
from typing import Any, Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from anser.constants import STANDARD_GRAVITY_M_S2
from anser.control.feedback import wrap_angle
from anser.control.inversion_autopilot import LoopCommand
from anser.environment.environment import Environment
from anser.environments.cases import FlightRange, Rng, Situation, autopilot_of, steady_starts, trim_rows
from anser.environments.spaces import Entry
from anser.numerics.arrays import as_array
from anser.parts.paths import PathCommand, polar
from anser.shapes import Flag, Scalar, Vector3
from anser.simulation.vehicle import Vehicle
from anser.spatial.rotations import quaternion_from_rotation, rotate_back, rotation_from_quaternion
from anser.spatial.wind_axes import air_direction_b, attitude_from_path
from anser.steady.trim import TrimPoint
from anser.units import DEG_RAD, RAD_DEG

_ERROR_SCALE = 10.0
"""Error, in tolerances, at which its part of the reward is one half."""


class AbstractTask(eqx.Module):
    """Interface of the tasks of one aircraft. Subclass this class directly.

    A task makes the starts and the numbers of its episodes before the first step, and defines observation, errors,
    reward and failure. Success: all errors stay within the tolerances in the last `settled_s` of the episode.
    """

    #: Duration of an episode, and time at its end in which the errors must stay within the tolerances, s.
    duration_s: eqx.AbstractVar[float]
    settled_s: eqx.AbstractVar[float]
    #: Loop of the autopilot that the scripted expert commands.
    expert_loop: eqx.AbstractVar[Literal["attitude", "velocity"]]
    #: Levels of action at which the task is not solved by the autopilot itself.
    levels: tuple[str, ...] = eqx.field(static=True, default=("surfaces", "rates", "velocity"), kw_only=True)

    @abc.abstractmethod
    def draw(
        self, vehicle: Vehicle, environment: Environment, flown: FlightRange, count: int, rng: Rng
    ) -> tuple[TrimPoint, Any]:
        """Draw the starts and the task's numbers of many episodes: arrays with a leading axis over the episodes."""

    @abc.abstractmethod
    def errors(self, situation: Situation) -> Float[Array, " error"]:
        """Return the true errors, each divided by its tolerance."""

    @abc.abstractmethod
    def entries(self) -> tuple[Entry, ...]:
        """Return the table that describes the task's observations, which follow those of the aircraft's motion."""

    @abc.abstractmethod
    def observation(self, situation: Situation) -> tuple[Scalar, ...]:
        """Return the quantities of `entries`, from the aircraft's own estimates, in the units of the table."""

    @abc.abstractmethod
    def expert_command(self, situation: Situation) -> PathCommand | LoopCommand:
        """Return the command of the scripted expert to the loop `expert_loop` of the autopilot."""

    def has_failed(self, situation: Situation) -> Flag:
        """Whether the episode ends by failure, besides the ground and the limits of the aircraft: by default never."""
        return jnp.zeros((), bool)

    def reward(self, situation: Situation, errors: Float[Array, " error"]) -> Scalar:
        """Return the reward of a decision, 0..1: the mean over the errors of 1 / (1 + (error / 10 tolerances)^2)."""
        return jnp.mean(1.0 / (1.0 + (errors / _ERROR_SCALE) ** 2))


class CommandedState(eqx.Module):
    """Commanded values of a task, one per error; m/s, m and rad."""

    values: Float[Array, "*row error"]


def _command_errors(*pairs: tuple[Any, float]) -> Array:
    return jnp.stack([error / tolerance for error, tolerance in pairs])


class VelocityCommand(AbstractTask):
    """Reach and hold a commanded airspeed, path angle and course.

    The commands are steady flights within the aircraft's limits that its thrust reaches within 20 s: up to 30 m/s
    faster or slower, a path angle up to 10 deg, and a change of course up to 90 deg. A start for which 40 draws give no
    such command has level flight at its airspeed instead. Tolerances: 2 m/s, 1 deg, 2 deg.
    """

    duration_s: float = eqx.field(static=True, default=40.0)
    settled_s: float = eqx.field(static=True, default=5.0)
    speed_change_m_s: float = eqx.field(static=True, default=30.0)
    path_angle_deg: float = eqx.field(static=True, default=10.0)
    course_change_deg: float = eqx.field(static=True, default=90.0)
    expert_loop: Literal["attitude", "velocity"] = eqx.field(static=True, default="velocity")

    def draw(
        self, vehicle: Vehicle, environment: Environment, flown: FlightRange, count: int, rng: Rng
    ) -> tuple[TrimPoint, Any]:
        """Draw steady starts, and commands that are steady flights too."""
        starts = steady_starts(vehicle, environment, flown, count, rng)
        V, _, chi = _path_of(starts)
        altitude = -np.asarray(starts.state.position_n)[:, 2]
        speed, path_angle = np.array(V), np.zeros(count)
        missing = np.arange(count)
        for _ in range(_DRAWS_MAX):
            size = missing.size
            faster = V[missing] + rng.uniform(-1.0, 1.0, size) * self.speed_change_m_s
            speed[missing] = np.clip(faster, *flown.speed_m_s)
            path_angle[missing] = rng.uniform(-1.0, 1.0, size) * self.path_angle_deg * DEG_RAD
            # flight with a rate of the airspeed needs the thrust of steady flight on a steeper path
            steeper = (speed - V) / (_SPEED_CHANGE_TIME_S * STANDARD_GRAVITY_M_S2)
            is_steady = np.ones(size, bool)
            for angle in (path_angle, path_angle + steeper):
                targets = {"speed": speed[missing], "altitude": altitude[missing], "path_angle": angle[missing]}
                is_steady &= trim_rows(vehicle.airframe, environment, targets)[1]
            missing = missing[~is_steady]
            if not missing.size:
                break
        speed[missing], path_angle[missing] = V[missing], 0.0
        course = chi + rng.uniform(-1.0, 1.0, count) * self.course_change_deg * DEG_RAD
        return starts, CommandedState(as_array(np.stack([speed, path_angle, course], axis=-1)))

    def errors(self, situation: Situation) -> Float[Array, " error"]:
        """Return the errors of airspeed, path angle and course, each divided by its tolerance."""
        v, (V, gamma, chi) = situation.variables, situation.case.task.values
        return _command_errors(
            (v["airspeed_m_s"] - V, 2.0),
            (v["path_angle_deg"] * DEG_RAD - gamma, 1.0 * DEG_RAD),
            (wrap_angle(v["course_deg"] * DEG_RAD - chi), 2.0 * DEG_RAD),
        )

    def entries(self) -> tuple[Entry, ...]:
        """Return the table of entries: differences between command and present value, and commanded path angle."""
        return (
            Entry("airspeed_error_m_s", "m s-1", 0.0, 30.0, "Commanded less present airspeed"),
            Entry("path_angle_error_deg", "degree", 0.0, 20.0, "Commanded less present path angle"),
            Entry("course_error_deg", "degree", 0.0, 180.0, "Commanded less present course"),
            Entry("path_angle_command_deg", "degree", 0.0, 10.0, "Commanded path angle"),
        )

    def observation(self, situation: Situation) -> tuple[Scalar, ...]:
        """Return the entries from the aircraft's own estimates."""
        v, (V, gamma, chi) = situation.estimates, situation.case.task.values
        course_error = wrap_angle(chi - v["course_deg"] * DEG_RAD) * RAD_DEG
        return V - v["airspeed_m_s"], gamma * RAD_DEG - v["path_angle_deg"], course_error, gamma * RAD_DEG

    def expert_command(self, situation: Situation) -> PathCommand:
        """Return the commanded airspeed, path angle and course as path command."""
        return _path_command(*situation.case.task.values)


class AltitudeChange(AbstractTask):
    """Climb or descend to an altitude and an airspeed, and hold both on the course of the start.

    Altitude up to 500 m higher or lower, airspeed up to 20 m/s faster or slower. Tolerances: 15 m, 2 m/s, 3 deg.
    """

    duration_s: float = eqx.field(static=True, default=90.0)
    settled_s: float = eqx.field(static=True, default=5.0)
    altitude_change_m: float = eqx.field(static=True, default=500.0)
    speed_change_m_s: float = eqx.field(static=True, default=20.0)
    expert_loop: Literal["attitude", "velocity"] = eqx.field(static=True, default="velocity")

    def draw(
        self, vehicle: Vehicle, environment: Environment, flown: FlightRange, count: int, rng: Rng
    ) -> tuple[TrimPoint, Any]:
        """Draw steady starts, and altitudes and airspeeds at which the aircraft has level flight."""
        starts = steady_starts(vehicle, environment, flown, count, rng)
        V, _, chi = _path_of(starts)
        start_altitude = -np.asarray(starts.state.position_n)[:, 2]
        altitude, speed = start_altitude.copy(), np.array(V)
        missing = np.arange(count)
        for _ in range(_DRAWS_MAX):
            size = missing.size
            higher = start_altitude[missing] + rng.uniform(-1.0, 1.0, size) * self.altitude_change_m
            faster = V[missing] + rng.uniform(-1.0, 1.0, size) * self.speed_change_m_s
            altitude[missing], speed[missing] = np.clip(higher, *flown.altitude_m), np.clip(faster, *flown.speed_m_s)
            targets = {"speed": speed[missing], "altitude": altitude[missing]}
            missing = missing[~trim_rows(vehicle.airframe, environment, targets)[1]]
            if not missing.size:
                break
        altitude[missing], speed[missing] = start_altitude[missing], V[missing]
        return starts, CommandedState(as_array(np.stack([altitude, speed, chi], axis=-1)))

    def errors(self, situation: Situation) -> Float[Array, " error"]:
        """Return the errors of altitude, airspeed and course, each divided by its tolerance."""
        v, (altitude, V, chi) = situation.variables, situation.case.task.values
        return _command_errors(
            (v["altitude_m"] - altitude, 15.0),
            (v["airspeed_m_s"] - V, 2.0),
            (wrap_angle(v["course_deg"] * DEG_RAD - chi), 3.0 * DEG_RAD),
        )

    def entries(self) -> tuple[Entry, ...]:
        """Return the differences between command and present value."""
        return (
            Entry("altitude_error_m", "m", 0.0, 500.0, "Commanded less present altitude"),
            Entry("airspeed_error_m_s", "m s-1", 0.0, 30.0, "Commanded less present airspeed"),
            Entry("course_error_deg", "degree", 0.0, 180.0, "Commanded less present course"),
        )

    def observation(self, situation: Situation) -> tuple[Scalar, ...]:
        """Return the entries from the aircraft's own estimates."""
        v, (altitude, V, chi) = situation.estimates, situation.case.task.values
        course_error = wrap_angle(chi - v["course_deg"] * DEG_RAD) * RAD_DEG
        return altitude - v["altitude_m"], V - v["airspeed_m_s"], course_error

    def expert_command(self, situation: Situation) -> PathCommand:
        """Return a climb rate in proportion to the altitude error, up to 8 m/s, at the commanded airspeed."""
        v, (altitude, V, chi) = situation.estimates, situation.case.task.values
        climb_rate = jnp.clip(_CLIMB_GAIN * (altitude - v["altitude_m"]), -_CLIMB_RATE_MAX_M_S, _CLIMB_RATE_MAX_M_S)
        return _path_command(V, jnp.arcsin(jnp.clip(climb_rate / v["airspeed_m_s"], -0.5, 0.5)), chi)


class UpsetRecovery(AbstractTask):
    """Recover from an upset to level flight with level wings, at any course.

    The start has up to 60 deg of bank, an angle of attack up to 25 deg, path angles up to 30 deg and body rates up to
    30 deg/s. Tolerances at the end: 3 deg of path angle, 5 deg of bank, 5 deg/s of roll rate.
    """

    duration_s: float = eqx.field(static=True, default=20.0)
    settled_s: float = eqx.field(static=True, default=3.0)
    bank_deg: float = eqx.field(static=True, default=60.0)
    alpha_deg: tuple[float, float] = eqx.field(static=True, default=(-5.0, 25.0))
    path_angle_deg: float = eqx.field(static=True, default=30.0)
    rate_deg_s: float = eqx.field(static=True, default=30.0)
    expert_loop: Literal["attitude", "velocity"] = eqx.field(static=True, default="velocity")
    levels: tuple[str, ...] = eqx.field(static=True, default=("surfaces", "rates"), kw_only=True)

    def draw(
        self, vehicle: Vehicle, environment: Environment, flown: FlightRange, count: int, rng: Rng
    ) -> tuple[TrimPoint, Any]:
        """Draw upsets at the airspeeds and altitudes of level flights; commanded is the airspeed of the start."""
        level = FlightRange(flown.speed_m_s, flown.altitude_m, 0.0, 0.0, 0.0)
        trims = steady_starts(vehicle, environment, level, count, rng)
        V, _, chi = _path_of(trims)
        alpha = rng.uniform(*self.alpha_deg, count) * DEG_RAD
        bank = rng.uniform(-1.0, 1.0, count) * self.bank_deg * DEG_RAD
        path_angle = rng.uniform(-1.0, 1.0, count) * self.path_angle_deg * DEG_RAD
        rates_b = rng.uniform(-1.0, 1.0, (count, 3)) * self.rate_deg_s * DEG_RAD
        upsets = jax.jit(jax.vmap(_upset))
        starts = jax.tree.map(np.asarray, upsets(trims, V, chi, alpha, bank, path_angle, rates_b))
        return starts, CommandedState(as_array(V[:, None]))

    def errors(self, situation: Situation) -> Float[Array, " error"]:
        """Return path angle, bank and roll rate, the errors from level flight, each divided by its tolerance."""
        v = situation.variables
        return _command_errors(
            (v["path_angle_deg"], 3.0),
            (wrap_angle(v["bank_deg"] * DEG_RAD) * RAD_DEG, 5.0),
            (v["roll_rate_deg_s"], 5.0),
        )

    def entries(self) -> tuple[Entry, ...]:
        """Return the table with one entry: commanded airspeed less present airspeed."""
        return (Entry("airspeed_error_m_s", "m s-1", 0.0, 30.0, "Airspeed of the start less present airspeed"),)

    def observation(self, situation: Situation) -> tuple[Scalar, ...]:
        """Return the value of the one entry, m/s, from the aircraft's own estimate."""
        return (situation.case.task.values[0] - situation.estimates["airspeed_m_s"],)

    def expert_command(self, situation: Situation) -> PathCommand:
        """Return level flight at the airspeed of the start on the present course."""
        return _path_command(situation.case.task.values[0], jnp.zeros(()), situation.estimates["course_deg"] * DEG_RAD)


class AttitudeHold(AbstractTask):
    """Hold the attitude of the start, then follow steps of bank and angle of attack, without sideslip.

    The bank is about the velocity vector. Every 5 s after the first 3 s, a new bank up to 45 deg and a new angle of
    attack up to 4 deg from that of the start are commanded. Tolerances: 3 deg, 1 deg, 1 deg of sideslip.
    """

    duration_s: float = eqx.field(static=True, default=13.0)
    settled_s: float = eqx.field(static=True, default=2.0)
    bank_deg: float = eqx.field(static=True, default=45.0)
    alpha_change_deg: float = eqx.field(static=True, default=4.0)
    expert_loop: Literal["attitude", "velocity"] = eqx.field(static=True, default="attitude")
    levels: tuple[str, ...] = eqx.field(static=True, default=("surfaces", "rates"), kw_only=True)

    def draw(
        self, vehicle: Vehicle, environment: Environment, flown: FlightRange, count: int, rng: Rng
    ) -> tuple[TrimPoint, Any]:
        """Draw steady starts and the commands of the three intervals."""
        starts = steady_starts(vehicle, environment, flown, count, rng)
        limits = autopilot_of(vehicle).limits
        bank, alpha = np.asarray(starts.mu), np.asarray(starts.alpha)
        banks = [bank, *(rng.uniform(-1.0, 1.0, (2, count)) * self.bank_deg * DEG_RAD)]
        changes = rng.uniform(-1.0, 1.0, (2, count)) * self.alpha_change_deg * DEG_RAD
        low, high = float(limits.alpha_min) + 3.0 * DEG_RAD, float(limits.alpha_max) - 3.0 * DEG_RAD
        alphas = [alpha, *np.clip(alpha + changes, low, high)]
        throttle = np.asarray(starts.controls.throttle)
        return starts, AttitudeSteps(
            as_array(np.stack(banks, axis=-1)), as_array(np.stack(alphas, axis=-1)), as_array(throttle)
        )

    def _command(self, situation: Situation) -> tuple[Scalar, Scalar]:
        task, time = situation.case.task, situation.time
        later, last = time >= 3.0, time >= 8.0

        def at(values: Array) -> Scalar:
            return jnp.where(last, values[2], jnp.where(later, values[1], values[0]))

        return at(task.bank), at(task.alpha)

    def errors(self, situation: Situation) -> Float[Array, " error"]:
        """Return the errors of bank, angle of attack and sideslip, each divided by its tolerance."""
        v, (bank, alpha) = situation.variables, self._command(situation)
        return _command_errors(
            (wrap_angle(v["bank_deg"] * DEG_RAD - bank), 3.0 * DEG_RAD),
            (v["alpha_deg"] * DEG_RAD - alpha, 1.0 * DEG_RAD),
            (v["beta_deg"], 1.0),
        )

    def entries(self) -> tuple[Entry, ...]:
        """Return the differences between command and present value."""
        return (
            Entry("bank_error_deg", "degree", 0.0, 90.0, "Commanded less present bank"),
            Entry("alpha_error_deg", "degree", 0.0, 10.0, "Commanded less present angle of attack"),
        )

    def observation(self, situation: Situation) -> tuple[Scalar, ...]:
        """Return the entries from the aircraft's own estimates."""
        v, (bank, alpha) = situation.estimates, self._command(situation)
        return wrap_angle(bank - v["bank_deg"] * DEG_RAD) * RAD_DEG, alpha * RAD_DEG - v["alpha_deg"]

    def expert_command(self, situation: Situation) -> LoopCommand:
        """Return the commanded attitude without sideslip, and the throttle of the start."""
        bank, alpha = self._command(situation)
        attitude = jnp.stack([bank, alpha, jnp.zeros_like(bank)])
        return LoopCommand(attitude, jnp.zeros_like(attitude), situation.case.task.throttle)


class AttitudeSteps(eqx.Module):
    """Commanded bank and angle of attack in the three intervals of an episode, rad, and the throttle of the start."""

    bank: Float[Array, "*row 3"]
    alpha: Float[Array, "*row 3"]
    throttle: Float[Array, "*row"]


_DRAWS_MAX = 40
_SPEED_CHANGE_TIME_S = 20.0
_CLIMB_GAIN = 0.25
_CLIMB_RATE_MAX_M_S = 8.0


def _path_command(V: Scalar, gamma: Scalar, chi: Scalar) -> PathCommand:
    zero = jnp.zeros_like(V)
    return PathCommand(V, gamma.astype(V.dtype), chi, zero, zero, zero)


def _path_of(starts: TrimPoint) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return airspeed, path angle and course (m/s, rad) of steady flights in still air."""
    path = jax.tree.map(np.asarray, jax.jit(jax.vmap(still_air_path))(starts))
    return path.V, path.gamma, path.chi


def still_air_path(start: TrimPoint) -> PathCommand:
    """Return airspeed, path angle and course of a start in still air."""
    velocity_n = rotate_back(rotation_from_quaternion(start.state.quaternion), start.state.velocity_b)
    return polar(velocity_n, jnp.zeros_like(velocity_n))


def _upset(
    trim: TrimPoint, V: Scalar, chi: Scalar, alpha: Scalar, bank: Scalar, path_angle: Scalar, rates_b: Vector3
) -> TrimPoint:
    """Return a start with another attitude, path and body rates than a level flight; surfaces and engine are kept."""
    beta = jnp.zeros_like(alpha)
    quaternion = quaternion_from_rotation(attitude_from_path(bank, path_angle, chi, alpha, beta))
    return eqx.tree_at(
        lambda p: (p.state.velocity_b, p.state.quaternion, p.state.rates_b, p.mu, p.alpha, p.beta),
        trim,
        (V * air_direction_b(alpha, beta), quaternion, rates_b, bank, alpha, beta),
    )
