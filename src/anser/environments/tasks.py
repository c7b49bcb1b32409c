"""Tasks of one aircraft: commands, observations, reward, success and failure, and the scripted expert's commands."""

import abc
from collections.abc import Callable
from typing import Any, ClassVar, Literal, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from anser.aircraft.airframe import AircraftState
from anser.constants import STANDARD_GRAVITY_M_S2
from anser.control.feedback import wrap_angle
from anser.control.inversion_autopilot import LoopCommand
from anser.environment.environment import Environment
from anser.environments.cases import FlightRange, Rng, Situation, autopilot_of, steady_starts, trim_rows
from anser.environments.spaces import Entry, catalogue_entry
from anser.numerics.arrays import as_array
from anser.parts.paths import PathCommand, polar
from anser.shapes import Flag, Scalar, Vector3
from anser.simulation.vehicle import Vehicle
from anser.spatial.rotations import quaternion_from_rotation, rotate_back, rotation_from_quaternion
from anser.spatial.wind_axes import air_direction_b, attitude_from_path
from anser.steady.trim import TrimPoint
from anser.units import DEG_RAD, RAD_DEG

_ERROR_SCALE = 10.0
"""Ratio of error to tolerance at which an error's part of the reward is one half."""

Drawn = tuple[TrimPoint, Any]
"""Starts and task numbers (such as commands) of many episodes, both with a leading axis over the episodes."""


class AbstractTask(eqx.Module):
    """Interface of the tasks of one aircraft. Subclass this class directly.

    Success: all errors are within the tolerances at every decision in the last `settled_s` seconds of a full episode.
    """

    duration_s: eqx.AbstractVar[float]  #: Duration of a full episode, s.
    settled_s: eqx.AbstractVar[float]  #: Time at the end in which the errors must stay within the tolerances, s.
    #: Autopilot loop that gets the command of `expert_command`.
    expert_loop: Literal["attitude", "velocity"] = eqx.field(static=True, default="velocity", kw_only=True)
    #: Levels of action that the task allows: at other levels the autopilot itself would solve the task.
    levels: tuple[str, ...] = eqx.field(static=True, default=("surfaces", "rates", "velocity"), kw_only=True)

    @abc.abstractmethod
    def draw(self, vehicle: Vehicle, environment: Environment, flown: FlightRange, count: int, rng: Rng) -> Drawn:
        """Draw the starts of `count` episodes, and the task's commands or other data, both with a leading axis.

        `environment` must have no wind; `flown` is the range of the flight conditions at the starts.
        """

    @abc.abstractmethod
    def errors(self, situation: Situation) -> Float[Array, " error"]:
        """Return the true errors divided by the tolerances."""

    @abc.abstractmethod
    def entries(self) -> tuple[Entry, ...]:
        """Return the task's entries of the observation, which come after the entries of motion and surfaces."""

    @abc.abstractmethod
    def observation(self, situation: Situation) -> tuple[Scalar, ...]:
        """Return the quantities of `entries`, not normalized, as the aircraft estimates them."""

    @abc.abstractmethod
    def expert_command(self, situation: Situation) -> PathCommand | LoopCommand:
        """Return the scripted expert's command to the autopilot's loop `expert_loop`."""

    def has_failed(self, situation: Situation) -> Flag:
        """Whether this task ends the episode by failure (default: never); see also `AircraftEnvironment.judge`."""
        return jnp.zeros((), bool)

    def reward(self, situation: Situation, errors: Float[Array, " error"]) -> Scalar:
        """Return the reward of a decision, 0..1: the mean of 1 / (1 + (e / 10)^2) over the entries e of `errors`."""
        return jnp.mean(1.0 / (1.0 + (errors / _ERROR_SCALE) ** 2))


