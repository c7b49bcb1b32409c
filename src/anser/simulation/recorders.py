"""Recorders: samples of an aircraft or a fleet, the variables computed from them, and the loop that records rows."""

import abc
import math
from collections.abc import Callable, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.extend.core import jaxpr_as_fun
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float

from anser.aircraft.airframe import Controls
from anser.control.ground_clearance import GroundClearance
from anser.environment.gusts import AirFlow, Gust
from anser.numerics.arrays import zeros_like_result
from anser.parts.controllers import signal_variables
from anser.parts.paths import polar
from anser.parts.perception import Belief, GoalState, Instant, Truth, Uncertainty
from anser.parts.planners import AircraftPlan, NetworkView
from anser.shapes import Flag, Integer, Vector3
from anser.spatial.rotations import euler_from_quaternion, rotate, rotate_back, safe_hypot, safe_norm
from anser.spatial.vectors import safe_sqrt
from anser.spatial.wind_axes import bank_about_velocity, path_angles
from anser.variables import ADAPTATION_KEYS, all_surface_names, surface_variables

Members = tuple[int, ...]
"""Fleet indices of the aircraft of one aircraft group, in the group's order."""


def to_fleet_order(group_rows: Sequence[Any], members: tuple[Members, ...]) -> Any:
    """Return the arrays of all aircraft groups in fleet order; the leading axis is the aircraft."""
    if len(members) == 1 and _is_identity(members[0]):
        return group_rows[0]
    indices = [index for group_members in members for index in group_members]
    order = jnp.asarray([indices.index(k) for k in range(len(indices))])
    return jax.tree.map(lambda *leaves: jnp.concatenate(leaves)[order], *group_rows)


def to_group_order(fleet_rows: Any, members: Members, count: int) -> Any:
    """Return the entries of the aircraft `members` from arrays of a fleet of `count` aircraft."""
    if len(members) == count and _is_identity(members):
        return fleet_rows
    indices = jnp.asarray(members)
    return jax.tree.map(lambda leaf: leaf[indices], fleet_rows)


def _is_identity(members: Members) -> bool:
    return members == tuple(range(len(members)))


_PATH_COMMANDS = {"airspeed_command": "V", "path_angle_command": "gamma", "course_command": "chi"}
CONTROLLER_COMMANDS = (
    "thrust_command",
    "bank_command",
    "alpha_command",
    "beta_command",
    "roll_rate_command",
    "pitch_rate_command",
    "yaw_rate_command",
)
CONTROLLER_FLAGS = (
    "thrust_limited",
    "lift_limited",
    "bank_limited",
    "speed_limited",
    "rates_limited",
    "surfaces_limited",
)


