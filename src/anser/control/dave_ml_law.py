"""Control laws of DAVE-ML files.

The flight condition by standard names (ANSI/AIAA S-119), commands by name, and the controller that evaluates the
law.
"""

from collections.abc import Mapping, Sequence

import equinox as eqx
import jax.numpy as jnp

from anser.aircraft.airframe import AircraftState, Controls
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
    """Flight condition by standard names, SI units and radians.

    Body rates are those relative to the rotating Earth, in body axes: the inertial ones less the rotation of the Earth.
    The participants of the NESC check-cases feed them to the control laws. The equivalent airspeed refers to the
    density of the standard atmosphere at sea level. Source: ANSI/AIAA S-119-2011, annex A.
    """
    state, now = belief.state, belief.condition
    data = now.air_data
    roll, pitch, yaw = euler_from_quaternion(state.quaternion)
    rates_b = state.rates_b + rotate(now.R_bn, now.earth.transport_rate_n)
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


def _arrays(values: Mapping[str, ScalarLike]) -> dict[str, Scalar]:
    return {name: as_array(value) for name, value in values.items()}


class NamedCommands(AbstractGuidance):
    """Commands by the names of a law's inputs, some of which change once.

    Attributes
    ----------
    held
        Commands from the start, SI units and radians.
    change
        What is added to some of them, from `change_time` on.
    change_time
        s.
    follows_line
        1: from `change_time` on, the lateral deviation is that from the ground track along `trueBaseCourseCommand`
        through the position at that time, the integral of V sin(course - base course) over ground; 0: it is what is
        commanded alone.
    place
        Whether latitude and longitude are given too.
    """

    initial_commands: Mapping[str, Scalar] = eqx.field(converter=_arrays)
    change: Mapping[str, Scalar] = eqx.field(default_factory=dict, converter=_arrays)
    change_time: Scalar = eqx.field(default_factory=lambda: as_array(0.0), converter=as_array)
    follows_line: Scalar = eqx.field(default_factory=lambda: as_array(0.0), converter=as_array)
    with_position: bool = eqx.field(static=True, default=False)

    def init(self, belief: Belief, instant: Instant) -> Scalar:
        """Lateral deviation at the start, m."""
        return jnp.zeros(())

    def command(
        self, guidance_state: Scalar, belief: Belief, plan: AircraftPlan | None, instant: Instant
    ) -> tuple[dict[str, Scalar], Vector3, Scalar]:
        """The commands now; no place is asked for."""
        changed = instant.time >= self.change_time - _ROUNDING_S
        given = dict(self.initial_commands)
        for name, value in self.change.items():
            given[name] = given[name] + jnp.where(changed, value, 0.0)
        if LATERAL_DEVIATION in given and BASE_COURSE in given:
            velocity_n = velocity_over_ground_n(belief.condition, belief.state)
            course = given[BASE_COURSE]
            across = velocity_n[1] * jnp.cos(course) - velocity_n[0] * jnp.sin(course)
            given[LATERAL_DEVIATION] = given[LATERAL_DEVIATION] + guidance_state
            guidance_state = guidance_state + instant.step * self.follows_line * jnp.where(changed, across, 0.0)
        if self.with_position:
            earth = instant.environment.earth
            if not isinstance(earth, RotatingEarth):
                raise TypeError(f"latitude and longitude need a RotatingEarth, not a {type(earth).__name__}")
            lat, lon, _ = earth.geodetic(belief.state.position_n)
            given |= {"geLatitude": lat, "geLongitude": jnp.arctan2(jnp.sin(lon), jnp.cos(lon))}
        return given, belief.state.position_n, guidance_state


class DaveMlLaw(AbstractController):
    """A control law of a file, evaluated once per sampling period in the units of the file.

    Its inputs, by name, are taken from the command and, what that does not give, from the flight condition
    (`named_signals`); what neither gives keeps the file's own value. Filters and integrals have no place in such a file
    and are the guidance's, which gives their values as commands.

    Attributes
    ----------
    law
        The evaluator of the file.
    surfaces
        Names of the outputs for the airframe's surfaces, in their order.
    power
        Name of the output that is the power wanted of the engine.
    """

    law: Evaluator
    surfaces: tuple[str, ...] = eqx.field(static=True)
    power: str = eqx.field(static=True)

    def init(self, state: AircraftState, attitude: Vector3) -> None:
        """Nothing is kept."""

    def control(
        self, controller_state: None, belief: Belief, command: Mapping[str, Scalar], step: ScalarLike
    ) -> tuple[Controls, None, None]:
        """Surfaces and throttle.

        Parameters
        ----------
        controller_state
            None.
        belief
            What the aircraft believes.
        command
            Inputs of the law by name, SI units and radians.
        step
            Sampling period, s.

        Raises
        ------
        ValueError
            The law has no input of a commanded name, or misses one.
        """
        given = {**_known_to(self.law, named_signals(belief)), **command}
        found = self.law.evaluate_si(given, (*self.surfaces, self.power))
        surfaces = jnp.stack([found[name] for name in self.surfaces])
        return Controls(surfaces, belief.airframe.engine.throttle_for_power(100.0 * found[self.power])), None, None


def _known_to(law: Evaluator, signals: Mapping[str, Scalar]) -> dict[str, Scalar]:
    """Those of some signals that are inputs of a law."""
    names = {law.structure.by_id[identifier].name for identifier in law.structure.inputs}
    return {name: value for name, value in signals.items() if name in names}


def dave_ml_law(model: Model, surfaces: Sequence[str] = STANDARD_SURFACES, power: str = "powerLeverAngle") -> DaveMlLaw:
    """The controller of a file.

    Parameters
    ----------
    model
        The file, as read.
    surfaces
        The airframe's surfaces; the output for `elevator` is `elevatorDeflection`.
    power
        Output that is the power wanted of the engine.

    Raises
    ------
    ValueError
        The file does not give one of them, or a surface in units of no angle; or it has states of its own, for which it
        does not say how they go on.
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
