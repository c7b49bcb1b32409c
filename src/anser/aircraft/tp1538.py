"""The F-16 with the complete data of NASA TP-1538: scheduled leading-edge flap, alpha from -20 to 90 deg."""

from collections.abc import Mapping, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from anser.aircraft.actuators import AbstractActuators
from anser.aircraft.air_data import AirData
from anser.aircraft.f16 import (
    F16_COEFFICIENTS,
    AbstractF16,
    F16Coefficients,
    F16Engine,
    f16_mass_properties,
    range_from_deg,
)
from anser.numerics.arrays import as_array
from anser.numerics.tables import Tables, make_axes, make_tables
from anser.shapes import Scalar, ScalarLike, Vector, Vector3
from anser.units import DEG_RAD, FOOT_M, RAD_DEG, SLUG_KG

_STATIC_PRESSURE_SHARE = 0.7  # qbar / ps = (gamma / 2) M^2 with gamma = 1.4
_FLAP = 3


class ScheduledFlap(eqx.Module):
    """State of `ScheduledFlapActuators`."""

    position: Vector  # deflections of elevator, aileron, rudder and leading-edge flap, rad
    alpha_lag: Scalar  # low-passed angle of attack of the flap's schedule, rad


class ScheduledFlapActuators(AbstractActuators):
    """First-order actuators of elevator, aileron, rudder, and a leading-edge flap that follows a schedule.

    The schedule of TP-1538 is gain (2 s + pole)/(s + pole) alpha - compression qbar/ps + offset, within the stops. The
    pressure ratio is qbar/ps = 0.7 M^2. The lead-lag is 2 alpha - x with the state x' = pole (alpha - x). Above
    `alpha_down` the flap is commanded fully down, as in all wind-tunnel tests at such angles.
    """

    # lag (s), position limits (rad) and rate limits (rad/s), shape (4,); see `AbstractActuators`
    time_constant: Vector
    lower: Vector
    upper: Vector
    rate_limit: Vector
    gain: Scalar  # flap deflection per angle of attack
    pole: Scalar  # pole of the schedule's filter, 1/s
    compression: Scalar  # coefficient of qbar/ps, rad
    offset: Scalar  # constant term of the schedule, rad
    alpha_down: Scalar  # angle of attack, rad, above which the flap is fully down
    names: tuple[str, ...] = eqx.field(static=True, default=("elevator", "aileron", "rudder", "leading_edge_flap"))

    @property
    def is_commanded(self) -> tuple[bool, ...]:
        """True for each surface except the flap, which follows the schedule."""
        return (True, True, True, False)

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of the elements of the state: positions of the four surfaces, then the filtered angle of attack."""
        return (*self.names, "alpha_lag")

    def steady_state(self, position: Vector) -> ScheduledFlap:
        """Return the state at rest at `position` (rad); `alpha_lag` is the alpha for this flap position at Mach 0."""
        position = jnp.asarray(position)
        return ScheduledFlap(position, (position[_FLAP] - self.offset) / self.gain)

    def steady_state_in_flow(self, position: Vector, air_data: AirData) -> ScheduledFlap:
        """Return the state at rest in a steady flow: `position` (rad), with the leading-edge flap on schedule."""
        return ScheduledFlap(self.scheduled_position(position, air_data), jnp.asarray(air_data.alpha))

    def rate(self, state: ScheduledFlap, command: Vector, air_data: AirData) -> ScheduledFlap:
        """Return the rates of `position` (limited) and `alpha_lag`, rad/s; the command of the flap is ignored."""
        flap = self._flap(2.0 * air_data.alpha - state.alpha_lag, air_data)
        target = self.limit_command(jnp.concatenate([command[:_FLAP], flap[None]]))
        unlimited_rate = (target - state.position) / self.time_constant
        return ScheduledFlap(
            jnp.clip(unlimited_rate, -self.rate_limit, self.rate_limit), self.pole * (air_data.alpha - state.alpha_lag)
        )

    def scheduled_position(self, position: Vector, air_data: AirData) -> Vector:
        """Return the positions (rad) with the flap at the steady value of its schedule."""
        flap = jnp.clip(self._flap(air_data.alpha, air_data), self.lower[_FLAP], self.upper[_FLAP])
        return jnp.concatenate([position[:_FLAP], flap[None]])

    def _flap(self, led_alpha: ScalarLike, air_data: AirData) -> Scalar:
        """Return the scheduled flap deflection (rad), not limited to the stops; `led_alpha` is the lead-lag output."""
        pressure_ratio = _STATIC_PRESSURE_SHARE * air_data.mach**2
        scheduled = self.gain * led_alpha - self.compression * pressure_ratio + self.offset
        return jnp.where(air_data.alpha > self.alpha_down, self.upper[_FLAP], scheduled)


_DAMPING = ("CXq", "CYr", "CYp", "CZq", "Clr", "Clp", "Cmq", "Cnr", "Cnp")
_LATERAL = ("CY", "Cl", "Cn")
TP1538_FUNCTIONS = (
    (*_DAMPING, *_DAMPING, "Cm0", "Cl0", "Cn0"),
    ("CZ0", "CYb", *("CX0", "CZ0", "Cm0", "CYb", "Cl0", "Cn0"), "CYdr", "Cldr", "Cndr", *("CYda", "Clda", "Cnda") * 2),
    ("CX0", "CZde", "Cm0", "Cl0", "Cn0"),
)
"""For each function in the groups of `F16TP1538.tables`, the entry of `F16_COEFFICIENTS` that scales the function.

