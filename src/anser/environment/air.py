"""Air in layers over the geopotential altitude, and conversion between true, calibrated and equivalent airspeed.

A table of layers is an array (layer, 7). The columns are, at the base of the layer: geopotential altitude (m),
temperature T (K), lapse rate (K/m), lapse rate over temperature (1/m), pressure p (Pa), and the coefficients ``power``
and ``decay`` (1/m). The pressure at a height z above the base is ``p exp(-power log1p(lapse z / T) - decay z)``:

- hydrostatic layer with a lapse rate: ``power`` = g/(R lapse), ``decay`` = 0;
- isothermal layer: ``power`` = 0, ``decay`` = g/(R T);
- layer between two measured pressures: ``power`` = 0, so that the logarithm of the pressure is linear in altitude.

The first layer continues below its base, the last layer up to any altitude. If the first two layers have the same base,
the first applies below the base, the second from the base upwards. The temperature of moist air is the virtual
temperature: dry air of this temperature has the pressure and the density of the moist air.

The calibrated airspeed is the true airspeed with the same impact pressure at sea level in the standard atmosphere. The
impact pressure is isentropic below Mach 1 and behind a normal shock above Mach 1 (Rayleigh's pitot formula). The
equivalent airspeed has the same dynamic pressure at the standard's sea-level density. The conversions take numbers,
NumPy arrays and JAX arrays; gradients are finite down to an airspeed of zero.
"""

import math
from collections.abc import Sequence
from types import ModuleType
from typing import Any, Literal, NamedTuple, Protocol, get_args

import numpy as np

from anser.constants import (
    AIR_HEAT_RATIO,
    AIR_MOLAR_MASS_KG_MOL,
    GAS_CONSTANT_J_MOL_K,
    GEOPOTENTIAL_RADIUS_M,
    SEA_LEVEL_PRESSURE_PA,
    SEA_LEVEL_TEMPERATURE_K,
    STANDARD_GRAVITY_M_S2,
)

AIR_GAS_CONSTANT_J_KG_K = GAS_CONSTANT_J_MOL_K / AIR_MOLAR_MASS_KG_MOL
CELSIUS_K = 273.15
"""Kelvin temperature of 0 degrees Celsius."""
LOWEST_M = -5000.0
"""Geometric altitude, m, below which the air is constant."""

# [USSA76] table 4: geopotential bases in m and lapse rates in K/m; the last layer continues above the standard's top
BASES_M = np.array([0.0, 11e3, 20e3, 32e3, 47e3, 51e3, 71e3, 84852.0])
LAPSES_K_M = np.array([-6.5e-3, 0.0, 1e-3, 2.8e-3, 0.0, -2.8e-3, -2e-3, 0.0])
_HYDROSTATIC_K_M = STANDARD_GRAVITY_M_S2 / AIR_GAS_CONSTANT_J_KG_K

Layers = np.ndarray
"""Table of layers, shape (layer, 7), with the columns that the module's docstring lists."""


class AirValues(NamedTuple):
    """Air at one or several altitudes."""

    density: np.ndarray  #: kg/m^3.
    pressure: np.ndarray  #: Pa.
    temperature: np.ndarray  #: Virtual temperature, K.
    speed_of_sound: np.ndarray  #: m/s.


def standard_layers(temperature_offset: float = 0.0, sea_level_pressure: float = SEA_LEVEL_PRESSURE_PA) -> "Layers":
    """Return the table of layers of the standard atmosphere with another temperature or sea-level pressure (Pa).

    `temperature_offset` is the difference from the standard temperature at every geopotential altitude, K. The pressure
    is hydrostatic upwards from sea level. Source: [USSA76] eq. (33a), (33b).
    """
    layers = []
    temperature, pressure = SEA_LEVEL_TEMPERATURE_K + temperature_offset, sea_level_pressure
    for base, top, lapse in zip(BASES_M, [*BASES_M[1:], BASES_M[-1]], LAPSES_K_M, strict=True):
        power, decay = _hydrostatic_law(lapse, temperature)
        layers.append([base, temperature, lapse, lapse / temperature, pressure, power, decay])
        thickness = top - base
        pressure *= math.exp(-power * math.log1p(lapse / temperature * thickness) - decay * thickness)
        temperature += lapse * thickness
    return np.array(layers)