class Aim(NamedTuple):
    """A variable that a task commands. Tolerance and scales are in the unit of the variable's dataset name."""

    name: str  #: Dataset name of the variable, such as "path_angle_deg".
    tolerance: float = 0.0  #: Tolerance of the error; 0: the task does not judge the error.
    difference_scale: float = 0.0  #: Commanded minus present value that is observed as 1; 0: not observed.
    command_scale: float = 0.0  #: Commanded value that is observed as 1; 0: not observed.

    def error(self, command: Scalar | None, value: Scalar) -> Scalar:
        """Return (value - command) / tolerance; differences of course and bank are wrapped to -180..180 deg.

        `value` is in the variable's unit. `command` is in SI units (angles in rad); None means a command of 0.
        """
        if command is None:
            return value / self.tolerance
        unit = DEG_RAD if self._is_angular else 1.0
        difference = value * unit - command
        return (wrap_angle(difference) if self.name in _CYCLIC else difference) / (self.tolerance * unit)

    def shown(self, command: Scalar | None, value: Scalar) -> Scalar:
        """Return command minus value in the variable's unit. For arguments and wrapping see `error`."""
        if self.name in _CYCLIC:
            return wrap_angle((0.0 if command is None else command) - value * DEG_RAD) * RAD_DEG
        return self.commanded(command) - value

    def commanded(self, command: Scalar | None) -> Scalar:
        """Convert a command from SI units to the variable's unit, for the observation; None means a command of 0."""
        if command is None:
            return jnp.zeros(())
        return command * RAD_DEG if self._is_angular else command

    @property
    def _is_angular(self) -> bool:
        return self.name.endswith(("_deg", "_deg_s"))


_CYCLIC = "course_deg", "bank_deg"
"""Variables whose differences are wrapped to -180..180 deg."""


class AbstractCommandTask(AbstractTask):
    """Base of the tasks that command variables of the catalogue."""

    aims: ClassVar[tuple[Aim, ...]]  #: Commanded variables, from which errors and observations follow.

    def commands(self, situation: Situation) -> tuple[Any, ...]:
        """Return the present command of each aim in SI units; None means 0. The default commands are `Case.task`."""
        return tuple(situation.case.task)

    def errors(self, situation: Situation) -> Float[Array, " error"]:
        """Return the true error of each aim that has a tolerance, divided by the tolerance."""
        aims, v = zip(self.aims, self.commands(situation), strict=True), situation.variables
        return jnp.stack([aim.error(command, v[aim.name]) for aim, command in aims if aim.tolerance])

    def entries(self) -> tuple[Entry, ...]:
        """Return the table of the task's entries: commanded minus present values, then commanded values."""
        differences = [(aim.name, aim.difference_scale, "_error", "Commanded less present") for aim in self.aims]
        commands = [(aim.name, aim.command_scale, "_command", "Commanded") for aim in self.aims]
        rows = (*differences, *commands)
        return tuple(catalogue_entry(name, 0.0, scale, *texts) for name, scale, *texts in rows if scale)

    def observation(self, situation: Situation) -> tuple[Scalar, ...]:
        """Return the quantities of `entries`, not normalized, as the aircraft estimates them."""
        aims, v = list(zip(self.aims, self.commands(situation), strict=True)), situation.estimates
        differences = [aim.shown(command, v[aim.name]) for aim, command in aims if aim.difference_scale]
        return (*differences, *(aim.commanded(command) for aim, command in aims if aim.command_scale))


def _steady_commands(count: int, draw: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]], level: Any) -> np.ndarray:
    """Draw a pair of commands that gives a steady flight for each of `count` starts, shape (2, count).

    `draw` takes indices of starts; it returns a pair for each index, shape (2, index), and flags of the pairs that give
    a steady flight. If 40 draws give no steady flight for a start, the start gets its pair in `level`, (2, count).
    """
    commands, missing = np.array(level, dtype=float), np.arange(count)
    for _ in range(_DRAWS_MAX):
        drawn, is_steady = draw(missing)
        commands[:, missing[is_steady]] = drawn[:, is_steady]
        missing = missing[~is_steady]
        if not missing.size:
            break
    return commands


