"""Verification of the built-in s119 F-16 against its DAVE-ML files: coefficients, thrust, and NESC case 11."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from anser.aircraft.actuators import AbstractActuators
from anser.aircraft.air_data import AirData, Wrench, air_data
from anser.aircraft.airframe import AbstractAirframe, MassProperties
from anser.aircraft.engines import AbstractEngine, thrust_along_body_x
from anser.aircraft.f16 import F16
from anser.aircraft_files.library import load_f16
from anser.compiling.options import compiled_quickly
from anser.dave_ml.evaluator import Evaluator
from anser.environment.atmosphere import StandardAtmosphere
from anser.numerics.arrays import as_array
from anser.shapes import Flag, Scalar, ScalarLike, Vector, Vector3
from anser.units import DEG_RAD, LBF_N, RAD_DEG
from anser.verification.checks import Check, Comparison, load_published
from anser.verification.nasa_f16 import EngineOverride, published_model
from anser.verification.nesc_cases import TRIMMED_FLIGHTS, column_unit
from anser.verification.nesc_flight import LOG_PERIOD_S, fly_trimmed, trimmed_logs

STATES = 10_000
_TOLERANCE = 1e-12
_MOMENT_REFERENCE, _CG_PCT_MAC = 0.35, 25.0
_FLIGHT_SHARE = 1e-6
"""Accepted difference between the two flights of NESC case 11, as a fraction of the case's tolerances."""
_COEFFICIENTS = {
    "CX": "aeroBodyForceCoefficient_X",
    "CY": "aeroBodyForceCoefficient_Y",
    "CZ": "aeroBodyForceCoefficient_Z",
    "Cl": "aeroBodyMomentCoefficient_Roll",
    "Cm": "aeroBodyMomentCoefficient_Pitch",
    "Cn": "aeroBodyMomentCoefficient_Yaw",
}
_REFERENCES = ("referenceWingArea", "referenceWingSpan", "referenceWingChord")
_AXES = ("Roll", "Pitch", "Yaw")
_SURFACES = ("elevatorDeflection", "aileronDeflection", "rudderDeflection")


def file_coefficients(
    aerodynamics: Evaluator, V: ScalarLike, alpha: ScalarLike, beta: ScalarLike, rates_b: Vector3, surfaces: Vector
) -> dict[str, Scalar]:
    """Return the coefficients about the file's moment reference, and the reference lengths, by name; SI units."""
    inputs = {"trueAirspeed": V, "angleOfAttack": alpha, "angleOfSideslip": beta}
    inputs |= {f"bodyAngularRate_{axis}": rates_b[k] for k, axis in enumerate(_AXES)}
    inputs |= {name: surfaces[k] for k, name in enumerate(_SURFACES)}
    return aerodynamics.evaluate_si(inputs, (*_COEFFICIENTS.values(), *_REFERENCES))


class FileEngine(EngineOverride):
    """Engine with the thrust of F16_prop.dml; lag and inverse functions are those of `base`.

    Attributes
    ----------
    thrust
        Evaluator of the file.
    """

    thrust: Evaluator

    def propulsion(self, power: ScalarLike, air_data: AirData) -> Wrench:
        """Return the thrust along body x; the file's thrust has no lateral components."""
        inputs = {"powerLeverAngle": 0.01 * power, "altitudeMSL": air_data.altitude, "mach": air_data.mach}
        return thrust_along_body_x(self.thrust.evaluate_si(inputs, ("thrustBodyForce_X",))["thrustBodyForce_X"])


class FileF16(AbstractAirframe):
    """F-16 with the aerodynamics, thrust, mass and inertia of the files.

    Attributes
    ----------
    coefficients
        Evaluator of F16_aero.dml.
    cg_forward
        Centre of gravity forward of the moment reference, m.
    """

    mass_properties: MassProperties
    actuators: AbstractActuators
    engine: AbstractEngine
    alpha_range: tuple[Scalar, Scalar]
    beta_range: tuple[Scalar, Scalar]
    coefficients: Evaluator
    cg_forward: Scalar

    def aerodynamics(self, air_data: AirData, rates_b: Vector3, surfaces: Vector) -> Wrench:
        """Compute the force at the moment reference (N) and the moment about the centre of gravity (N m), body axes."""
        coefficients = file_coefficients(
            self.coefficients, jnp.maximum(air_data.V, 1.0), air_data.alpha, air_data.beta, rates_b, surfaces
        )
        area, span, chord = (coefficients[name] for name in _REFERENCES)
        force, moment = list(_COEFFICIENTS.values())[:3], list(_COEFFICIENTS.values())[3:]
        scale = air_data.qbar * area
        force_b = scale * jnp.stack([coefficients[name] for name in force])
        about_reference_b = scale * jnp.stack([span, chord, span]) * jnp.stack([coefficients[name] for name in moment])
        lever = self.cg_forward * jnp.stack([jnp.zeros(()), force_b[2], -force_b[1]])
        return Wrench(force_b=force_b, moment_b=about_reference_b + lever)

    def outside_tables(self, air_data: AirData) -> Flag:
        """Whether the flow angles are outside the tables, or the flight condition outside the engine's ranges."""
        alpha, beta = air_data.alpha, air_data.beta
        outside = (alpha < self.alpha_range[0]) | (alpha > self.alpha_range[1])
        outside = outside | (beta < self.beta_range[0]) | (beta > self.beta_range[1])
        return outside | self.engine.outside_tables(air_data)