def _hydrostatic_layer(base: float, temperature: float, temperature_top: float, pressure: float) -> list[float]:
    """Return the row of the table of layers for a hydrostatic layer 500 m thick.

    `base` is the geopotential altitude (m) and `pressure` (Pa) the pressure at the base. `temperature` and
    `temperature_top` are the virtual temperatures at base and top, K.
    """
    lapse = (temperature_top - temperature) / _HUMID_STEP_M
    return [base, temperature, lapse, lapse / temperature, pressure, *_hydrostatic_law(lapse, temperature)]


def _hydrostatic_law(lapse: float, temperature: float) -> tuple[float, float]:
    """Return `power` and `decay` (1/m) of a hydrostatic layer from lapse rate (K/m) and base temperature (K)."""
    return (_HYDROSTATIC_K_M / lapse, 0.0) if lapse else (0.0, _HYDROSTATIC_K_M / temperature)


STANDARD_LAYERS: Layers = standard_layers()

VAPOUR_MOLAR_RATIO = 0.62198
"""Molar mass of water over the molar mass of dry air."""
_HUMID_STEP_M = 500.0  # between the bases of the humid layers
_HUMID_ROUNDS = 6  # fixed-point steps of the pressure at a layer's top, to rounding


def vapour_pressure(temperature: np.ndarray | float) -> np.ndarray:
    """Return the saturation pressure of water vapour (Pa) at a temperature (K).

    Source: Bolton, "The Computation of Equivalent Potential Temperature", Monthly Weather Review 108 (1980), eq. (10).
    """
    celsius = np.asarray(temperature, dtype=float) - CELSIUS_K
    return 611.2 * np.exp(17.67 * celsius / (celsius + 243.5))


def virtual_temperature(
    temperature: np.ndarray | float, pressure: np.ndarray | float, relative_humidity: np.ndarray | float
) -> np.ndarray:
    """Return the virtual temperature (K) of moist air: dry air of this temperature has equal pressure and density.

    Inputs: temperature (K), pressure (Pa) and relative humidity over water (0 to 1) of the moist air. Source: law of
    ideal gases.
    """
    vapour = np.minimum(relative_humidity * vapour_pressure(temperature), pressure)
    return temperature / (1.0 - (1.0 - VAPOUR_MOLAR_RATIO) * vapour / pressure)


def humid_layers(
    relative_humidity: float, temperature_offset: float = 0.0, sea_level_pressure: float = SEA_LEVEL_PRESSURE_PA
) -> "Layers":
    """Return the table of layers of the standard atmosphere with moist air below the tropopause.

    The relative humidity, 0 to 1, is constant up to 10.5 km geopotential altitude and falls to 0 at 11 km. For
    temperature offset (K) and sea-level pressure (Pa) see `standard_layers`.
    """
    bases = np.arange(0.0, BASES_M[1], _HUMID_STEP_M)
    dry = standard_layers(temperature_offset)
    rows: list[list[float]] = []
    pressure = sea_level_pressure
    temperature = float(virtual_temperature(dry[0, 1], pressure, relative_humidity))
    for base in bases:
        top = base + _HUMID_STEP_M
        dry_top = dry[0, 1] + LAPSES_K_M[0] * top
        humidity_top = relative_humidity if top < BASES_M[1] else 0.0
        layer = _hydrostatic_layer(base, temperature, dry_top, pressure)
        for _ in range(_HUMID_ROUNDS):  # the virtual temperature at the top depends on the pressure there
            pressure_top = float(air_at_geopotential(np.array([layer]), top).pressure)
            temperature_top = float(virtual_temperature(dry_top, pressure_top, humidity_top))
            layer = _hydrostatic_layer(base, temperature, temperature_top, pressure)
        rows.append(layer)
        top_air = air_at_geopotential(np.array([layer]), top)
        temperature, pressure = float(top_air.temperature), float(top_air.pressure)
    upper = dry[1:].copy()
    upper[:, 4] *= pressure / dry[1, 4]
    return np.concatenate([np.array(rows), upper])


