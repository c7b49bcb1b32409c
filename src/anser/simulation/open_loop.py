"""Flight of one aircraft under prescribed controls or commands: open loop, or with a controller, without a mission."""

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
"""Keys of the recorded variables that only a controller defines."""

StateFeedback = Callable[[Any, Mapping[str, Any]], Mapping[str, Any]]
"""Function from the time, s, and the variables by dataset name, to controls by name: deg, and throttle 0..1."""


class PrescribedControls(AbstractController):
    """Controls from a table, a row per sample.

    Attributes
    ----------
    surfaces
        Commanded deflections, rad.
    throttle
        Throttle, 0..1.
    """

    surfaces: Float[Array, "sample surface"]
    throttle: Float[Array, " sample"]

    def init(self, state: AircraftState, attitude: Vector3) -> Integer:
        """Return the number of the first sample."""
        return jnp.asarray(0, dtype=jnp.int32)

    def control(
        self, controller_state: Integer, belief: Belief, command: Any, step: ScalarLike
    ) -> tuple[Controls, None, Integer]:
        """Return the controls in the table's row of the present sample, no signals, and the next sample's number."""
        number = controller_state
        return Controls(self.surfaces[number], self.throttle[number]), None, number + 1


class FeedbackControls(AbstractController):
    """Controls from a function of time and state; controls that the function leaves out keep their reference values.

    Attributes
    ----------
    reference
        Controls at the start.
    environment
        Environment from which the variables of the state are computed.
    law
        The function; it is traced, so that its arithmetic must be that of `jax.numpy`.
    """

    reference: Controls
    environment: Environment
    law: StateFeedback = eqx.field(static=True)

    def init(self, state: AircraftState, attitude: Vector3) -> Integer:
        """Return the number of the first sample."""
        return jnp.asarray(0, dtype=jnp.int32)

    def control(
        self, controller_state: Integer, belief: Belief, command: Any, step: ScalarLike
    ) -> tuple[Controls, None, Integer]:
        """Return the controls that `law` computes from time and state, no signals, and the next sample's number."""
        time = controller_state * step
        names = belief.airframe.actuators.names
        values = dataset_variables(belief.airframe, self.environment, time, belief.state, self.reference)
        requested = dict(self.law(time, values))
        unknown = sorted(set(requested) - {*names, "throttle"})
        if unknown:
            expected = ", ".join((*names, "throttle"))
            raise ValueError(f"controls: arrived {unknown[0]!r} from the function; expected inputs among {expected}")
        deflections = [
            DEG_RAD * jnp.asarray(requested[name], dtype=float) if name in requested else self.reference.surfaces[k]
            for k, name in enumerate(names)
        ]
        throttle = jnp.asarray(requested.get("throttle", self.reference.throttle), dtype=float)
        return Controls(jnp.stack(deflections), throttle), None, controller_state + 1


class PrescribedCommand(AbstractGuidance):
    """Guidance that commands airspeed, path angle and course from a table, a row per sample.

    Attributes
    ----------
    values
        Airspeed (m/s), path angle and course (rad); NaN in open loop.
    """

    values: Float[Array, "sample 3"]

    def command(
        self, guidance_state: None, belief: Belief, plan: AircraftPlan | None, instant: Instant
    ) -> tuple[PathCommand, Vector3, None]:
        """Return the command in the table's row of the present sample; the reference position is the aircraft's own."""
        zero = jnp.zeros(())
        V, gamma, chi = self.values[instant.number]
        return PathCommand(V, gamma, chi, zero, zero, zero), belief.state.position_n, None


def start_point(
    airframe: AbstractAirframe, environment: Environment, state: AircraftState, controls: Controls
) -> TrimPoint:
    """Return any state and controls in the form of a trim point, from which a flight starts; no trim is solved."""
    condition = air_data_and_forces(airframe, environment, 0.0, state)
    data = condition.air_data
    return TrimPoint(
        state=state,
        controls=controls,
        mu=bank_about_velocity(condition.R_bn, data.alpha, data.beta),
        alpha=data.alpha,
        beta=data.beta,
        power=jnp.asarray(state.power),
        converged=jnp.asarray(False),
        residual=jnp.asarray(jnp.inf),
        excess=jnp.asarray(0.0),
    )


def dataset_variables(
    airframe: AbstractAirframe, environment: Environment, time: ScalarLike, state: MotionState, controls: Controls
) -> dict[str, Array]:
    """Compute the variables of a state in still or steadily moving air by dataset name, in degrees, in open loop."""
    local_state = to_local_state(environment, state)
    condition = air_data_and_forces(airframe, environment, time, local_state)
    specific_force_b = condition.wrench.force_b / airframe.mass_properties.mass
    return _named_variables(Belief(airframe, local_state, condition, specific_force_b, sight=None, goal=None), controls)


def believed_variables(belief: Belief) -> dict[str, Array]:
    """Return an aircraft's own estimate of its motion by dataset name, such as `alpha_deg`, for user-defined parts.

    The throttle is not part of an estimate, and is NaN.
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
        approach=None,
        status=jnp.asarray(FLYING, dtype=jnp.int32),
    )
    described = {variable.key: variable for variable in catalogue(belief.airframe.actuators.names)}
    return {
        described[key].name: value * described[key].factor
        for key, value in record(sample).items()
        if key not in CONTROLLER_KEYS and key in described and key != "status"
    }
