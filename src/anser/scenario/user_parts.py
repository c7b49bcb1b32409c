"""User-defined parts of the closed loop, given as objects or names MODULE:NAME, and their check before a flight."""

import importlib
import os
import sys
import traceback
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from anser.aircraft.airframe import AbstractAirframe, AircraftState, Controls
from anser.config.errors import Problem, ScenarioError, describe_value, problem_error
from anser.environment.environment import Environment
from anser.environment.gusts import NoGusts
from anser.numerics.randomness import flight_randomness
from anser.parts.controllers import AbstractController, AbstractGuidance
from anser.parts.paths import PathCommand
from anser.parts.perception import AbstractEstimator, AbstractSensors, Belief, Instant, Reading, Truth
from anser.parts.planners import AbstractPlanner
from anser.scenario.schema import Scenario
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
_SOURCE = "user-defined parts"
_BY_NAME = 'text "my_package:MyClass", with a class without arguments or an object'


@dataclass(frozen=True)
class UserParts:
    """User-defined parts that replace the parts of a scenario; None: the scenario's part stays.

    A part is an object, or text MODULE:NAME. The planner is for the whole fleet; every other part is for all aircraft,
    or a mapping from the names of aircraft to their parts.
    """

    controller: Any = None
    guidance: Any = None
    sensors: Any = None
    estimator: Any = None
    planner: Any = None

    def __bool__(self) -> bool:
        return any(part is not None for part in vars(self).values())

    def resolved(self, scenario: Scenario) -> "UserParts":
        """Return the parts as objects: a name is imported, and an imported class is called without arguments.

        Raises ScenarioError if a name cannot be imported, an object does not subclass the interface of its part, an
        aircraft is unknown, or a planner is given for a scenario with events to which planners respond.
        """
        if not self:
            return self
        problems: list[Problem] = []
        names = [aircraft.name for aircraft in scenario.aircraft]
        if self.planner is not None and scenario.planned_events:
            arrived = f"a user-defined planner with {len(scenario.planned_events)} events"
            expected = "no events, or no user-defined planner: only the package's planners plan on after events"
            problems.append(Problem("parts.planner", arrived, expected))
        resolved: dict[str, Any] = {}
        for kind, given in vars(self).items():
            path = f"parts.{kind}"
            if isinstance(given, Mapping) and kind != "planner":
                expected = f"the name of an aircraft: {', '.join(names)}"
                problems += [Problem(path, describe_value(name), expected) for name in given if name not in names]
                resolved[kind] = {n: _resolve_part(part, kind, f"{path}.{n}", problems) for n, part in given.items()}
            else:
                resolved[kind] = _resolve_part(given, kind, path, problems)
        if problems:
            raise ScenarioError(_SOURCE, problems)
        return UserParts(**resolved)

    def part_of(self, kind: str, aircraft: str) -> Any:
        """Return the user-defined part of a kind ("controller" ...) of an aircraft; None if it has no such part."""
        part = getattr(self, kind)
        return part.get(aircraft) if isinstance(part, Mapping) else part

    def replace_in(self, vehicle: Vehicle, aircraft: str) -> Vehicle:
        """Return an aircraft of the closed loop with its user-defined parts in place of the scenario's."""
        changes = {kind: part for kind in _VEHICLE_PARTS if (part := self.part_of(kind, aircraft)) is not None}
        return replace(vehicle, **changes) if changes else vehicle

    def describe(self) -> dict[str, Any]:
        """Return the names MODULE:NAME of the parts by kind (and aircraft), for the provenance of results."""
        return {
            kind: {name: _name_of(item) for name, item in part.items()} if isinstance(part, Mapping) else _name_of(part)
            for kind, part in vars(self).items()
            if part is not None
        }


def resolved_parts(**parts: Any) -> UserParts:
    """Return the user-defined parts of a flight of one aircraft, by kind, as objects; None: no such part.

    Raises ScenarioError if a name cannot be imported, or an object does not subclass the interface of its part.
    """
    problems: list[Problem] = []
    resolved = {kind: _resolve_part(part, kind, kind, problems) for kind, part in parts.items()}
    if problems:
        raise ScenarioError(_SOURCE, problems)
    return UserParts(**resolved)