def measured_layers(
    geopotential: np.ndarray | Sequence[float],
    temperature: np.ndarray | Sequence[float],
    pressure: np.ndarray | Sequence[float],
) -> "Layers":
    """Return the table of layers of a sounding, from its levels in rising order.

    Inputs per level: geopotential altitude (m), virtual temperature (K), pressure (Pa). Temperature and logarithm of
    the pressure are linear between levels. Beyond the levels the pressure is hydrostatic. Below the lowest level the
    lapse rate is -6.5 K/km; above the highest level the temperature is constant.
    """
    h, T, p = (np.asarray(values, dtype=float) for values in (geopotential, temperature, pressure))
    lapse = np.append(np.diff(T) / np.diff(h), 0.0)
    decay = np.append(-np.diff(np.log(p)) / np.diff(h), _HYDROSTATIC_K_M / T[-1])
    below = [h[0], T[0], LAPSES_K_M[0], LAPSES_K_M[0] / T[0], p[0], *_hydrostatic_law(LAPSES_K_M[0], T[0])]
    return np.vstack([below, np.stack([h, T, lapse, lapse / T, p, np.zeros_like(h), decay], axis=-1)])


def padded_layers(layers: Layers, count: int) -> "Layers":
    """Return a table of the same air with `count` layers, at least `len(layers)`: the top layer is split every km."""
    missing = count - len(layers)
    heights = layers[-1, 0] + 1000.0 * np.arange(1.0, missing + 1.0)
    air = air_at_geopotential(layers, heights)
    lapse, power, decay = layers[-1, [2, 5, 6]]
    ones = np.ones(missing)
    pieces = [heights, air.temperature, lapse * ones, lapse / air.temperature, air.pressure, power * ones, decay * ones]
    return np.concatenate([layers, np.stack(pieces, axis=-1)])


def geopotential_altitude(altitude: Any) -> Any:
    """Convert geometric to geopotential altitudes, m; NumPy or JAX. Source: theory section 3, [USSA76] eq. (18)."""
    return GEOPOTENTIAL_RADIUS_M * altitude / (GEOPOTENTIAL_RADIUS_M + altitude)


def geometric_altitude(geopotential: Any) -> Any:
    """Convert geopotential to geometric altitudes, m; NumPy or JAX. Source: [USSA76] eq. (19)."""
    return GEOPOTENTIAL_RADIUS_M * geopotential / (GEOPOTENTIAL_RADIUS_M - geopotential)


def air_in_layers(layers: Layers, altitude: np.ndarray | float) -> AirValues:
    """Return the air of `layers` at geometric altitudes above mean sea level (m), a number or an array of any shape.

    Below -5 km the result is the air at -5 km.
    """
    return air_at_geopotential(layers, geopotential_altitude(np.maximum(altitude, LOWEST_M)))


def air_at_geopotential(layers: Layers, geopotential: np.ndarray | float) -> AirValues:
    """Return the air of `layers` at geopotential altitudes (m), a number or an array of any shape."""
    h = np.asarray(geopotential, dtype=float)
    row = layers[np.searchsorted(layers[1:, 0], h, side="right")]
    base, temperature_base, lapse, relative_lapse, pressure_base, power, decay = np.moveaxis(row, -1, 0)
    temperature = temperature_base + lapse * (h - base)
    pressure = pressure_base * np.exp(-power * np.log1p(relative_lapse * (h - base)) - decay * (h - base))
    density = pressure / (AIR_GAS_CONSTANT_J_KG_K * temperature)
    return AirValues(density, pressure, temperature, np.sqrt(AIR_HEAT_RATIO * AIR_GAS_CONSTANT_J_KG_K * temperature))


def pressure_altitude(pressure: np.ndarray | float) -> np.ndarray:
    """Return the geopotential altitude (m) at which the standard atmosphere has a pressure (Pa)."""
    ratio = np.log(np.asarray(pressure, dtype=float))
    return _altitude_from(ratio, np.log(STANDARD_LAYERS[:, 4]), STANDARD_LAYERS[:, 5], STANDARD_LAYERS[:, 6])


