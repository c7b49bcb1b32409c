"""Parts of the closed loop from outside the package: objects, or names MODULE:NAME, and the check before a flight."""

import importlib
import os
import sys
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from anser.aircraft.airframe import AbstractAirframe, AircraftState, Controls
from anser.config.errors import Problem, ScenarioError, describe_value
from anser.environment.environment import Environment
from anser.environment.gusts import NoGusts
from anser.numerics.randomness import flight_randomness
from anser.parts.controllers import AbstractController, AbstractGuidance
from anser.parts.paths import PathCommand
from anser.parts.perception import AbstractEstimator, AbstractSensors, Belief, Instant, Truth
from anser.parts.planners import AbstractPlanner
from anser.scenario.schema import Scenario
from anser.shapes import Vector3
from anser.simulation.closed_loop import air_flow, true_situation
from anser.simulation.vehicle import Vehicle

_INTERFACES: dict[str, type] = {
    "controller": AbstractController,
    "guidance": AbstractGuidance,
    "sensors": AbstractSensors,
    "estimator": AbstractEstimator,
    "planner": AbstractPlanner,
}
_VEHICLE_PARTS = ("sensors", "estimator", "guidance", "controller")
_BY_NAME = 'text "my_package:MyClass", with a class without arguments or an object'


@dataclass(frozen=True)
class UserParts:
    """Parts of a user that replace those of a scenario: one for all aircraft, or a mapping by the aircraft's name.

    A part may be given as an object, or as text MODULE:NAME. The planner is one for the fleet.
    """

    controller: Any = None
    guidance: Any = None
    sensors: Any = None
    estimator: Any = None
    planner: Any = None

    def __bool__(self) -> bool:
        return any(getattr(self, field.name) is not None for field in fields(self))

    def resolved(self, scenario: Scenario) -> "UserParts":
        """Return the parts as objects.

        Raises
        ------
        ScenarioError
            A name cannot be imported, an object is no such part, an aircraft is unknown, or a planner meets events.
        """
        if not self:
            return self
        problems: list[Problem] = []
        aircraft_names = [aircraft.name for aircraft in scenario.aircraft]
        if self.planner is not None and scenario.planned_events:
            arrived = f"a user-defined planner with {len(scenario.planned_events)} events"
            expected = "no events, or no user-defined planner: only the package's planners plan on after events"
            problems.append(Problem("parts.planner", arrived, expected))

        def resolve(kind: str) -> Any:
            given = getattr(self, kind)
            if not isinstance(given, Mapping) or kind == "planner":
                return _resolve_part(given, kind, f"parts.{kind}", problems)
            unknown = [name for name in given if name not in aircraft_names]
            problems.extend(
                Problem(f"parts.{kind}", describe_value(name), f"the name of an aircraft: {', '.join(aircraft_names)}")
                for name in unknown
            )
            return {name: _resolve_part(part, kind, f"parts.{kind}.{name}", problems) for name, part in given.items()}

        parts = UserParts(*(resolve(field.name) for field in fields(self)))
        if problems:
            raise ScenarioError("user-defined parts", problems)
        return parts

    def part_of(self, kind: str, aircraft: str) -> Any:
        """Return an aircraft's user-defined part of a kind; None if the scenario's part stays."""
        part = getattr(self, kind)
        return part.get(aircraft) if isinstance(part, Mapping) else part

    def replace_in(self, vehicle: Vehicle, aircraft: str) -> Vehicle:
        """Return an aircraft of the closed loop with its user-defined parts."""
        changes = {kind: part for kind in _VEHICLE_PARTS if (part := self.part_of(kind, aircraft)) is not None}
        return replace(vehicle, **changes) if changes else vehicle

    def describe(self) -> dict[str, Any]:
        """Return the parts by name, for the provenance of results."""
        described = {}
        for field in fields(self):
            part = getattr(self, field.name)
            if isinstance(part, Mapping):
                described[field.name] = {name: _name_of(item) for name, item in part.items()}
            elif part is not None:
                described[field.name] = _name_of(part)
        return described


