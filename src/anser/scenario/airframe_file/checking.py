"""What an aircraft file says must come out, computed: forces and moments, steady flights."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np

from anser.aircraft import AirData, DaveMlAircraft, DerivativeAircraft, Wrench
from anser.dave_ml import Model
from anser.environment import StandardAtmosphere, standard_environment
from anser.numerics import as_array
from anser.scenario.airframe_file.build import build_airframe, with_derivatives
from anser.scenario.airframe_file.build_dave_ml import file_models
from anser.scenario.airframe_file.schema import AirframeFile
from anser.scenario.airframe_file.schema_check import ForceCheck, TrimCheck
from anser.scenario.airframe_file.schema_dave_ml import DaveMlFile
from anser.scenario.errors import refused
from anser.simulation import solve_trim, trim_target
from anser.units import DEG_RAD, RAD_DEG

_File = AirframeFile | DaveMlFile
_Airframe = DerivativeAircraft | DaveMlAircraft


@dataclass(frozen=True)
class Compared:
    """One number of a file's check data.

    Attributes
    ----------
    place
        Key in the file, such as ``check.forces[0].force_N[2]``; of a check shot the DAVE-ML file and the variable.
    name
        Of the check.
    unit
        Of the numbers.
    expected, obtained, tolerance
        What the file says, what comes out, and by how much they may differ.
    """

    place: str
    name: str
    unit: str
    expected: float
    obtained: float
    tolerance: float

    @property
    def agrees(self) -> bool:
        """Whether the difference is within the tolerance."""
        return abs(self.obtained - self.expected) <= self.tolerance


def compare(file: _File) -> tuple[Compared, ...]:
    """Compute all check data of a file."""
    airframe = build_airframe(file)
    shots = _of_shots(file) if isinstance(file, DaveMlFile) else []
    found = [one for k, check in enumerate(file.check.forces) for one in _of_forces(file, airframe, k, check)]
    return (*shots, *found, *(one for k, check in enumerate(file.check.trim) for one in _of_trim(airframe, k, check)))


def _of_shots(file: DaveMlFile) -> list[Compared]:
    """Check shots of the DAVE-ML files themselves."""
    models = file_models(file).items()
    return [one for part, model in models for one in compare_shots(model, model.definition.file, f"dave_ml.{part}.")]


def compare_shots(model: Model, source: str, prefix: str = "") -> list[Compared]:
    """Compute the check shots of a DAVE-ML file; the place of each value is the varID after a prefix.

    Raises
    ------
    ScenarioError
        If a shot gives a value for what is no input, or leaves an input out.
    """
    try:
        results = model.check()
    except ValueError as error:
        raise refused(source, str(error), "check shots that give each input of the file a value", "checkData") from None
    return [
        Compared(f"{prefix}{one.id}", one.shot, one.units, one.expected, one.computed, one.tolerance) for one in results
    ]


def _of_forces(file: _File, airframe: _Airframe, k: int, check: ForceCheck) -> list[Compared]:
    changed = airframe
    if isinstance(airframe, DerivativeAircraft) and isinstance(file, AirframeFile):
        changed = with_derivatives(airframe, file, check.instead)
    deflections = as_array([check.surfaces_rad.get(name, 0.0) for name in file.surfaces])
    aerodynamic, propulsive = _wrenches(
        changed, _air_data(check), as_array(check.rates_rad_s), deflections, as_array(100.0 * check.throttle)
    )
    gravity = np.zeros(3) if check.gravity_m_s2 is None else np.asarray(check.gravity_m_s2)
    weight = float(airframe.mass_properties.mass) * gravity
    rows: list[tuple[str, str, float | None, float]] = []
    total = aerodynamic + propulsive
    for key, unit, wanted, value in (
        ("force_N", "N", check.force_N, np.asarray(total.force_b) + weight),
        ("moment_Nm", "N m", check.moment_Nm, np.asarray(total.moment_b)),
    ):
        rows += [] if wanted is None else [(f"{key}[{j}]", unit, wanted[j], float(value[j])) for j in range(3)]
    rows.append(("thrust_N", "N", check.thrust_N, float(propulsive.force_b[0])))
    rows.append(("torque_Nm", "N m", check.torque_Nm, float(propulsive.moment_b[0])))
    return [
        Compared(f"check.forces[{k}].{key}", check.name, unit, expected, obtained, check.tolerance)
        for key, unit, expected, obtained in rows
        if expected is not None
    ]


@jax.jit
def _wrenches(
    airframe: _Airframe,
    data: AirData,
    rates_b: jax.Array,
    surfaces: jax.Array,
    power: jax.Array,
) -> tuple[Wrench, Wrench]:
    return airframe.aerodynamics(data, rates_b, surfaces), airframe.engine.propulsion(power, data)


def _air_data(check: ForceCheck) -> AirData:
    air = StandardAtmosphere().at(check.altitude_m)
    density = float(air.density) if check.density_kg_m3 is None else check.density_kg_m3
    V = check.airspeed_m_s
    mach, qbar = V / float(air.speed_of_sound), 0.5 * density * V * V
    return AirData(*map(as_array, (V, check.alpha_rad, check.beta_rad, density, qbar, mach, check.altitude_m)))


def _of_trim(airframe: _Airframe, k: int, check: TrimCheck) -> list[Compared]:
    target = trim_target(check.airspeed_m_s, check.altitude_m, check.path_angle_deg * DEG_RAD)
    point = jax.jit(solve_trim)(airframe, standard_environment(), target)
    rows = [("alpha_deg", "deg", check.alpha_deg, float(point.alpha) * RAD_DEG, check.tolerance_deg)]
    deflections = dict(zip(airframe.actuators.names, np.asarray(jnp.rad2deg(point.state.surfaces)), strict=True))
    rows += [
        (f"surfaces_deg.{name}", "deg", wanted, float(deflections[name]), check.tolerance_deg)
        for name, wanted in check.surfaces_deg.items()
    ]
    rows.append(("throttle", "", check.throttle, float(point.controls.throttle), check.tolerance_throttle))
    return [
        Compared(f"check.trim[{k}].{key}", check.name, unit, expected, obtained, tolerance)
        for key, unit, expected, obtained, tolerance in rows
        if expected is not None
    ]