def f16_of_files() -> FileF16:
    """Build the F-16 of its four DAVE-ML files, with actuators and ranges of the built-in s119 variant."""
    built_in = load_f16("s119")
    inertia = published_model("F16_inertia").evaluate_si({"vrsPositionOfCM": _CG_PCT_MAC / 100.0})
    J = {axes: float(inertia[name]) for name, axes in _INERTIA.items()}
    inertia_b = np.array([[J["xx"], -J["xy"], -J["zx"]], [-J["xy"], J["yy"], -J["yz"]], [-J["zx"], -J["yz"], J["zz"]]])
    return FileF16(
        mass_properties=MassProperties(
            mass=as_array(float(inertia["XMASS"])),
            inertia_b=as_array(inertia_b),
            inertia_inverse_b=as_array(np.linalg.inv(inertia_b)),
            spin_momentum_b=as_array(np.zeros(3)),
        ),
        actuators=built_in.actuators,
        engine=FileEngine(built_in.engine, published_model("F16_prop").evaluator),
        alpha_range=built_in.alpha_range,
        beta_range=built_in.beta_range,
        coefficients=published_model("F16_aero").evaluator,
        cg_forward=as_array(float(inertia["DXCG"])),
    )


_INERTIA = {"XIXX": "xx", "XIYY": "yy", "XIZZ": "zz", "XIZX": "zx", "XIXY": "xy", "XIYZ": "yz"}


def random_states(count: int = STATES, seed: int = 24) -> Float[np.ndarray, "state 13"]:
    """Return random states within and beyond the tables, shape (count, 13).

    Columns: V, alpha, beta, body rates, surfaces, power, altitude, Mach number.
    """
    random = np.random.default_rng(seed)
    lower = [
        5.0,
        -15 * DEG_RAD,
        -35 * DEG_RAD,
        *[-2.0] * 3,
        *np.array([-25.0, -21.5, -30.0]) * DEG_RAD,
        0.0,
        -500.0,
        0.0,
    ]
    upper = [400.0, 50 * DEG_RAD, 35 * DEG_RAD, *[2.0] * 3, *np.array([25.0, 21.5, 30.0]) * DEG_RAD, 100.0, 16e3, 1.2]
    return random.uniform(lower, upper, (count, len(lower)))


@compiled_quickly
def compare_models(airframe: F16, aerodynamics: Evaluator, thrust: Evaluator, states: Array) -> tuple[dict, dict]:
    """Compute the coefficients and the thrust (lbf) of each state twice: by the files and by the built-in model.

    The moments refer to the moment reference.
    """
    file_engine = FileEngine(airframe.engine, thrust)

    def compare_state(state: Array) -> tuple[dict[str, Scalar], dict[str, Scalar]]:
        V, alpha, beta, rates_b, surfaces = state[0], state[1], state[2], state[3:6], state[6:9]
        standard_values = file_coefficients(aerodynamics, V, alpha, beta, rates_b, surfaces)
        direction = jnp.stack([jnp.cos(alpha) * jnp.cos(beta), jnp.sin(beta), jnp.sin(alpha) * jnp.cos(beta)])
        data = air_data(V * direction, state[10], StandardAtmosphere().at(0.0))
        data = eqx.tree_at(lambda d: (d.V, d.alpha, d.beta, d.mach), data, (V, alpha, beta, state[11]))
        built_in_coefficients = airframe.coefficients(data, rates_b, surfaces)
        file_values = {name: standard_values[standard] for name, standard in _COEFFICIENTS.items()}
        file_values["thrust"] = file_engine.propulsion(state[9], data).force_b[0] / LBF_N
        built_in_values = {name: getattr(built_in_coefficients, name) for name in _COEFFICIENTS}
        built_in_values["thrust"] = airframe.engine.propulsion(state[9], data).force_b[0] / LBF_N
        return file_values, built_in_values

    return jax.vmap(compare_state)(states)