def attach_parts(scenario: Scenario, parts: UserParts) -> Scenario:
    """Return a scenario that is flown with user-defined parts, beside or in place of those that its file names.

    The parts stay with the scenario through `Scenario.replace`.
    """
    if not parts:
        return scenario
    attached = scenario.model_copy()
    attached._attached_parts = parts
    return attached


def user_parts(scenario: Scenario) -> UserParts:
    """Return the user-defined parts of a scenario: attached objects, or else the names in its file."""
    attached = scenario._attached_parts or UserParts()
    named = scenario.parts
    return UserParts(
        *(
            value if (value := getattr(attached, field.name)) is not None else getattr(named, field.name, None)
            for field in fields(UserParts)
        )
    )


def _name_of(part: Any) -> str:
    return part if isinstance(part, str) else f"{type(part).__module__}:{type(part).__qualname__}"


def _resolve_part(part: Any, kind: str, key_path: str, problems: list[Problem]) -> Any:
    interface = _INTERFACES[kind]
    if part is None:
        return None
    if isinstance(part, str):
        module, _, name = part.partition(":")
        try:
            part = getattr(_import(module), name)
            part = part() if isinstance(part, type) else part
        except (ImportError, AttributeError, TypeError, ValueError) as error:
            problems.append(Problem(key_path, f"{describe_value(part)} ({error})", _BY_NAME))
            return None
    if not isinstance(part, interface):
        arrived = f"the class {part.__name__}" if isinstance(part, type) else f"an object of {type(part).__name__}"
        problems.append(Problem(key_path, arrived, f"an object of a subclass of anser.parts.{interface.__name__}"))
    return part


def _import(module: str) -> Any:
    """Import a module that is installed, or lies in the working folder."""
    if sys.modules.get("dask", sys) is None:  # hidden by the command line; user code may need it
        del sys.modules["dask"]
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError:
        folder = os.getcwd()
        if folder in sys.path:
            raise
        sys.path.insert(0, folder)
        try:
            return importlib.import_module(module)
        finally:
            sys.path.remove(folder)


def check_user_parts(vehicle: Vehicle, environment: Environment, step_s: float, aircraft: str, own: UserParts) -> None:
    """Trace one sample with user-defined parts on shapes alone, and refuse wrong returns by part and method.

    Raises
    ------
    ScenarioError
        A method raises, or returns another structure, shape or type than its interface says.
    """
    kinds = [
        kind for kind in ("sensors", "estimator", "guidance", "controller") if own.part_of(kind, aircraft) is not None
    ]
    if not kinds:
        return
    instant = Instant(environment, jnp.asarray(0, dtype=jnp.int32), jnp.asarray(step_s), flight_randomness(0))

    def trace(kind: str, method: str, function: Any, *arguments: Any) -> Any:
        part = getattr(vehicle, kind) if kind in kinds else None
        return trace_method(kind, part, method, function, *arguments)

    def pair(kind: str, method: str, result: Any, size: int, expected: str) -> Any:
        if kind in kinds and (not isinstance(result, tuple) or len(result) != size):
            raise _part_error(vehicle, kind, method, _described(result), expected)
        return result

    def same(kind: str, method: str, before: Any, after: Any) -> None:
        if kind in kinds and _signature(before) != _signature(after):
            expected = f"the state in the structure of init: {_signature(before)}"
            raise _part_error(vehicle, kind, method, f"the state {_signature(after)}", expected)

    state = eqx.filter_eval_shape(_start_state, vehicle.airframe)
    attitude = jax.ShapeDtypeStruct((3,), float)
    calm = replace(vehicle, gusts=NoGusts())

    def situation(state: AircraftState) -> Truth:
        flow = air_flow(state, instant)
        return true_situation(calm, state, instant, calm.gusts.init(jnp.zeros(0), flow), flow)

    truth = eqx.filter_eval_shape(situation, state)
    sensors = trace("sensors", "init", lambda t: vehicle.sensors.init(t, instant), truth)
    read = trace("sensors", "read", lambda s, t: vehicle.sensors.read(s, t, instant), sensors, truth)
    reading, next_sensors = pair("sensors", "read", read, 2, "(reading, state)")
    same("sensors", "read", sensors, next_sensors)
    airframe = vehicle.airframe
    estimator = trace("estimator", "init", lambda r: vehicle.estimator.init(r, airframe, instant), reading)
    estimate = trace(
        "estimator", "estimate", lambda s, r: vehicle.estimator.estimate(s, r, airframe, instant), estimator, reading
    )
    belief, next_estimator = pair("estimator", "estimate", estimate, 2, "(belief, state)")
    same("estimator", "estimate", estimator, next_estimator)
    if "estimator" in kinds and not isinstance(belief, Belief):
        raise _part_error(vehicle, "estimator", "estimate", _described(belief), "an anser.parts.Belief first")
    guidance = trace("guidance", "init", lambda b: vehicle.guidance.init(b, instant), belief)
    del guidance  # its command needs a plan, which exists only in flight
    controller = trace("controller", "init", vehicle.controller.init, state, attitude)
    zero = jnp.zeros(())
    command = jax.tree.map(lambda _: jax.ShapeDtypeStruct((), float), PathCommand(zero, zero, zero, zero, zero, zero))
    control = trace(
        "controller",
        "control",
        lambda s, b, c: vehicle.controller.control(s, b, c, instant.step),
        controller,
        belief,
        command,
    )
    controls, _, next_controller = pair("controller", "control", control, 3, "(controls, signals, state)")
    same("controller", "control", controller, next_controller)
    count = len(airframe.actuators.names)
    if "controller" in kinds and (
        not isinstance(controls, Controls)
        or (np.shape(controls.surfaces), np.shape(controls.throttle)) != ((count,), ())
    ):
        expected = f"anser.aircraft.Controls with surfaces of shape ({count},) and a throttle of shape ()"
        raise _part_error(vehicle, "controller", "control", _described(controls), expected)