- Functions of alpha: damping, increments of the damping with the flap at 0, deltaCm, deltaClbeta, deltaCnbeta.
- Functions of alpha and beta: CZ and CY at zero deflections; increments with the flap at 0, with 30 deg of rudder, with
  20 deg of aileron; additional increments of the aileron with the flap at 0.
- Functions of alpha, beta and elevator: CX, CZ minus CZ at zero elevator, Cm, Cl, Cn."""


class F16TP1538(AbstractF16):
    """F-16 with the complete wind-tunnel tables of NASA TP-1538, over alpha, beta and elevator (deg)."""

    surface_reference: Vector3  #: Deflections (deg): aileron and rudder of the increments, flap fully down.
    #: Tables over alpha, beta and elevator (deg), constant beyond the ends: the groups of `TP1538_FUNCTIONS`, then the
    #: elevator effectiveness. Increments for the flap at 0 are known up to 45 deg of alpha and fall to 0 over the next
    #: interval, because the flap is fully down at greater alpha.
    tables: Tables

    def coefficients(self, air_data: AirData, rates_b: Vector3, surfaces: Vector) -> F16Coefficients:
        """Compute the force and moment coefficients by the build-up of TP-1538.

        `surfaces` are elevator, aileron, rudder and leading-edge flap, rad. Rates in rad/s are made dimensionless with
        b/2V and c/2V, where V is at least 1 m/s.
        """
        V = jnp.maximum(air_data.V, 1.0)
        beta_deg = air_data.beta * RAD_DEG
        deflection_deg = surfaces * RAD_DEG
        a, r, down = (deflection_deg[k + 1] / self.surface_reference[k] for k in range(3))
        f = 1 - down
        p = rates_b[0] * self.span / (2 * V)
        q = rates_b[1] * self.mean_chord / (2 * V)
        y = rates_b[2] * self.span / (2 * V)
        alpha_values, sideslip_values, elevator_values, (effectiveness,) = self.tables(
            air_data.alpha * RAD_DEG, beta_deg, deflection_deg[0]
        )
        count = len(_DAMPING)
        CXq, CYr, CYp, CZq, Clr, Clp, Cmq, Cnr, Cnp = alpha_values[:count] + f * alpha_values[count : 2 * count]
        dCm, dClbeta, dCnbeta = alpha_values[2 * count :]
        CZ0, CY0 = sideslip_values[:2]
        dCX, dCZ, dCm_flap, dCY, dCl, dCn = f * sideslip_values[2:8]
        CYdr, Cldr, Cndr = sideslip_values[8:11]
        CYda, Clda, Cnda = sideslip_values[11:14] + f * sideslip_values[14:17]
        CX0, CZde, Cm0, Cl0, Cn0 = elevator_values
        lever = self.x_cg_reference - self.x_cg
        CZ = CZ0 + CZde + dCZ + CZq * q
        CY = CY0 + dCY + CYda * a + CYdr * r + CYr * y + CYp * p
        Cn = Cn0 + dCn + dCnbeta * beta_deg + Cnda * a + Cndr * r + Cnr * y + Cnp * p
        Cn = Cn - CY * lever * self.mean_chord / self.span
        return F16Coefficients(
            CX=CX0 + dCX + CXq * q,
            CY=CY,
            CZ=CZ,
            Cl=Cl0 + dCl + dClbeta * beta_deg + Clda * a + Cldr * r + Clr * y + Clp * p,
            Cm=effectiveness * Cm0 + dCm_flap + dCm + CZ * lever + Cmq * q,
            Cn=Cn,
        )

    def with_coefficients_scaled(self, factors: Float[Array, "22"]) -> "F16TP1538":
        """Return a copy of the aircraft with each coefficient of `F16_COEFFICIENTS` multiplied by its factor.

        The flap's increments are scaled too; see `TP1538_FUNCTIONS`.
        """
        factors_by_group = [factors[np.array([F16_COEFFICIENTS.index(n) for n in names])] for names in TP1538_FUNCTIONS]
        *cells, effectiveness = self.tables.cells
        scaled = (
            *(c * group_factors[None, None, :] for c, group_factors in zip(cells, factors_by_group, strict=True)),
            effectiveness,
        )
        return eqx.tree_at(lambda a: a.tables.cells, self, scaled)


def tp1538_from_data(data: Mapping[str, Any], engine: F16Engine, x_cg_over_c: float | None = None) -> F16TP1538:
    """Build the F-16 from `data`, the content of `aircraft/data/tp1538.json`, and an engine.

    `engine` must be the textbook's engine (`f16_engine_from_data`), which has the thrust tables of TP-1538.
    `x_cg_over_c` is the centre of gravity as a fraction of the mean chord; None: value of the report. Raises ValueError
    if the axes of the tables differ from the axes that the build-up expects.
    """
    airframe, actuators, schedule, deflections = (
        data[key] for key in ("airframe", "actuators", "flap_schedule", "deflections")
    )
    alpha_down = data["validity"]["flap_at_0_alpha_max_deg"] * DEG_RAD
    built = F16TP1538(
        mass_properties=f16_mass_properties(airframe, airframe["mass_slug"] * SLUG_KG, spinning=True),
        actuators=ScheduledFlapActuators(
            time_constant=as_array(actuators["time_constant_s"]),
            lower=as_array(np.asarray(actuators["lower_deg"]) * DEG_RAD),
            upper=as_array(np.asarray(actuators["upper_deg"]) * DEG_RAD),
            rate_limit=as_array(np.asarray(actuators["rate_limit_deg_s"]) * DEG_RAD),
            gain=as_array(schedule["gain"]),
            pole=as_array(schedule["pole_per_s"]),
            compression=as_array(schedule["compression_deg"] * DEG_RAD),
            offset=as_array(schedule["offset_deg"] * DEG_RAD),
            alpha_down=as_array(alpha_down),
            names=tuple(actuators["order"]),
        ),
        alpha_range=range_from_deg(data["validity"]["alpha_deg"]),
        beta_range=range_from_deg(data["validity"]["beta_deg"]),
        engine=engine,
        span=as_array(airframe["span_ft"] * FOOT_M),
        wing_area=as_array(airframe["wing_area_ft2"] * FOOT_M**2),
        mean_chord=as_array(airframe["mean_chord_ft"] * FOOT_M),
        x_cg=as_array(float(airframe["x_cg_over_c"] if x_cg_over_c is None else x_cg_over_c)),
        x_cg_reference=as_array(airframe["x_cg_reference_over_c"]),
        surface_reference=as_array([float(deflections[f"{n}_reference_deg"]) for n in ("aileron", "rudder", "flap")]),
        tables=_tables(data),
    )
    # Strongly typed leaves: replacing one by another array does not recompile.
    return jax.tree.map(lambda leaf: as_array(leaf), built)


def _tables(data: Mapping[str, Any]) -> Tables:
    points = data["breakpoints_deg"]
    alphas, flap_alphas, elevators = points["alpha1"], points["alpha2"], points["dh1"]
    if alphas[: len(flap_alphas)] != flap_alphas or 0.0 not in elevators or not set(points["dh2"]) <= set(elevators):
        raise ValueError("TP-1538: expected alpha2 to begin alpha1, dh1 to hold 0 and all of dh2")
    values_by_name = {name: np.asarray(table["values"], dtype=float) for name, table in data["tables"].items()}
    neutral = elevators.index(0.0)

    def at_neutral(name: str) -> np.ndarray:
        return (
            values_by_name[name]
            if values_by_name[name].ndim == 2
            else values_by_name[name][..., list(_elevators_of(name)).index(0.0)]
        )

    def _elevators_of(name: str) -> Sequence[float]:
        return points[data["tables"][name]["axes"][2]]

    def faded(increment: np.ndarray) -> np.ndarray:
        """Extend an increment, measured up to 45 deg of alpha, by zeros to the full range of alpha."""
        return np.concatenate([increment, np.zeros((len(alphas) - len(flap_alphas), *increment.shape[1:]))])

    def on_all_elevators(name: str) -> np.ndarray:
        """Return the table `name`, interpolated linearly to all elevator deflections of the report."""
        own_elevators = _elevators_of(name)
        return np.stack(
            [np.stack([np.interp(elevators, own_elevators, r) for r in by_alpha]) for by_alpha in values_by_name[name]]
        )

    def flap(name: str) -> np.ndarray:
        return faded(values_by_name[f"{name}_lef"] - at_neutral(name)[: len(flap_alphas)])

    def aileron_flap(name: str) -> np.ndarray:
        aileron = values_by_name[f"{name}_a20"] - at_neutral(name)
        return faded(values_by_name[f"{name}_a20_lef"] - values_by_name[f"{name}_lef"] - aileron[: len(flap_alphas)])

    printed = [name.replace("CX", "Cx").replace("CY", "Cy").replace("CZ", "Cz") for name in _DAMPING]
    lateral = [name.replace("CY", "Cy") for name in _LATERAL]
    return make_tables(
        make_axes([alphas, points["beta1"], elevators], clamp=True),
        [
            (
                (0,),
                [
                    *(values_by_name[name] for name in printed),
                    *(faded(values_by_name[f"delta{name}_lef"]) for name in printed),
                    *(values_by_name[name] for name in ("deltaCm", "deltaClbeta", "deltaCnbeta")),
                ],
            ),
            (
                (0, 1),
                [
                    at_neutral("Cz"),
                    values_by_name["Cy"],
                    *(flap(name) for name in ("Cx", "Cz", "Cm", "Cy", "Cl", "Cn")),
                    *(values_by_name[f"{name}_r30"] - at_neutral(name) for name in lateral),
                    *(values_by_name[f"{name}_a20"] - at_neutral(name) for name in lateral),
                    *(aileron_flap(name) for name in lateral),
                ],
            ),
            (
                (0, 1, 2),
                [
                    values_by_name["Cx"],
                    values_by_name["Cz"] - values_by_name["Cz"][..., neutral : neutral + 1],
                    values_by_name["Cm"],
                    *(on_all_elevators(name) for name in ("Cl", "Cn")),
                ],
            ),
            ((2,), [values_by_name["eta_el"]]),
        ],
    )