def record(sample: "AircraftSample") -> dict[str, Array]:
    """Return one aircraft's variables at one sample by key of `anser.variables.catalogue`, in SI units and radians.

    If the controller has no signals, the controller's commands are NaN and the limit flags False. If the command is not
    a `PathCommand`, the commanded path is NaN. Variables of approach, gusts, estimation, network and adaptation are
    present only if the sample has them.
    """
    truth, state, condition = sample.truth, sample.truth.state, sample.truth.condition
    data, uncertainty = condition.air_data, sample.belief.uncertainty
    network = None if sample.plan is None else sample.plan.network
    surface_keys = [variable.key for variable in surface_variables(truth.airframe.actuators.names)]
    velocity_n = rotate_back(condition.R_bn, state.velocity_b)
    inertial_b = state.rates_b + rotate(condition.R_bn, condition.earth.earth_rate_n + condition.earth.transport_rate_n)
    euler = euler_from_quaternion(state.quaternion)
    _, ground_course = path_angles(velocity_n)
    air_path = polar(velocity_n - condition.wind_n, jnp.zeros_like(velocity_n))
    force_b = condition.wrench.force_b
    weight = truth.airframe.mass_properties.mass * condition.earth.gravity
    controls, missing = sample.controls, jnp.full_like(data.V, jnp.nan)
    return {
        **_position("", state.position_n),
        **_vector("velocity", ("north", "east", "down"), velocity_n),
        **_vector("velocity", ("u", "v", "w"), state.velocity_b),
        "ground_speed": safe_hypot(velocity_n[0], velocity_n[1]),
        "ground_course": ground_course,
        "airspeed": data.V,
        "alpha": data.alpha,
        "beta": data.beta,
        "mach": data.mach,
        "dynamic_pressure": data.qbar,
        **{f"quaternion_{k}": state.quaternion[k] for k in range(4)},
        "roll": euler[0],
        "pitch": euler[1],
        "yaw": euler[2],
        **_rates("", state.rates_b),
        **{f"inertial_{key}": value for key, value in _rates("", inertial_b).items()},
        "bank": bank_about_velocity(condition.R_bn, data.alpha, data.beta),
        "path_angle": air_path.gamma,
        "course": air_path.chi,
        "load_factor": -force_b[2] / weight,
        **dict(zip(surface_keys, (*state.surfaces, *controls.surfaces), strict=True)),
        "throttle": controls.throttle,
        "power": state.power,
        "thrust": condition.propulsive.force_b[0],
        **{key: getattr(sample.command, name, missing) for key, name in _PATH_COMMANDS.items()},
        **dict.fromkeys(CONTROLLER_COMMANDS, missing),
        **{key: jnp.asarray(False) for key in CONTROLLER_FLAGS},
        **signal_variables(sample.signals),
        "outside_tables": truth.airframe.outside_tables(data),
        "status": sample.status,
        **({} if sample.approach is None else _approach_variables(sample, sample.approach)),
        **({} if sample.flow is None else _gust_variables(truth.disturbance.gust, sample.flow)),
        **({} if uncertainty is None else _estimation_variables(sample.belief, uncertainty)),
        **({} if network is None else _network_variables(network)),
        **({} if sample.belief.estimates is None else sample.belief.estimates.variables()),
    }


def _gust_variables(gust: Gust, flow: AirFlow) -> dict[str, Array]:
    gust_rates = {f"gust_{key}": value for key, value in _rates("", gust.rates_b).items()}
    return {"airspeed_mean_wind": flow.airspeed, **_vector("gust", ("u", "v", "w"), gust.velocity_b), **gust_rates}


def _network_variables(view: NetworkView) -> dict[str, Array]:
    weights = 2 ** np.arange(view.hears.shape[0])
    return {
        "clock_lag": view.lag,
        "clock_rate": view.rate,
        "heard_from": jnp.sum(jnp.where(view.hears, weights, 0)).astype(jnp.int32),
        "path_offered": view.offers,
    }


def _estimation_variables(belief: Belief, uncertainty: Uncertainty) -> dict[str, Array]:
    position_sigma, goal_sigma = (
        safe_sqrt(jnp.stack([matrix[k, k] for k in range(3)]))
        for matrix in (uncertainty.position_covariance, uncertainty.goal_covariance)
    )
    axes, variance = ("north", "east", "altitude"), goal_sigma[0] * goal_sigma[1]
    return {
        **_position("own_estimate_", belief.state.position_n),
        **{f"own_sigma_{axis}": position_sigma[k] for k, axis in enumerate(axes)},
        **{f"goal_sigma_{axis}": goal_sigma[k] for k, axis in enumerate(axes)},
        "goal_correlation": uncertainty.goal_covariance[0, 1] / jnp.where(variance > 0.0, variance, 1.0),
        "goal_sigma_speed": safe_sqrt(uncertainty.goal_covariance[3, 3] + uncertainty.goal_covariance[4, 4]),
        "goal_nis": uncertainty.nis,
        "goal_seen": uncertainty.goal_is_measured,
        "goal_known": uncertainty.goal_status,
    }