def density_altitude(density: np.ndarray | float) -> np.ndarray:
    """Return the geopotential altitude (m) at which the standard atmosphere has a density (kg/m^3)."""
    temperature, lapse = STANDARD_LAYERS[:, 1], STANDARD_LAYERS[:, 2]
    base = np.log(STANDARD_LAYERS[:, 4] / (AIR_GAS_CONSTANT_J_KG_K * temperature))
    # in a layer with a lapse rate the density is a power of the temperature too, with one more in the exponent
    power = np.where(lapse == 0.0, 0.0, STANDARD_LAYERS[:, 5] + 1.0)
    return _altitude_from(np.log(np.asarray(density, dtype=float)), base, power, STANDARD_LAYERS[:, 6])


def _altitude_from(logarithm: np.ndarray, base: np.ndarray, power: np.ndarray, decay: np.ndarray) -> np.ndarray:
    """Return the geopotential altitude (m) at which pressure or density of the standard atmosphere has a value.

    `logarithm` is the natural logarithm of the value; `base` has the logarithms at the bases of the layers. For `power`
    and `decay` (1/m) see the module's docstring.
    """
    row = np.searchsorted(-base[1:], -logarithm, side="right")
    drop, relative_lapse = base[row] - logarithm, STANDARD_LAYERS[row, 3]
    is_isothermal = power[row] == 0.0
    curved = np.expm1(drop / np.where(is_isothermal, 1.0, power[row])) / np.where(is_isothermal, 1.0, relative_lapse)
    straight = drop / np.where(is_isothermal, decay[row], 1.0)
    return STANDARD_LAYERS[row, 0] + np.where(is_isothermal, straight, curved)


def altimeter_setting(station_altitude: float, pressure: float) -> float:
    """Return the QNH (Pa) of a station, from its geopotential altitude (m) and its pressure (Pa)."""
    return float(air_at_geopotential(STANDARD_LAYERS, pressure_altitude(pressure) - station_altitude).pressure)


def altimeter_setting_in_layers(layers: Layers) -> float:
    """Return the QNH (Pa) of a station at the base of the lowest layer: a sounding's lowest level, or sea level."""
    station = layers[np.argmax(layers[:, 0] > LOWEST_M)]
    return altimeter_setting(float(station[0]), float(station[4]))


AirspeedForm = Literal["speed_m_s", "speed_cas_m_s", "speed_eas_m_s", "mach"]
"""Keys of an airspeed in files, commands and functions: true, calibrated and equivalent airspeed, and Mach number."""
AIRSPEED_FORMS: tuple[AirspeedForm, ...] = get_args(AirspeedForm)

SEA_LEVEL_DENSITY_KG_M3 = SEA_LEVEL_PRESSURE_PA / (AIR_GAS_CONSTANT_J_KG_K * SEA_LEVEL_TEMPERATURE_K)
SEA_LEVEL_SOUND_M_S = math.sqrt(AIR_HEAT_RATIO * AIR_GAS_CONSTANT_J_KG_K * SEA_LEVEL_TEMPERATURE_K)
_CRITICAL_RATIO = 1.2**3.5 - 1.0  # impact pressure over static pressure at Mach 1
_SLOWEST_MACH = 1e-5  # below, the flow is incompressible to 1e-11
_NEWTON_STEPS = 8  # to rounding, for Mach numbers up to 30


class AirState(Protocol):
    """Interface of the air at a point: `Air` or `AirValues`."""

    @property
    def pressure(self) -> Any:
        """Pressure, Pa."""

    @property
    def density(self) -> Any:
        """Density, kg/m^3."""

    @property
    def speed_of_sound(self) -> Any:
        """Speed of sound, m/s."""


def _namespace(*values: Any) -> ModuleType:
    arrays = (value for value in values if not isinstance(value, np.ndarray | np.generic))
    return next((value.__array_namespace__() for value in arrays if hasattr(value, "__array_namespace__")), np)


