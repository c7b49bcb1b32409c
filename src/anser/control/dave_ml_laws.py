"""Control laws from DAVE-ML files: a controller that evaluates a law, and guidance that commands its inputs by name."""

from collections.abc import Mapping, Sequence

import equinox as eqx
import jax.numpy as jnp

from anser.aircraft.airframe import Controls
from anser.dave_ml.evaluator import Evaluator
from anser.dave_ml.model import Model
from anser.dave_ml.standard_units import ANGLE, refuse_other_units
from anser.environment.atmosphere import StandardAtmosphere
from anser.environment.earth import RotatingEarth
from anser.numerics.arrays import as_array
from anser.parts.controllers import AbstractController, AbstractGuidance
from anser.parts.perception import Belief, Instant, velocity_over_ground_n
from anser.parts.planners import AircraftPlan
from anser.shapes import Scalar, ScalarLike, Vector3
from anser.spatial.rotations import euler_from_quaternion, rotate
from anser.variables import STANDARD_SURFACES


def named_signals(belief: Belief) -> dict[str, Scalar]:
    """Return an aircraft's estimated flight condition by the standard names of ANSI/AIAA S-119, SI units and radians.

    Body rates are relative to the rotating Earth, in body axes, as in the NESC check-cases. The equivalent airspeed
    refers to the density of the standard atmosphere at sea level. Source: ANSI/AIAA S-119-2011, annex A.
    """
    state, condition = belief.state, belief.condition
    data = condition.air_data
    roll, pitch, yaw = euler_from_quaternion(state.quaternion)
    rates_b = state.rates_b + rotate(condition.R_bn, condition.earth.transport_rate_n)
    density_ratio = data.density / StandardAtmosphere().at(jnp.zeros_like(data.density)).density
    return {
        "altitudeMsl": data.altitude,
        "trueAirspeed": data.V,
        "equivalentAirspeed": data.V * jnp.sqrt(density_ratio),
        "mach": data.mach,
        "dynamicPressure": data.qbar,
        "angleOfAttack": data.alpha,
        "angleOfSideslip": data.beta,
        "eulerAngle_Roll": roll,
        "eulerAngle_Pitch": pitch,
        "eulerAngle_Yaw": yaw,
        "bodyAngularRate_Roll": rates_b[0],
        "bodyAngularRate_Pitch": rates_b[1],
        "bodyAngularRate_Yaw": rates_b[2],
    }


LATERAL_DEVIATION, BASE_COURSE = "lateralDeviationError", "trueBaseCourseCommand"
_ROUNDING_S = 1e-9


def _to_arrays(values: Mapping[str, ScalarLike]) -> dict[str, Scalar]:
    return {name: as_array(value) for name, value in values.items()}