def _coefficients() -> tuple[Comparison, ...]:
    """Compare coefficients and thrust, each at the state of the greatest difference.

    CZ is also compared with pi rounded as in the file.
    """
    airframe = load_f16("s119", x_cg_over_c=_MOMENT_REFERENCE)
    as_filed, thrust = (published_model(name).evaluator for name in ("F16_aero", "F16_prop"))
    exact_pi = eqx.tree_at(lambda e: e.constants["rtd"], as_filed, as_array(RAD_DEG))
    states = random_states()
    from_file, built_in = compare_models(airframe, exact_pi, thrust, as_array(states))
    comparisons = []
    for name, values in from_file.items():
        expected = np.asarray(values)
        if name == "thrust":
            tolerance = _TOLERANCE * float(np.max(np.abs(expected)))
            comparisons.append(_worst(name, expected, built_in[name], tolerance, "lbf", "1e-12 of the greatest"))
        else:
            comparisons.append(_worst(name, expected, built_in[name], _TOLERANCE))
    rounded_pi, _ = compare_models(airframe, as_filed, thrust, as_array(states))
    # CZ0 (1 - beta^2), beta in degrees over the file's degrees per radian; |CZ0| <= 2.248.
    relative_error = 2.0 * abs(float(as_filed.constants["rtd"]) / RAD_DEG - 1.0)
    tolerance = 2.248 * relative_error * float(np.max(states[:, 2] ** 2)) + _TOLERANCE
    tolerance_reason = "the file's pi of nine digits"
    comparisons.append(
        _worst(
            "CZ, as filed", np.asarray(rounded_pi["CZ"]), built_in["CZ"], tolerance, tolerance_reason=tolerance_reason
        )
    )
    return tuple(comparisons)


def _worst(
    name: str, expected: np.ndarray, computed: Array, tolerance: float, unit: str = "", tolerance_reason: str = ""
) -> Comparison:
    obtained = np.asarray(computed)
    worst = int(np.argmax(np.abs(obtained - expected)))
    point = f"worst of {STATES:,} random states"
    return Comparison(
        name, point, unit, float(expected[worst]), float(obtained[worst]), tolerance, tolerance_reason=tolerance_reason
    )


def _flight() -> tuple[Comparison, ...]:
    """Compare NESC case 11 flown with the files with the flight of the built-in model.

    Each column is compared at its greatest difference.
    """
    case = TRIMMED_FLIGHTS[0]
    built_in = trimmed_logs()[case.number]
    from_files = fly_trimmed([case], f16_of_files())[case.number]
    log_indices = [round(time_s / LOG_PERIOD_S) for time_s in case.times_s]
    comparisons = []
    for name, column in load_published("nesc_checkpoints")["cases"][f"{case.number}"]["columns"].items():
        if "tolerance" not in column:
            continue
        expected, obtained = from_files[name][log_indices], built_in[name][log_indices]
        k = int(np.argmax(np.abs(obtained - expected)))
        point, tolerance = f"NESC case 11, t {case.times_s[k]:g} s", _FLIGHT_SHARE * column["tolerance"]
        expected_and_obtained = float(expected[k]), float(obtained[k])
        comparisons.append(
            Comparison(
                name,
                point,
                column_unit(name),
                *expected_and_obtained,
                tolerance,
                tolerance_reason="1e-6 of NESC case 11's",
            )
        )
    return tuple(comparisons)


F16_FILES = Check(
    key="f16-files",
    title="F-16: the built-in s119 variant against its DAVE-ML files",
    source="[S119] F16_aero, F16_prop, F16_inertia",
    tolerance_reason="1e-12 of a coefficient",
    explanation=(
        "Expected is what the published files give, read and evaluated by anser's DAVE-ML reader; obtained is the "
        "built-in model. Coefficients about the moment reference at 10,000 random states, some beyond the ends of the "
        "tables. The file's degrees per radian come of a pi of nine digits, which moves CZ by 1.9e-9 at 35 deg of "
        "sideslip; all else is compared with the exact constant in its place. Then NESC case 11 is trimmed and flown "
        "with the files as they are and with the built-in model."
    ),
    measure=lambda: (*_coefficients(), *_flight()),
)
