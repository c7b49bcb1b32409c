"""Flight of one aircraft without a mission, under prescribed controls or with prescribed commands to a controller."""

import traceback
from collections.abc import Callable, Mapping
from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from anser.aircraft.airframe import AbstractAirframe, AircraftState, Controls
from anser.aircraft.motion import MotionState, air_data_and_forces, to_local_state
from anser.environment.environment import Environment
from anser.parts.controllers import AbstractController, AbstractGuidance
from anser.parts.paths import PathCommand
from anser.parts.perception import Belief, Instant, Truth
from anser.parts.planners import AircraftPlan
from anser.shapes import Integer, ScalarLike, Vector3
from anser.simulation.closed_loop import FLYING
from anser.simulation.recorders import CONTROLLER_COMMANDS, CONTROLLER_FLAGS, AircraftSample, record
from anser.spatial.wind_axes import bank_about_velocity
from anser.steady.trim import TrimPoint
from anser.units import DEG_RAD
from anser.variables import catalogue

CONTROLLER_KEYS = frozenset(
    {"airspeed_command", "path_angle_command", "course_command", *CONTROLLER_COMMANDS, *CONTROLLER_FLAGS}
)
"""Keys of the variables that only a controller defines: commands and limit flags."""

StateFeedback = Callable[[Any, Mapping[str, Any]], Mapping[str, Any]]
"""Function (time in s, variables by dataset name) that returns controls by name: surfaces in deg, throttle 0..1."""


class _SampledControls(AbstractController):
    """Base of open-loop controllers; the state is the number of the present sample."""

    def init(self, state: AircraftState, attitude: Vector3) -> Integer:
        """Return the number of the first sample, 0."""
        return jnp.asarray(0, dtype=jnp.int32)


class PrescribedControls(_SampledControls):
    """Open-loop controller that plays controls from a table with one entry per sample."""

    surfaces: Float[Array, "sample surface"]  #: Commanded deflections, rad.
    throttle: Float[Array, " sample"]  #: Throttle, 0..1.

    def control(
        self, controller_state: Integer, belief: Belief, command: Any, step: ScalarLike
    ) -> tuple[Controls, None, Integer]:
        """Return the controls of the present sample, None, and the number of the next sample."""
        controls = Controls(self.surfaces[controller_state], self.throttle[controller_state])
        return controls, None, controller_state + 1


class FeedbackControls(_SampledControls):
    """Open-loop controller that computes the controls by `law`, a function of time and state."""

    reference: Controls  #: Surfaces (rad) and throttle (0..1) for controls that `law` does not return.
    #: Function (time in s, variables by dataset name) that returns controls by name; must be traceable by JAX.
    law: StateFeedback = eqx.field(static=True)

    def control(
        self, controller_state: Integer, belief: Belief, command: Any, step: ScalarLike
    ) -> tuple[Controls, None, Integer]:
        """Return the controls that `law` computes, None, and the number of the next sample.

        Raises ValueError if `law` raises, names a control that the aircraft lacks, or returns an array for a control.
        """
        time, names = controller_state * step, belief.airframe.actuators.names
        values = _named_variables(belief, self.reference)
        try:
            requested = {name: jnp.asarray(value, dtype=float) for name, value in dict(self.law(time, values)).items()}
        except Exception as error:
            reason = traceback.format_exception_only(error)[0].splitlines()[0]
            raise ValueError(
                f"controls: the function raised {reason:.160}; expected law(time_s, state) that returns "
                "controls by name, written in jax.numpy (jnp.where in place of if)"
            ) from error
        unknown = sorted(requested.keys() - {*names, "throttle"})
        if unknown:
            expected = ", ".join((*names, "throttle"))
            raise ValueError(f"controls: arrived {unknown[0]!r} from the function; expected inputs among {expected}")
        if any(value.ndim for value in requested.values()):
            raise ValueError("controls: the function returned arrays; expected one number for each input")
        deflections = [
            DEG_RAD * requested[name] if name in requested else self.reference.surfaces[k]
            for k, name in enumerate(names)
        ]
        throttle = requested.get("throttle", self.reference.throttle)
        return Controls(jnp.stack(deflections), throttle), None, controller_state + 1


class PrescribedCommand(AbstractGuidance):
    """Guidance that commands airspeed, path angle and course from a table with one entry per sample; rates are 0."""

    values: Float[Array, "sample 3"]  #: Airspeed (m/s), path angle and course (rad); NaN in open loop.

    def command(
        self, guidance_state: None, belief: Belief, plan: AircraftPlan | None, instant: Instant
    ) -> tuple[PathCommand, Vector3, None]:
        """Return the command of the present sample, the aircraft's own position (NED, m), and None."""
        command = PathCommand(*self.values[instant.number], *[jnp.zeros(())] * 3)
        return command, belief.state.position_n, None


def start_point(
    airframe: AbstractAirframe, environment: Environment, state: AircraftState, controls: Controls
) -> TrimPoint:
    """Return a trim point with the given state and controls, marked as not converged, as the start of a flight."""
    condition = air_data_and_forces(airframe, environment, 0.0, state)
    data = condition.air_data
    mu, power = bank_about_velocity(condition.R_bn, data.alpha, data.beta), jnp.asarray(state.power)
    unsolved = {"converged": jnp.asarray(False), "residual": jnp.asarray(jnp.inf), "excess": jnp.asarray(0.0)}
    return TrimPoint(state, controls, mu, data.alpha, data.beta, power, **unsolved)


def dataset_variables(
    airframe: AbstractAirframe, environment: Environment, time: ScalarLike, state: MotionState, controls: Controls
) -> dict[str, Array]:
    """Return the variables of a state in air without gusts, by dataset name such as `alpha_deg`, in dataset units.

    Variables that only a controller defines (`CONTROLLER_KEYS`) are left out.
    """
    local_state = to_local_state(environment, state)
    condition = air_data_and_forces(airframe, environment, time, local_state)
    specific_force_b = condition.wrench.force_b / airframe.mass_properties.mass
    return _named_variables(Belief(airframe, local_state, condition, specific_force_b, sight=None, goal=None), controls)


def believed_variables(belief: Belief) -> dict[str, Array]:
    """Return the variables of an aircraft's own estimate, by dataset name such as `alpha_deg`, in dataset units.

    The throttle is NaN, because an estimate has no throttle.
    """
    return _named_variables(belief, Controls(belief.state.surfaces, jnp.asarray(jnp.nan)))


def _named_variables(belief: Belief, controls: Controls) -> dict[str, Array]:
    nan = jnp.asarray(jnp.nan)
    sample = AircraftSample(
        truth=Truth(belief.airframe, belief.state, belief.condition, None),
        belief=belief,
        controls=controls,
        signals=None,
        command=PathCommand(nan, nan, nan, nan, nan, nan),
        reference_n=None,
        plan=None,
        approach=None,
        status=jnp.asarray(FLYING, dtype=jnp.int32),
    )
    described = {variable.key: variable for variable in catalogue(belief.airframe.actuators.names)}
    return {
        described[key].name: value * described[key].factor
        for key, value in record(sample).items()
        if key not in CONTROLLER_KEYS and key in described and key != "status"
    }