class NamedCommands(AbstractGuidance):
    """Guidance that commands constant values, named like the inputs of a control law, and changes them once.

    Raises ValueError if `change` has a name that is not in `initial_commands`.
    """

    #: Commands from the start, SI units and radians.
    initial_commands: Mapping[str, Scalar] = eqx.field(converter=_to_arrays)
    #: Values to add to the initial commands at `change_time`, by name, SI units and radians.
    change: Mapping[str, Scalar] = eqx.field(default_factory=dict, converter=_to_arrays)
    #: Time of the change, s.
    change_time: Scalar = eqx.field(default_factory=lambda: as_array(0.0), converter=as_array)
    #: 1: the distance from a line (m, right positive) is added to the command `lateralDeviationError`. The line has the
    #: course `trueBaseCourseCommand`, and passes through the position at `change_time`. 0: nothing is added. If one of
    #: the two commands is missing, the value has no effect.
    follows_line: Scalar = eqx.field(default_factory=lambda: as_array(0.0), converter=as_array)
    #: Whether latitude and longitude (rad) are commanded too, as `geLatitude` and `geLongitude`.
    with_position: bool = eqx.field(static=True, default=False)

    def __check_init__(self) -> None:
        unknown = [repr(name) for name in self.change if name not in self.initial_commands]
        if unknown:
            raise ValueError(
                f"change: arrived {', '.join(unknown)}; expected names of initial_commands: "
                f"{', '.join(self.initial_commands)}"
            )

    def init(self, belief: Belief, instant: Instant) -> Scalar:
        """Return the state of the guidance, the distance (m) from the line of `follows_line`: 0."""
        return jnp.zeros(())

    def command(
        self, guidance_state: Scalar, belief: Belief, plan: AircraftPlan | None, instant: Instant
    ) -> tuple[dict[str, Scalar], Vector3, Scalar]:
        """Return the commands by name, the aircraft's own position (NED, m), and the new distance from the line (m).

        Raises TypeError if `with_position` is true and the Earth is not a `RotatingEarth`.
        """
        changed = instant.time >= self.change_time - _ROUNDING_S
        commands = dict(self.initial_commands)
        for name, value in self.change.items():
            commands[name] = commands[name] + jnp.where(changed, value, 0.0)
        if LATERAL_DEVIATION in commands and BASE_COURSE in commands:
            velocity_n = velocity_over_ground_n(belief.condition, belief.state)
            course = commands[BASE_COURSE]
            cross_track_speed = velocity_n[1] * jnp.cos(course) - velocity_n[0] * jnp.sin(course)
            commands[LATERAL_DEVIATION] = commands[LATERAL_DEVIATION] + guidance_state
            guidance_state = guidance_state + instant.step * self.follows_line * jnp.where(
                changed, cross_track_speed, 0.0
            )
        if self.with_position:
            earth = instant.environment.earth
            if not isinstance(earth, RotatingEarth):
                raise TypeError(f"latitude and longitude need a RotatingEarth, not a {type(earth).__name__}")
            lat, lon, _ = earth.geodetic(belief.state.position_n)
            commands |= {"geLatitude": lat, "geLongitude": jnp.arctan2(jnp.sin(lon), jnp.cos(lon))}
        return commands, belief.state.position_n, guidance_state


class DaveMlLaw(AbstractController):
    """Controller that evaluates a control law from a DAVE-ML file once per sampling period.

    An input of the law takes the value of the same name in the command, in the flight condition (`named_signals`) or in
    the file, in this order of precedence. The law has no filters or integrals: the guidance must pass filtered or
    integrated values as commands.
    """

    law: Evaluator
    #: Names of the outputs with the deflections of the airframe's surfaces, in the airframe's order.
    surfaces: tuple[str, ...] = eqx.field(static=True)
    power: str = eqx.field(static=True)  #: Name of the output with the commanded engine power, as a fraction 0..1.

    def control(
        self,
        controller_state: None,
        belief: Belief,
        command: Mapping[str, Scalar],  # inputs of the law by name, SI units and radians
        step: ScalarLike,  # sampling period, s
    ) -> tuple[Controls, None, None]:
        """Evaluate the law; return surfaces (rad) and throttle (0..1), None for the signals, and None for the state.

        Raises ValueError if the law has no input with the name of a command, a required input has no value, or a unit
        is unknown.
        """
        names = {self.law.structure.by_id[identifier].name for identifier in self.law.structure.inputs}
        signals = {name: value for name, value in named_signals(belief).items() if name in names}
        inputs = {**signals, **command}
        outputs = self.law.evaluate_si(inputs, (*self.surfaces, self.power))
        surfaces = jnp.stack([outputs[name] for name in self.surfaces])
        return Controls(surfaces, belief.airframe.engine.throttle_for_power(100.0 * outputs[self.power])), None, None


def dave_ml_law(model: Model, surfaces: Sequence[str] = STANDARD_SURFACES, power: str = "powerLeverAngle") -> DaveMlLaw:
    """Build a controller from a control law; `model` is the content of a DAVE-ML file.

    Parameters
    ----------
    surfaces
        Names of the airframe's surfaces; the law's output for `elevator` is `elevatorDeflection`.
    power
        Name of the law's output with the commanded engine power, as a fraction 0..1.

    Raises ValueError if the file lacks an output, an output for a surface is not an angle, or the law has states.
    """
    outputs = tuple(f"{name}Deflection" for name in surfaces)
    for name in (*outputs, power):
        model.evaluator.structure.find(name)
    for name in outputs:
        refuse_other_units(model.definition.variables[model.evaluator.structure.find(name)], ANGLE)
    states = model.variables_with_role("isState")
    if states:
        raise ValueError(f"the law has states ({', '.join(states)}); expected one that has none")
    return DaveMlLaw(model.evaluator, outputs, power)
