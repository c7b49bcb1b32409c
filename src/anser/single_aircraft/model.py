"""Model of one aircraft: description, trim, linear model, performance, and equations of motion."""

import dataclasses
import os
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from anser.aircraft.air_data import air_data
from anser.aircraft.airframe import AbstractAirframe, AircraftState, Controls
from anser.aircraft.motion import flat_earth_derivative
from anser.analysis.airframes import describe_airframe, valid_airspeed_range
from anser.analysis.trim_points import TrimResult, airframe_label, resolve_airframe, trim
from anser.compiling.options import compiled_quickly
from anser.environment.environment import Environment, standard_environment
from anser.numerics.arrays import as_array
from anser.shapes import Scalar
from anser.single_aircraft.air import read_air
from anser.single_aircraft.starts import (
    input_names,
    named_state,
    reference_inputs,
    require_trim_of,
    resolve_start,
    start_names,
)
from anser.spatial.rotations import euler_from_quaternion, quaternion_from_euler

if TYPE_CHECKING:
    from anser.analysis.linear_models import LinearizationResult
    from anser.single_aircraft.performance import PerformanceSheet

_BODY_STATES = (
    *("north_m", "east_m", "altitude_m", "velocity_u_m_s", "velocity_v_m_s", "velocity_w_m_s"),
    *("roll_rad", "pitch_rad", "yaw_rad", "roll_rate_rad_s", "pitch_rate_rad_s", "yaw_rate_rad_s"),
)
_UPWARDS = np.array([1.0, 1.0, -1.0])  # factors from north, east, down to north, east, altitude, and back