def trace_method(kind: str, part: Any, method: str, function: Any, *arguments: Any) -> Any:
    """Trace a method of a user-defined part on shapes alone; `part` None: one of the package's.

    Raises ScenarioError, with part and method, for an error of the user's code.
    """
    try:
        return eqx.filter_eval_shape(function, *arguments)
    except ScenarioError:
        raise
    except Exception as error:
        if part is None:
            raise
        message = (str(error).strip() or type(error).__name__).splitlines()[0]
        problem = Problem(
            f"{kind} {type(part).__qualname__}.{method}",
            f"{type(error).__name__}: {message}",
            "a method that JAX can trace",
        )
        raise ScenarioError("user-defined parts", [problem]) from error


def _start_state(airframe: AbstractAirframe) -> AircraftState:
    zero: Vector3 = jnp.zeros(3)
    surfaces = jnp.zeros(len(airframe.actuators.names))
    quaternion = jnp.array([1.0, 0.0, 0.0, 0.0])
    actuators, engine = airframe.actuators.steady_state(surfaces), airframe.engine.steady_state(jnp.zeros(()))
    return AircraftState(zero, zero.at[0].set(100.0), quaternion, zero, actuators, engine)


def _part_error(vehicle: Vehicle, kind: str, method: str, arrived: str, expected: str) -> ScenarioError:
    name = type(getattr(vehicle, kind)).__qualname__
    return ScenarioError("user-defined parts", [Problem(f"{kind} {name}.{method}", arrived, expected)])


def _described(value: Any) -> str:
    if isinstance(value, tuple):
        return f"a tuple of {len(value)}: {', '.join(type(item).__name__ for item in value)}"
    if isinstance(value, Controls):
        shapes = np.shape(value.surfaces), np.shape(value.throttle)
        return f"Controls with surfaces of shape {shapes[0]} and a throttle of shape {shapes[1]}"
    return f"{type(value).__name__} of shape {np.shape(value)}" if hasattr(value, "shape") else type(value).__name__


def _signature(state: Any) -> str:
    leaves, structure = jax.tree.flatten(state)
    shapes = [
        f"{np.dtype(leaf.dtype).name}{list(leaf.shape)}" if hasattr(leaf, "dtype") else repr(leaf) for leaf in leaves
    ]
    return f"{structure} with {', '.join(shapes) or 'no arrays'}".replace("PyTreeDef", "")
