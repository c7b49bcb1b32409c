"""The s119 F-16 against the static check shots of its published data files."""

import functools
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from anser.aircraft import F16, air_data, along_body_x
from anser.environment import StandardAtmosphere
from anser.scenario import load_airframe
from anser.shapes import Vector3
from anser.units import DEG_RAD, FOOT_M, FT_LBF_N_M, LBF_N
from anser.verification.check import Check, Comparison
from anser.verification.published import published

_MOMENT_REFERENCE = 0.35
"""The shots refer to the moment reference of the data, x/c: no lever from there to the centre of gravity."""
_UNITS = {"nd": "", "ft": "ft", "ft2": "ft^2", "lbf": "lbf", "ftlbf": "ft lbf"}
_AERO_INPUTS = {
    "trueAirspeed": FOOT_M,
    "angleOfAttack": DEG_RAD,
    "angleOfSideslip": DEG_RAD,
    "bodyAngularRate_Roll": 1.0,
    "bodyAngularRate_Pitch": 1.0,
    "bodyAngularRate_Yaw": 1.0,
    "elevatorDeflection": DEG_RAD,
    "aileronDeflection": DEG_RAD,
    "rudderDeflection": DEG_RAD,
}
"""Inputs of the aerodynamic shots, in order, and their factors to SI."""
_TURNS = ("Roll", "Pitch", "Yaw")
_ENGINE_INPUTS = {"powerLeverAngle": 1.0, "altitudeMSL": FOOT_M, "mach": 1.0}


@jax.jit
def _coefficients(airframe: F16, shots: Float[Array, "shot 9"]) -> dict[str, Float[Array, " shot"]]:
    """Coefficients of each shot; they depend on the air nowhere, so sea level serves."""

    def one(speed: Array, alpha: Array, beta: Array, rates_b: Vector3, surfaces: Vector3) -> dict[str, Array]:
        direction = [jnp.cos(alpha) * jnp.cos(beta), jnp.sin(beta), jnp.sin(alpha) * jnp.cos(beta)]
        data = air_data(speed * jnp.stack(direction), 0.0, StandardAtmosphere().at(0.0))
        found = airframe.coefficients(data, rates_b, surfaces)
        forces, moments = (found.CX, found.CY, found.CZ), (found.Cl, found.Cm, found.Cn)
        return {
            **{f"aeroBodyForceCoefficient_{axis}": C for axis, C in zip("XYZ", forces, strict=True)},
            **{f"aeroBodyMomentCoefficient_{axis}": C for axis, C in zip(_TURNS, moments, strict=True)},
            "referenceWingChord": airframe.mean_chord / FOOT_M,
            "referenceWingSpan": airframe.span / FOOT_M,
            "referenceWingArea": airframe.wing_area / FOOT_M**2,
        }

    return jax.vmap(one)(shots[:, 0], shots[:, 1], shots[:, 2], shots[:, 3:6], shots[:, 6:9])


@jax.jit
def _thrust(airframe: F16, shots: Float[Array, "shot 3"]) -> dict[str, Float[Array, " shot"]]:
    """Thrust and its moment in each shot, lbf and ft lbf."""

    def one(shot: Vector3) -> dict[str, Array]:
        wrench = along_body_x(airframe.engine.thrust(shot[0], shot[1], shot[2]))
        force, moment = wrench.force_b / LBF_N, wrench.moment_b / FT_LBF_N_M
        return {
            **{f"thrustBodyForce_{axis}": force[k] for k, axis in enumerate("XYZ")},
            **{f"thrustBodyMoment_{axis}": moment[k] for k, axis in enumerate(_TURNS)},
        }

    return jax.vmap(one)(shots)


def _measure(
    file: str, factors: dict[str, float], compute: Callable[[F16, Array], dict[str, Float[Array, " shot"]]]
) -> tuple[Comparison, ...]:
    """Compare all shots of a file; `factors` are those of its inputs, in order, to SI and rad."""
    shots = published(file)["shots"]
    inputs = jnp.array([[shot["inputs"][name][0] * factor for name, factor in factors.items()] for shot in shots])
    airframe = load_airframe("f16", "s119", x_cg_over_c=_MOMENT_REFERENCE)
    values = {name: np.asarray(column) for name, column in compute(airframe, inputs).items()}
    return tuple(
        Comparison(name, shot["name"], _UNITS[unit], expected, float(values[name][k]), tolerance)
        for k, shot in enumerate(shots)
        for name, (expected, unit, tolerance) in shot["outputs"].items()
    )


F16_AERO_SHOTS = Check(
    key="f16-aero-shots",
    title="F-16: static check shots of the aerodynamic model",
    source="[S119] F16_aero",
    why="the shots' own",
    explanation=(
        "Coefficients of the s119 variant at 300 ft/s and 5 deg angle of attack, with one input moved at a time. They "
        "refer to the moment reference of the data, 0.35 c, so the centre of gravity is put there."
    ),
    measure=functools.partial(_measure, "daveml_aero_checks", _AERO_INPUTS, _coefficients),
)

F16_ENGINE_SHOTS = Check(
    key="f16-engine-shots",
    title="F-16: static check shots of the engine model",
    source="[S119] F16_prop",
    why="the shots' own",
    explanation=(
        "Thrust of the s119 variant from power lever, altitude and Mach number; it has no moment and no side force."
    ),
    measure=functools.partial(_measure, "daveml_engine_checks", _ENGINE_INPUTS, _thrust),
)