def attach_parts(scenario: Scenario, parts: UserParts) -> Scenario:
    """Return a scenario with user-defined parts, which replace the parts in the file; `Scenario.replace` keeps them."""
    return _with_attached(scenario, parts) if parts else scenario


def _with_attached(scenario: Scenario, parts: UserParts | None) -> Scenario:
    attached = scenario.model_copy()
    attached._attached_parts = parts
    return attached


def differs_in_values(scenario_a: Scenario, scenario_b: Scenario) -> bool:
    """Whether two scenarios differ in more than their attached user-defined parts."""
    return _with_attached(scenario_a, None) != _with_attached(scenario_b, None)


def replaced_parts(planned: Scenario, flown: Scenario) -> list[str]:
    """Return the kinds of user-defined parts of a planned scenario that are replaced or missing in the flown scenario.

    "planner" is also returned if only the flown scenario has a user-defined planner.
    """
    before, after = planned._attached_parts or UserParts(), flown._attached_parts or UserParts()
    return [
        kind
        for kind, part in vars(before).items()
        if (part is not None or kind == "planner") and part != getattr(after, kind)
    ]


def user_parts(scenario: Scenario) -> UserParts:
    """Return the user-defined parts of a scenario; an attached object takes precedence over a name in the file."""
    attached, named = scenario._attached_parts or UserParts(), scenario.parts
    parts = {kind: getattr(named, kind, None) if part is None else part for kind, part in vars(attached).items()}
    return UserParts(**parts)


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
    """Import a module that is installed or lies in the working folder; raises ModuleNotFoundError for others."""
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
    """Check an aircraft's user-defined parts: trace one sample of the loop with shapes instead of values.

    `vehicle` has all parts of the aircraft, `own` only the user-defined parts. Raises ScenarioError, with part and
    method, if a method raises an error, or if structure, shape or type of its result is not as its interface requires.
    """
    kinds = [kind for kind in _VEHICLE_PARTS if own.part_of(kind, aircraft) is not None]
    if not kinds:
        return

    def trace(kind: str, method: str, *arguments: Any, returns: str = "") -> Any:
        """Return the shapes of a method's result; `returns` describes the required tuple, which ends with the state."""
        part, is_own = getattr(vehicle, kind), kind in kinds
        result = trace_method(kind, part, method, *arguments, is_own=is_own)
        if is_own and returns:
            if not isinstance(result, tuple) or len(result) != returns.count(",") + 1:
                raise part_error(kind, part, method, _described(result), returns)
            before, after = _signature(arguments[0]), _signature(result[-1])
            if before != after:
                expected = f"the state in the structure of init: {before}"
                raise part_error(kind, part, method, f"the state {after}", expected)
        return result

    def start_state(airframe: AbstractAirframe) -> AircraftState:
        zero, surfaces = jnp.zeros(3), jnp.zeros(len(airframe.actuators.names))
        actuators, engine = airframe.actuators.steady_state(surfaces), airframe.engine.steady_state(jnp.zeros(()))
        return AircraftState(zero, zero, jnp.zeros(4), zero, actuators, engine)

    def situation(state: AircraftState) -> Truth:
        flow = air_flow(state, instant)
        return true_situation(calm, state, instant, calm.gusts.init(jnp.zeros(0), flow), flow)

    instant = Instant(environment, jnp.asarray(0, dtype=jnp.int32), jnp.asarray(step_s), flight_randomness(0))
    airframe, calm = vehicle.airframe, replace(vehicle, gusts=NoGusts())
    start = eqx.filter_eval_shape(start_state, airframe)
    truth = eqx.filter_eval_shape(situation, start)
    state = trace("sensors", "init", truth, instant)
    reading, _ = trace("sensors", "read", state, truth, instant, returns="(reading, state)")
    if "sensors" in kinds:
        problem = _reading_problem(reading, truth)
        if problem:
            raise part_error("sensors", vehicle.sensors, "read", *problem)
    state = trace("estimator", "init", reading, airframe, instant)
    belief, _ = trace("estimator", "estimate", state, reading, airframe, instant, returns="(belief, state)")
    if "estimator" in kinds and not isinstance(belief, Belief):
        expected = "an anser.parts.Belief first"
        raise part_error("estimator", vehicle.estimator, "estimate", _described(belief), expected)
    state = trace("guidance", "init", belief, instant)
    scalar: Any = jax.ShapeDtypeStruct((), float)
    command = PathCommand(scalar, scalar, scalar, scalar, scalar, scalar)
    if vehicle.mission is None:  # with a mission, the guidance needs a plan, which exists only in flight
        returns = "(command, reference_n, state)"
        command, *_ = trace("guidance", "command", state, belief, None, instant, returns=returns)
    state = trace("controller", "init", start, jax.ShapeDtypeStruct((3,), float))
    returns = "(controls, signals, state)"
    controls, signals, _ = trace("controller", "control", state, belief, command, instant.step, returns=returns)
    arrived, count = _described(controls), len(airframe.actuators.names)
    expected = f"Controls with surfaces of shape ({count},) and a throttle of shape ()"
    if "controller" in kinds and arrived != expected:
        raise part_error("controller", vehicle.controller, "control", arrived, f"anser.aircraft.{expected}")
    if "controller" in kinds and signals is not None and not hasattr(signals, "variables"):
        arrived, expected = f"the signals {_described(signals)}", "None, or an object with a method variables()"
        raise part_error("controller", vehicle.controller, "control", arrived, expected)