class VelocityCommand(AbstractCommandTask):
    """Reach and hold a commanded airspeed, path angle and course.

    Airspeed and course differ from the start by up to 30 m/s and 90 deg; the path angle is up to 10 deg. A steady
    flight exists at the commanded airspeed and path angle, and the thrust suffices to change the airspeed within 20 s.
    If 40 draws find no such command, level flight at the start's airspeed is commanded. Tolerances: 2 m/s, 1 deg,
    2 deg.
    """

    duration_s: float = eqx.field(static=True, default=40.0)
    settled_s: float = eqx.field(static=True, default=5.0)
    speed_change_m_s: float = eqx.field(static=True, default=30.0)
    path_angle_deg: float = eqx.field(static=True, default=10.0)
    course_change_deg: float = eqx.field(static=True, default=90.0)
    aims: ClassVar[tuple[Aim, ...]] = (
        Aim("airspeed_m_s", tolerance=2.0, difference_scale=30.0),
        Aim("path_angle_deg", tolerance=1.0, difference_scale=20.0, command_scale=10.0),
        Aim("course_deg", tolerance=2.0, difference_scale=180.0),
    )

    def draw(self, vehicle: Vehicle, environment: Environment, flown: FlightRange, count: int, rng: Rng) -> Drawn:
        """Draw steady starts, and commands (airspeed m/s, path angle rad, course rad), shape (episode, 3)."""
        starts = steady_starts(vehicle, environment, flown, count, rng)
        V, chi, altitude = _level_of(starts)

        def draw(rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            faster = V[rows] + rng.uniform(-1.0, 1.0, rows.size) * self.speed_change_m_s
            speed = np.clip(faster, *flown.speed_m_s)
            path_angle = rng.uniform(-1.0, 1.0, rows.size) * self.path_angle_deg * DEG_RAD
            # flight with a rate of the airspeed needs the thrust of steady flight on a steeper path
            steeper = (speed - V[rows]) / (_SPEED_CHANGE_TIME_S * STANDARD_GRAVITY_M_S2)
            is_steady = np.ones(rows.size, bool)
            for angle in (path_angle, path_angle + steeper):
                targets = {"speed": speed, "altitude": altitude[rows], "path_angle": angle}
                is_steady &= trim_rows(vehicle.airframe, environment, targets)[1]
            return np.stack([speed, path_angle]), is_steady

        speed, path_angle = _steady_commands(count, draw, [V, np.zeros(count)])
        change = rng.uniform(-1.0, 1.0, count) * self.course_change_deg * DEG_RAD
        course = np.asarray(wrap_angle(as_array(chi + change)))
        return starts, as_array(np.stack([speed, path_angle, course], axis=-1))

    def expert_command(self, situation: Situation) -> PathCommand:
        """Return the commanded airspeed, path angle and course as a path command."""
        return _path_command(*situation.case.task)


class AltitudeChange(AbstractCommandTask):
    """Climb or descend to a commanded altitude and airspeed, and hold both on the course of the start.

    The commands differ from the start by up to 500 m and 20 m/s. Tolerances: 15 m, 2 m/s, 3 deg of course.
    """

    duration_s: float = eqx.field(static=True, default=90.0)
    settled_s: float = eqx.field(static=True, default=5.0)
    altitude_change_m: float = eqx.field(static=True, default=500.0)
    speed_change_m_s: float = eqx.field(static=True, default=20.0)
    aims: ClassVar[tuple[Aim, ...]] = (
        Aim("altitude_m", tolerance=15.0, difference_scale=500.0),
        Aim("airspeed_m_s", tolerance=2.0, difference_scale=30.0),
        Aim("course_deg", tolerance=3.0, difference_scale=180.0),
    )

    def draw(self, vehicle: Vehicle, environment: Environment, flown: FlightRange, count: int, rng: Rng) -> Drawn:
        """Draw steady starts, and commands (altitude m, airspeed m/s, course rad), shape (episode, 3).

        A steady level flight exists at the commanded altitude and airspeed. If 40 draws find no such flight, the
        altitude and the airspeed of the start are commanded.
        """
        starts = steady_starts(vehicle, environment, flown, count, rng)
        V, chi, start_altitude = _level_of(starts)

        def draw(rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            higher = start_altitude[rows] + rng.uniform(-1.0, 1.0, rows.size) * self.altitude_change_m
            faster = V[rows] + rng.uniform(-1.0, 1.0, rows.size) * self.speed_change_m_s
            altitude, speed = np.clip(higher, *flown.altitude_m), np.clip(faster, *flown.speed_m_s)
            targets = {"speed": speed, "altitude": altitude}
            return np.stack([altitude, speed]), trim_rows(vehicle.airframe, environment, targets)[1]

        commands = _steady_commands(count, draw, [start_altitude, V])
        return starts, as_array(np.stack([*commands, chi], axis=-1))

    def expert_command(self, situation: Situation) -> PathCommand:
        """Return the commanded airspeed and course, and a path angle that reduces the altitude error.

        The climb rate is proportional to the altitude error, up to 8 m/s up or down.
        """
        v, (altitude, V, chi) = situation.estimates, situation.case.task
        climb_rate = jnp.clip(_CLIMB_GAIN * (altitude - v["altitude_m"]), -_CLIMB_RATE_MAX_M_S, _CLIMB_RATE_MAX_M_S)
        return _path_command(V, jnp.arcsin(jnp.clip(climb_rate / v["airspeed_m_s"], -0.5, 0.5)), chi)


class UpsetRecovery(AbstractCommandTask):
    """Recover from an upset to level flight with level wings, at any course.

    At the start, bank is up to 60 deg, path angle up to 30 deg, and body rates are up to 30 deg/s. The angle of attack
    is between -5 and 25 deg, and within the range of the aircraft's data. Tolerances: 3 deg of path angle, 5 deg of
    bank, 5 deg/s of roll rate.
    """

    duration_s: float = eqx.field(static=True, default=20.0)
    settled_s: float = eqx.field(static=True, default=3.0)
    bank_deg: float = eqx.field(static=True, default=60.0)
    alpha_deg: tuple[float, float] = eqx.field(static=True, default=(-5.0, 25.0))
    path_angle_deg: float = eqx.field(static=True, default=30.0)
    rate_deg_s: float = eqx.field(static=True, default=30.0)
    levels: tuple[str, ...] = eqx.field(static=True, default=("surfaces", "rates"), kw_only=True)
    aims: ClassVar[tuple[Aim, ...]] = (
        Aim("path_angle_deg", tolerance=3.0),
        Aim("bank_deg", tolerance=5.0),
        Aim("roll_rate_deg_s", tolerance=5.0),
        Aim("airspeed_m_s", difference_scale=30.0),
    )

    def draw(self, vehicle: Vehicle, environment: Environment, flown: FlightRange, count: int, rng: Rng) -> Drawn:
        """Draw upsets at the airspeeds and altitudes of level flights; the command is the start's airspeed (m/s)."""
        level = FlightRange(flown.speed_m_s, flown.altitude_m, 0.0, 0.0, 0.0)
        trims = steady_starts(vehicle, environment, level, count, rng)
        V, chi, _ = _level_of(trims)
        low_deg, high_deg = (float(edge) * RAD_DEG for edge in vehicle.airframe.alpha_range)
        least, greatest = np.clip(self.alpha_deg, low_deg, high_deg)
        alpha = rng.uniform(least, greatest, count) * DEG_RAD
        bank = rng.uniform(-1.0, 1.0, count) * self.bank_deg * DEG_RAD
        path_angle = rng.uniform(-1.0, 1.0, count) * self.path_angle_deg * DEG_RAD
        rates_b = rng.uniform(-1.0, 1.0, (count, 3)) * self.rate_deg_s * DEG_RAD
        upsets = jax.jit(jax.vmap(_upset))
        starts = jax.tree.map(np.asarray, upsets(trims, V, chi, alpha, bank, path_angle, rates_b))
        return starts, as_array(V[:, None])

    def commands(self, situation: Situation) -> tuple[Any, ...]:
        """Return the commands: path angle, bank and roll rate 0, and the airspeed of the start (m/s)."""
        return None, None, None, situation.case.task[0]

    def expert_command(self, situation: Situation) -> PathCommand:
        """Return the command of level flight at the start's airspeed, on the presently estimated course."""
        return _path_command(situation.case.task[0], jnp.zeros(()), situation.estimates["course_deg"] * DEG_RAD)


class AttitudeHold(AbstractCommandTask):
    """Hold the attitude of the start, then follow steps of bank and angle of attack, without sideslip.

    After 3 s and after 8 s, new angles are commanded: a bank angle (about the velocity vector) up to 45 deg, and an
    angle of attack up to 4 deg from the start's angle, with a margin of 3 deg to the autopilot's limits. Tolerances:
    3 deg of bank, 1 deg of angle of attack, 1 deg of sideslip.
    """

    duration_s: float = eqx.field(static=True, default=13.0)
    settled_s: float = eqx.field(static=True, default=2.0)
    bank_deg: float = eqx.field(static=True, default=45.0)
    alpha_change_deg: float = eqx.field(static=True, default=4.0)
    expert_loop: Literal["attitude", "velocity"] = eqx.field(static=True, default="attitude", kw_only=True)
    levels: tuple[str, ...] = eqx.field(static=True, default=("surfaces", "rates"), kw_only=True)
    aims: ClassVar[tuple[Aim, ...]] = (
        Aim("bank_deg", tolerance=3.0, difference_scale=90.0),
        Aim("alpha_deg", tolerance=1.0, difference_scale=10.0),
        Aim("beta_deg", tolerance=1.0),
    )

    def draw(self, vehicle: Vehicle, environment: Environment, flown: FlightRange, count: int, rng: Rng) -> Drawn:
        """Draw steady starts, and the task's data: commands of bank and angle of attack (rad), and start throttle.

        Each command has shape (episode, 3), with values for the intervals to 3 s, from 3 to 8 s, and after 8 s.
        """
        starts = steady_starts(vehicle, environment, flown, count, rng)
        limits = autopilot_of(vehicle).limits
        bank, alpha = np.asarray(starts.mu), np.asarray(starts.alpha)
        banks = [bank, *(rng.uniform(-1.0, 1.0, (2, count)) * self.bank_deg * DEG_RAD)]
        changes = rng.uniform(-1.0, 1.0, (2, count)) * self.alpha_change_deg * DEG_RAD
        low, high = float(limits.alpha_min) + 3.0 * DEG_RAD, float(limits.alpha_max) - 3.0 * DEG_RAD
        alphas = [alpha, *np.clip(alpha + changes, low, high)]
        steps = (as_array(np.stack(values, axis=-1)) for values in (banks, alphas))
        return starts, (*steps, as_array(np.asarray(starts.controls.throttle)))

    def commands(self, situation: Situation) -> tuple[Any, ...]:
        """Return the present commands of bank and angle of attack (rad), and None for a sideslip of 0."""
        later, last = situation.time >= 3.0, situation.time >= 8.0
        bank, alpha = (jnp.where(last, v[2], jnp.where(later, v[1], v[0])) for v in situation.case.task[:2])
        return bank, alpha, None

    def expert_command(self, situation: Situation) -> LoopCommand:
        """Return the commanded bank and angle of attack (rad), sideslip 0, rates 0, and the throttle of the start."""
        bank, alpha, _ = self.commands(situation)
        attitude = jnp.stack([bank, alpha, jnp.zeros_like(bank)])
        return LoopCommand(attitude, jnp.zeros_like(attitude), situation.case.task[2])


_DRAWS_MAX = 40
_SPEED_CHANGE_TIME_S = 20.0
_CLIMB_GAIN = 0.25
_CLIMB_RATE_MAX_M_S = 8.0


def _path_command(V: Scalar, gamma: Scalar, chi: Scalar) -> PathCommand:
    zero = jnp.zeros_like(V)
    return PathCommand(V, gamma.astype(V.dtype), chi, zero, zero, zero)


def _level_of(starts: TrimPoint) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return airspeed (m/s), course (rad) and altitude (m) of steady flights in still air, each of shape (start,)."""

    def path(state: AircraftState) -> PathCommand:
        velocity_n = rotate_back(rotation_from_quaternion(state.quaternion), state.velocity_b)
        return polar(velocity_n, jnp.zeros_like(velocity_n))

    paths = jax.jit(jax.vmap(path))(starts.state)
    return np.asarray(paths.V), np.asarray(paths.chi), -np.asarray(starts.state.position_n)[:, 2]


def _upset(
    trim: TrimPoint, V: Scalar, chi: Scalar, alpha: Scalar, bank: Scalar, path_angle: Scalar, rates_b: Vector3
) -> TrimPoint:
    """Return the level flight `trim` with new velocity, attitude and body rates (m/s, rad, rad/s), no sideslip."""
    beta = jnp.zeros_like(alpha)
    quaternion = quaternion_from_rotation(attitude_from_path(bank, path_angle, chi, alpha, beta))
    return eqx.tree_at(
        lambda p: (p.state.velocity_b, p.state.quaternion, p.state.rates_b, p.mu, p.alpha, p.beta),
        trim,
        (V * air_direction_b(alpha, beta), quaternion, rates_b, bank, alpha, beta),
    )