def _approach_variables(sample: "AircraftSample", approach: "GoalApproach") -> dict[str, Array]:
    goal, estimate, sight, reference_n = (approach.goal, sample.belief.goal, sample.belief.sight, sample.reference_n)
    assert estimate is not None
    assert sight is not None
    assert reference_n is not None
    plan, axes = sample.plan, ("north", "east", "down")
    assert plan is not None
    return {
        **_position("reference_", reference_n),
        "position_error": safe_norm(reference_n - sample.truth.state.position_n),
        **_position("goal_", goal.position_n),
        **_position("goal_estimate_", estimate.position_n),
        **_vector("goal_velocity", axes, goal.velocity_n),
        **_vector("goal_estimate_velocity", axes, estimate.velocity_n),
        **_position("rendezvous_", approach.rendezvous_n),
        "range_to_rendezvous": safe_norm(approach.to_rendezvous_n),
        "clearance": safe_norm(approach.to_goal_n),
        **{f"sight_{name}": value for name, value in vars(sight).items()},
        "arrival_time": jnp.asarray(plan.arrival_time),
        "planned_length": jnp.asarray(plan.length),
        "lateral_bend": jnp.asarray(plan.lateral_bend),
        "phase": approach.phase,
        "renewal": plan.replanning,
    }


def _position(prefix: str, position_n: Vector3) -> dict[str, Array]:
    return {f"{prefix}north": position_n[0], f"{prefix}east": position_n[1], f"{prefix}altitude": -position_n[2]}


def _vector(prefix: str, names: tuple[str, str, str], vector: Vector3) -> dict[str, Array]:
    return {f"{prefix}_{name}": vector[k] for k, name in enumerate(names)}


def _rates(suffix: str, rates_b: Vector3) -> dict[str, Array]:
    return {f"{name}_rate{suffix}": rates_b[k] for k, name in enumerate(("roll", "pitch", "yaw"))}


class GoalApproach(eqx.Module):
    """Approach of one aircraft to its goal at one instant."""

    goal: GoalState  # true state of the goal
    rendezvous_n: Vector3  # rendezvous position, NED, m
    to_goal_n: Vector3  # straight line from the aircraft to the goal, NED, m
    to_rendezvous_n: Vector3  # straight line from the aircraft to the rendezvous, NED, m
    clearance: GroundClearance  # ground clearance in the present motion
    # `APPROACH`: flies the plan; `FROZEN`: flies the final plan; `HOLD`: after the arrival or a breakaway
    phase: Integer


class AircraftSample(eqx.Module):
    """Signals of one aircraft at one sampling instant, before the step."""

    truth: Truth  #: True state.
    belief: Belief  #: Estimated state.
    controls: Controls  #: Surfaces and throttle from the controller.
    signals: Any  #: Signals of the controller to record; None: no signals.
    command: Any  #: Command of the guidance.
    reference_n: Vector3 | None  #: Position that the guidance follows, NED, m.
    plan: AircraftPlan | None  #: The aircraft's plan; None: no planner.
    approach: GoalApproach | None  #: Approach to the goal; None for an aircraft without a mission.
    status: Integer  #: Status code: index into `STATUS_MESSAGES`.
    flow: AirFlow | None = None  #: Input of the gust model; None if no gusts are simulated.


class FleetSample(eqx.Module):
    """Signals of a fleet at one instant, by aircraft group."""

    groups: tuple[AircraftSample, ...]  #: Samples of each group, stacked; leading axis members.
    members: tuple[tuple[int, ...], ...] = eqx.field(static=True)  #: Fleet indices of each group's aircraft.

    def rows(self, aircraft_variables: Callable[[AircraftSample], dict[str, Array]]) -> dict[str, Array]:
        """Return the variables from `aircraft_variables` by key, with a leading axis in fleet order.

        The result has the variables that all groups have, and the control surfaces and adaptation estimates of any
        group. If an aircraft lacks such a surface or estimate, the value is NaN; a missing fault code is 0.
        """
        group_rows = [jax.vmap(aircraft_variables)(samples) for samples in self.groups]
        surfaces = all_surface_names(samples.truth.airframe.actuators.names for samples in self.groups)
        filled_keys = {variable.key for variable in surface_variables(surfaces)} | ADAPTATION_KEYS
        keys = dict.fromkeys(key for variables in group_rows for key in variables)
        common_keys = [key for key in keys if key in filled_keys or all(key in variables for variables in group_rows)]
        examples = {key: variables[key] for variables in group_rows for key in variables}
        padded = [
            {
                key: variables[key] if key in variables else _missing_values(len(indices), examples[key].dtype)
                for key in common_keys
            }
            for variables, indices in zip(group_rows, self.members, strict=True)
        ]
        return to_fleet_order(padded, self.members)