@dataclasses.dataclass(frozen=True, repr=False)
class AircraftModel:
    """An aircraft with its analyses; prints as a list of mass, size, surfaces, engine, range of data and inputs."""

    airframe: AbstractAirframe  #: Airframe, as the functions of the package take it.
    identity: Mapping[str, str | int | float]  #: Name, and variant and centre of gravity if any, for labels.

    def __repr__(self) -> str:
        effects = dict(zip(self.airframe.actuators.names, surface_effects(self.airframe), strict=True))
        quantities = describe_airframe(self.airframe)
        widest = max(len(name) for name, _, _ in quantities)
        lines = [
            f"  {name:<{widest}}  {value} {unit}{f'; positive: {effects[name]}' if name in effects else ''}".rstrip()
            for name, value, unit in quantities
        ]
        inputs = f"inputs: {', '.join(self.inputs[:-1])} in deg, throttle 0 to 1"
        return "\n".join([airframe_label(self.identity), *lines, inputs])

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the inputs: surfaces (deg), then `throttle` (0 to 1)."""
        return input_names(self.airframe)

    @property
    def start_names(self) -> tuple[str, ...]:
        """Names, with units, of the variables that define the start of a flight: see `anser.simulate`."""
        return start_names(self.airframe)

    def trim(
        self,
        speed_m_s: float | None = None,
        altitude_m: float | None = None,
        path_angle_deg: float = 0.0,
        turn_rate_deg_s: float = 0.0,
        *,
        speed_cas_m_s: float | None = None,
        speed_eas_m_s: float | None = None,
        mach: float | None = None,
        pitch_rate_deg_s: float = 0.0,
        atmosphere: Mapping[str, Any] | None = None,
    ) -> TrimResult:
        """Compute a steady flight in still air; exactly one airspeed and the altitude are required.

        Arguments and errors: see `anser.trim`. `atmosphere` is a table as in a scenario, such as
        `{"temperature_offset_k": 20}`; None: the standard atmosphere.
        """
        return trim(
            self.airframe,
            speed_m_s,
            altitude_m,
            path_angle_deg,
            turn_rate_deg_s,
            speed_cas_m_s=speed_cas_m_s,
            speed_eas_m_s=speed_eas_m_s,
            mach=mach,
            pitch_rate_deg_s=pitch_rate_deg_s,
            environment=read_air(atmosphere=atmosphere).environment(),
        )

    def linearize(
        self, trim: TrimResult | None = None, *, actuators: bool = False, **condition: float
    ) -> "LinearizationResult":
        """Return the linear model about a trim, or about a condition such as `speed_m_s=150, altitude_m=1000`.

        `condition` has the arguments of `anser.linearize`. If `actuators` is True, the inputs are commands, and the
        actuators' states are added. Raises ValueError unless exactly one of trim and condition is given, or if the trim
        is of another aircraft; ConditionError if the steady flight does not exist.
        """
        from anser.analysis.linear_models import linearize

        if (trim is None) == (not condition):
            arrived = "neither trim nor condition" if trim is None else "both trim and condition"
            raise ValueError(f"linearize: arrived {arrived}; expected one: a trim, or speed_m_s=..., altitude_m=...")
        if trim is not None and not isinstance(trim, TrimResult):
            raise ValueError(f"linearize: arrived {type(trim).__name__}; expected a trim of this aircraft")
        values: dict[str, Any] = dict(condition) if trim is None else dict(trim.condition)
        if trim is not None:
            require_trim_of(self.airframe, trim, "trim")
            values["environment"] = _still_air(trim)
        result = linearize(self.airframe, actuators=actuators, **values)
        return dataclasses.replace(result, condition={**result.condition, **self.identity})

    def performance(self, altitude_m: float = 0.0) -> "PerformanceSheet":
        """Compute stall, level flight, climb, glide and turns at an altitude (0 to 20,000 m), and the ceilings."""
        from anser.single_aircraft.performance import performance_sheet

        return performance_sheet(self.airframe, self.identity, altitude_m)

    def start(self, trim: TrimResult) -> dict[str, float]:
        """Return a trim as a start by named variables, for changes such as `{**f16.start(trim), "alpha_deg": 12.0}`."""
        environment = _still_air(trim)
        return named_state(self.airframe, environment, resolve_start(self.airframe, environment, trim))

    def state_names(self, *, lag: bool = True) -> tuple[str, ...]:
        """Return the names of the states of `derivatives`: rigid body; then actuators and engine, if `lag` is True."""
        actuators, engine = self.airframe.actuators.state_names, self.airframe.engine.state_names
        return (*_BODY_STATES, *((*(f"{name}_actuator" for name in actuators), *engine) if lag else ()))

    def derivatives(
        self,
        state: Float[Array, " state"],
        controls: Float[Array, " input"],
        environment: Environment | None = None,
        *,
        lag: bool = True,
    ) -> Float[Array, " state"]:
        """Compute the time derivative of the state vector; pure JAX, for `jax.jit`, `jax.vmap` and `jax.jacfwd`.

        Raises ValueError if a shape does not fit. Source: [SL] eq. 1.7-18, flat Earth, and eq. 1.4-4.

        Parameters
        ----------
        state
            State in the order of `state_names(lag=lag)`; SI units and radians, engine power in percent. The rates of
            the Euler angles are singular at a pitch of 90 deg.
        controls
            Surfaces (rad) in the order of `inputs`, then throttle (0 to 1).
        environment
            Air and Earth, the Earth flat; None: standard atmosphere and gravity, no wind.
        lag
            False: actuators and engine follow the controls at once, and have no states.

        Returns
        -------
        Rates of the states, in the same order, per second.
        """
        for name, array, names in (("state", state, self.state_names(lag=lag)), ("controls", controls, self.inputs)):
            if jnp.shape(array) != (len(names),):
                raise ValueError(
                    f"derivatives: arrived {name} of shape {jnp.shape(array)}; expected ({len(names)},): "
                    f"{', '.join(names)}; jax.vmap adds further axes"
                )
        airframe, x, u = self.airframe, jnp.asarray(state), jnp.asarray(controls)
        roll, pitch, yaw = x[6:9]
        surfaces, throttle = u[:-1], u[-1]
        if lag:
            pattern = airframe.actuators.steady_state(surfaces), airframe.engine.steady_state(jnp.zeros_like(throttle))
            leaves, structure = jax.tree.flatten(pattern)
            ends = np.cumsum([12, *(leaf.size for leaf in leaves)])
            parts = [x[a:b].reshape(leaf.shape) for a, b, leaf in zip(ends[:-1], ends[1:], leaves, strict=True)]
            actuators, engine = structure.unflatten(parts)
        else:
            actuators = airframe.actuators.steady_state(airframe.actuators.limit_command(surfaces))
            engine = airframe.engine.steady_state(airframe.engine.steady_power(throttle))
        quaternion = quaternion_from_euler(roll, pitch, yaw)
        motion = AircraftState(x[:3] * _UPWARDS, x[3:6], quaternion, x[9:12], actuators, engine)
        environment = environment or standard_environment()
        rate = flat_earth_derivative(airframe, environment, 0.0, motion, Controls(surfaces, throttle))
        P, Q, R = x[9:12]
        turning = Q * jnp.sin(roll) + R * jnp.cos(roll)
        euler_rates = jnp.stack(
            [P + jnp.tan(pitch) * turning, Q * jnp.cos(roll) - R * jnp.sin(roll), turning / jnp.cos(pitch)]
        )
        lags = [jnp.ravel(leaf) for leaf in jax.tree.leaves((rate.actuators, rate.engine))] if lag else []
        return jnp.concatenate([rate.position_n * _UPWARDS, rate.velocity_b, euler_rates, rate.rates_b, *lags])

    def state_vector(self, start: Any, *, lag: bool = True) -> np.ndarray:
        """Return a start (a trim, or variables by name) as the state vector of `derivatives` with the same `lag`."""
        point = resolve_start(self.airframe, _still_air(start), start)
        state = point.state
        euler = np.asarray(euler_from_quaternion(state.quaternion))
        body = [state.position_n * _UPWARDS, state.velocity_b, euler, state.rates_b]
        lags = jax.tree.leaves((state.actuators, state.engine)) if lag else []
        return np.concatenate([np.atleast_1d(np.asarray(part)) for part in (*body, *lags)])

    def input_vector(self, start: Any) -> np.ndarray:
        """Return the controls of a start as the `controls` of `derivatives`: surfaces (rad), then throttle (0 to 1)."""
        point = resolve_start(self.airframe, _still_air(start), start)
        inputs = np.array(list(reference_inputs(self.airframe, point.controls).values()))
        return np.append(np.radians(inputs[:-1]), inputs[-1])


def _still_air(start: Any) -> Environment:
    """Return still air over a flat Earth, in the atmosphere of `start` if `start` is a trim, or in the standard one."""
    environment = standard_environment()
    return (
        dataclasses.replace(environment, atmosphere=start.atmosphere) if isinstance(start, TrimResult) else environment
    )


def aircraft(
    what: str | os.PathLike[str] | AbstractAirframe | AircraftModel,
    variant: str = "textbook",
    *,
    x_cg_over_c: float | None = None,
) -> AircraftModel:
    """Load an aircraft by name, file or airframe, for trim, linear model, performance and flight.

    Raises ValueError if no airframe has this name, its mass properties are impossible, or a variant or centre of
    gravity is given for an aircraft other than the library's F-16; ScenarioError if the aircraft file is not valid.

    Parameters
    ----------
    what
        Name of an airframe of the library or of an entry point (`anser aircraft list` lists them), path of an aircraft
        file, an airframe of the user's own class, or an `AircraftModel`, which is returned.
    variant, x_cg_over_c
        Variant of the library's F-16, and its centre of gravity as a fraction of the mean chord (None: the variant's).
    """
    if isinstance(what, AircraftModel):
        if variant != "textbook" or x_cg_over_c is not None:
            argument = f"variant {variant!r}" if variant != "textbook" else f"x_cg_over_c = {x_cg_over_c}"
            raise ValueError(
                f"aircraft: arrived {argument} with an AircraftModel, which has its own; expected it with a name: 'f16'"
            )
        return what
    what = os.fspath(what) if isinstance(what, os.PathLike) else what
    return AircraftModel(*resolve_airframe(what, variant, x_cg_over_c))


_EFFECTS = (("rolls right", "rolls left"), ("nose up", "nose down"), ("nose right", "nose left"))


def surface_effects(airframe: AbstractAirframe) -> list[str]:
    """Return the effect of a positive deflection of each surface, such as "nose up", about the axis of greatest moment.

    The condition is 2 deg of alpha at sea level and the middle of the valid airspeeds.
    """
    speed = float(np.mean(valid_airspeed_range(airframe)))
    moments = np.asarray(_surface_moments(airframe, standard_environment(), as_array(speed)))
    axes = np.argmax(np.abs(moments), axis=0)
    signed = zip(axes, np.take_along_axis(moments, axes[None], axis=0)[0], strict=True)
    return ["no moment" if moment == 0.0 else _EFFECTS[axis][int(moment < 0.0)] for axis, moment in signed]


@compiled_quickly
def _surface_moments(airframe: AbstractAirframe, environment: Environment, speed: Scalar) -> Float[Array, "3 surface"]:
    """Return the derivatives of the moment (N m, body axes) by the deflections (rad), about neutral surfaces."""
    alpha = jnp.asarray(0.035)
    velocity_b = speed * jnp.stack([jnp.cos(alpha), 0.0 * alpha, jnp.sin(alpha)])
    data = air_data(velocity_b, 0.0, environment.atmosphere.at(0.0))
    neutral = airframe.actuators.scheduled_position(jnp.zeros(len(airframe.actuators.names)), data)
    return jax.jacfwd(lambda u: airframe.aerodynamics(data, jnp.zeros(3), u).moment_b)(neutral)