def _reading_problem(reading: Any, truth: Truth) -> tuple[str, str] | None:
    """Return what arrived and what is expected in place of a reading of own sensors; None for a reading that fits."""
    if not isinstance(reading, Reading):
        return _described(reading), "an anser.parts.Reading first"
    for name, exact in (("state", truth.state), ("condition", truth.condition)):
        if _signature(getattr(reading, name)) != _signature(exact):
            return f"a reading with a {name} of other arrays", f"the arrays of truth.{name}"
    for name in ("specific_force_b", "velocity_air_b"):
        vector = getattr(reading, name)
        if np.shape(vector) != (3,) and not (vector is None and name == "velocity_air_b"):
            return f"a reading with {name} = {_described(vector)}", "an array of shape (3,)"
    return None


def trace_method(kind: str, part: Any, method: str, *arguments: Any, is_own: bool = True) -> Any:
    """Trace a method of a part with shapes instead of values; return the shapes of its result.

    An error in the code of a user-defined part (`is_own`) becomes a ScenarioError with part and method.
    """
    try:
        return eqx.filter_eval_shape(getattr(part, method), *arguments)
    except Exception as error:
        if not is_own or isinstance(error, ScenarioError):
            raise
        arrived = traceback.format_exception_only(error)[0].splitlines()[0]
        raise part_error(kind, part, method, arrived, "a method that JAX can trace") from error


def part_error(kind: str, part: Any, method: str, arrived: str, expected: str) -> ScenarioError:
    """Build the error for a part (of a `kind`) whose method returned or raised `arrived` in place of `expected`."""
    return problem_error(_SOURCE, arrived, expected, f"{kind} {type(part).__qualname__}.{method}")


def _described(value: Any) -> str:
    if isinstance(value, tuple):
        return f"a tuple of {len(value)}: {', '.join(type(item).__name__ for item in value)}"
    if isinstance(value, Controls):
        surfaces, throttle = np.shape(value.surfaces), np.shape(value.throttle)
        return f"Controls with surfaces of shape {surfaces} and a throttle of shape {throttle}"
    return f"an array of shape {np.shape(value)}" if hasattr(value, "shape") else type(value).__name__


def _signature(state: Any) -> str:
    leaves, structure = jax.tree.flatten(state)
    shapes = [
        f"{np.dtype(leaf.dtype).name}{list(leaf.shape)}" if hasattr(leaf, "dtype") else f"{leaf!r}, not an array"
        for leaf in leaves
    ]
    return f"{structure} with {', '.join(shapes) or 'no arrays'}".replace("PyTreeDef", "")