def _missing_values(count: int, dtype: Any) -> Array:
    return jnp.full(count, jnp.nan if jnp.issubdtype(dtype, jnp.inexact) else 0, dtype)


class AbstractRecorder(eqx.Module):
    """Interface of recorders, which select and store the data of a flight.

    Subclass this class directly, not a concrete recorder. A sample is an `AircraftSample` of a single aircraft, or a
    `FleetSample`. A row is the recorder's output for one sample.
    """

    stride: eqx.AbstractVar[int]  #: Number of samples between two rows.

    def init(self, aircraft: int) -> Any:
        """Return the recorder's state before the first sample (default: None); `aircraft` is the number of aircraft."""
        return None

    def update(self, recorder_state: Any, sample: Any, instant: Instant) -> Any:
        """Return the recorder's state after one more sample (default: unchanged)."""
        return recorder_state

    @abc.abstractmethod
    def output(self, sample: Any, instant: Instant) -> Any:
        """Return the row to store for one sample, a pytree of arrays; None if the recorder stores no rows."""


class History(AbstractRecorder):
    """Recorder of variables over time, of a fleet or of one aircraft."""

    stride: int = eqx.field(static=True, default=1)  #: Number of samples between two rows.
    #: Keys of `anser.variables.catalogue`; None: every recorded variable.
    keys: tuple[str, ...] | None = eqx.field(static=True, default=None)

    def output(self, sample: FleetSample | AircraftSample, instant: Instant) -> dict[str, Array]:
        """Return the selected variables by key, in SI units and radians; for a fleet with a leading axis of aircraft.

        Raises ValueError if a selected variable is not recorded.
        """
        variables = sample.rows(record) if isinstance(sample, FleetSample) else record(sample)
        if self.keys is None:
            return variables
        unknown = [key for key in self.keys if key not in variables]
        if unknown:
            raise ValueError(f"not recorded: {', '.join(unknown)}; what is: {', '.join(variables)}")
        return {key: variables[key] for key in self.keys}


class PackedRows(eqx.Module):
    """Rows of a recorder in one array. A compiled program then returns one array instead of one per variable."""

    values: Float[Array, "*batch rows numbers"]
    #: Key, shape of one row, and type of each variable, in the order of the numbers.
    layout: tuple[tuple[str, tuple[int, ...], str], ...] = eqx.field(static=True)

    def unpacked(self) -> dict[str, np.ndarray]:
        """Return the variables by key as NumPy arrays with leading axes (*batch, rows)."""
        values, variables, begin = np.asarray(self.values), {}, 0
        for key, shape, dtype in self.layout:
            end = begin + math.prod(shape)
            variables[key] = values[..., begin:end].reshape(*values.shape[:-1], *shape).astype(dtype, copy=False)
            begin = end
        return variables