def impact_pressure_ratio(mach: Any) -> Any:
    """Return the ratio of impact pressure to static pressure at a Mach number (0 or more)."""
    xp = _namespace(mach)
    squared = mach * mach
    subsonic = xp.expm1(3.5 * xp.log1p(0.2 * squared))
    fast = xp.where(squared > 1.0, squared, 1.0)
    supersonic = (1.2 * fast) ** 3.5 * (6.0 / (7.0 * fast - 1.0)) ** 2.5 - 1.0
    return xp.where(squared > 1.0, supersonic, subsonic)


def mach_from_impact_pressure(ratio: Any) -> Any:
    """Return the Mach number from the ratio of impact to static pressure (positive)."""
    xp = _namespace(ratio)
    subsonic = xp.sqrt(5.0 * xp.expm1(xp.log1p(ratio) / 3.5))
    is_fast = ratio > _CRITICAL_RATIO
    logarithm = xp.log1p(xp.where(is_fast, ratio, 1.0))
    constant = 3.5 * math.log(1.2) + 2.5 * math.log(6.0)
    mach = xp.sqrt(xp.where(is_fast, ratio, 1.0) / 1.29 + 0.31)  # nearly: the ratio grows with the square
    for _ in range(_NEWTON_STEPS):
        excess = 7.0 * xp.log(mach) - 2.5 * xp.log(7.0 * mach * mach - 1.0) + constant - logarithm
        slope = 7.0 / mach - 35.0 * mach / (7.0 * mach * mach - 1.0)
        mach = mach - excess / slope
    return xp.where(is_fast, mach, subsonic)


def calibrated_from_true(airspeed: Any, air: AirState) -> Any:
    """Convert a true to a calibrated airspeed, both in m/s; `air` is the air at the aircraft (see `AirState`)."""
    xp = _namespace(airspeed, air.pressure)
    is_slow = airspeed < _SLOWEST_MACH * air.speed_of_sound
    mach = xp.where(is_slow, _SLOWEST_MACH, airspeed / air.speed_of_sound)
    pressure_ratio = air.pressure / SEA_LEVEL_PRESSURE_PA
    calibrated = SEA_LEVEL_SOUND_M_S * mach_from_impact_pressure(pressure_ratio * impact_pressure_ratio(mach))
    return xp.where(is_slow, equivalent_from_true(airspeed, air), calibrated)


def true_from_calibrated(airspeed: Any, air: AirState) -> Any:
    """Convert a calibrated to a true airspeed, both in m/s; `air` is the air at the aircraft (see `AirState`)."""
    xp = _namespace(airspeed, air.pressure)
    is_slow = airspeed < _SLOWEST_MACH * SEA_LEVEL_SOUND_M_S
    sea_level_mach = xp.where(is_slow, _SLOWEST_MACH, airspeed / SEA_LEVEL_SOUND_M_S)
    pressure_ratio = SEA_LEVEL_PRESSURE_PA / air.pressure
    mach = mach_from_impact_pressure(pressure_ratio * impact_pressure_ratio(sea_level_mach))
    return xp.where(is_slow, true_from_equivalent(airspeed, air), mach * air.speed_of_sound)


def equivalent_from_true(airspeed: Any, air: AirState) -> Any:
    """Convert a true to an equivalent airspeed, both in m/s; `air` is the air at the aircraft."""
    xp = _namespace(airspeed, air.density)
    return airspeed * xp.sqrt(air.density / SEA_LEVEL_DENSITY_KG_M3)


def true_from_equivalent(airspeed: Any, air: AirState) -> Any:
    """Convert an equivalent to a true airspeed, both in m/s; `air` is the air at the aircraft."""
    xp = _namespace(airspeed, air.density)
    return airspeed * xp.sqrt(SEA_LEVEL_DENSITY_KG_M3 / air.density)


def true_airspeed(form: str, value: Any, air: AirState) -> Any:
    """Return the true airspeed, m/s, from an airspeed in the form `form` (see `AirspeedForm`).

    `value` is in m/s, or the Mach number for the form "mach"; `air` is the air at the aircraft. An unknown form is
    taken as true airspeed.
    """
    match form:
        case "speed_cas_m_s":
            return true_from_calibrated(value, air)
        case "speed_eas_m_s":
            return true_from_equivalent(value, air)
        case "mach":
            return value * air.speed_of_sound
        case _:
            return value