def scan_steps(
    # one step: maps state and sample number to the next state, the sample, and the instant
    advance_step: Callable[[Any, Integer], tuple[Any, Any, Instant]],
    state: Any,  # state before the first step
    first_sample: Integer,  # number of the first sample, not batched
    count: int,  # number of steps, a multiple of the recorder's stride
    recorder: AbstractRecorder,
    recorder_state: Any,
    # number of steps to run, may be traced; rows of later steps have no meaning. None: `count`
    active_steps: Integer | None = None,
    # True: the rows, dictionaries of arrays, are returned as `PackedRows`. Requires `active_steps` and a stride of 1
    packed_rows: bool = False,
    # True for a state after which no more steps are run; rows of later steps have no meaning. Requires `packed_rows`
    is_final: Callable[[Any], Flag] | None = None,
) -> tuple[Any, Any, Any]:
    """Run `count` steps in one compiled loop; return the last state, the recorder's state, and the stacked rows.

    The rows belong to the samples `first_sample`, `first_sample + stride`, ... Raises ValueError if `count` is not a
    multiple of the stride, or if a requirement of `packed_rows` is not met.
    """
    stride = recorder.stride
    if stride < 1 or count % stride:
        raise ValueError(f"a row every {stride} samples does not fit a flight of {count} samples")
    if packed_rows and (active_steps is None or stride != 1):
        raise ValueError("packed_rows: expected active_steps and a recorder of a row at every step")
    if is_final is not None and not packed_rows:
        raise ValueError("is_final: expected packed_rows")  # of a batch, the condition would select every array

    def step(carry: tuple[Any, Any], number: Integer) -> tuple[tuple[Any, Any], Any]:
        state, recorder_state = carry
        next_state, sample, instant = advance_step(state, number)
        return (next_state, recorder.update(recorder_state, sample, instant)), recorder.output(sample, instant)

    numbers = first_sample + jnp.arange(count, dtype=first_sample.dtype)
    if active_steps is not None and stride == 1:
        # one trace for the shapes and for the loop
        traced, shapes = jax.make_jaxpr(step, return_shape=True)((state, recorder_state), first_sample)
        if not jax.tree.leaves(shapes[1]):
            step_numbers = first_sample, first_sample + active_steps
            states = jax.lax.fori_loop(*step_numbers, lambda n, carry: step(carry, n)[0], (state, recorder_state))
            return *states, shapes[1]
        empty, unpack_row = ravel_pytree(jax.tree.map(lambda row: jnp.zeros(row.shape, row.dtype), shapes[1]))

        def step_if_active(carry: tuple[Any, Any], number: Integer) -> tuple[tuple[Any, Any], Array]:
            def packed_step() -> tuple[tuple[Any, Any], Array]:
                results = jaxpr_as_fun(traced)(*jax.tree.leaves((carry, number)))
                next_carry, row = jax.tree.unflatten(jax.tree.structure(shapes), results)
                # One array per row: a conditional copies each of its results.
                return next_carry, ravel_pytree(row)[0]

            is_active = number < first_sample + active_steps
            if is_final is not None:
                is_active &= ~is_final(carry[0])
            return jax.lax.cond(is_active, packed_step, lambda: (carry, empty))

        states, rows = jax.lax.scan(step_if_active, (state, recorder_state), numbers)
        if packed_rows:
            layout = tuple((key, row.shape, row.dtype.name) for key, row in sorted(shapes[1].items()))
            return *states, PackedRows(rows, layout)
        return *states, jax.vmap(unpack_row)(rows)
    if stride == 1:
        states, records = jax.lax.scan(step, (state, recorder_state), numbers)
        return *states, records
    empty = zeros_like_result(lambda c, n: step(c, n)[1], (state, recorder_state), first_sample)

    def step_without_row(k: Integer, carry: tuple[Any, Any, Any]) -> tuple[Any, Any, Any]:
        state, recorder_state, number = carry[0], carry[1], carry[2][0]
        next_state, sample, instant = advance_step(state, number)
        first_row = jax.lax.cond(k == 0, lambda: recorder.output(sample, instant), lambda: carry[2][1])
        return next_state, recorder.update(recorder_state, sample, instant), (number + 1, first_row)

    def block(carry: tuple[Any, Any, Integer], _: None) -> tuple[tuple[Any, Any, Integer], Any]:
        state, recorder_state, number = carry
        steps_left = stride if active_steps is None else jnp.clip(first_sample + active_steps - number, 0, stride)
        state, recorder_state, (number, first_record) = jax.lax.fori_loop(
            0, steps_left, step_without_row, (state, recorder_state, (number, empty))
        )
        return (state, recorder_state, number), first_record

    (state, recorder_state, _), records = jax.lax.scan(
        block, (state, recorder_state, first_sample), length=count // stride
    )
    return state, recorder_state, records
