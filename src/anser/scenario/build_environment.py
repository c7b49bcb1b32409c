"""Construction of the environment (atmosphere, wind, Earth) and of each aircraft's gusts from a scenario."""

import functools
import json
import math
from collections.abc import Sequence
from importlib import resources

import jax

from anser.environment.air import padded_layers
from anser.environment.atmosphere import AbstractAtmosphere, LayeredAtmosphere, StandardAtmosphere
from anser.environment.earth import FlatEarth, somigliana, wgs84_earth
from anser.environment.environment import AbstractWind, Environment, LayeredWind, SteadyWind
from anser.environment.gusts import AbstractGusts, DiscreteGust, NoGusts, SummedGusts
from anser.environment.turbulence import ExceedanceTable, Turbulence
from anser.numerics.arrays import as_array, bucket_size, stack_rows
from anser.scenario.build_wind_field import build_wind_field
from anser.scenario.schema import Scenario
from anser.scenario.schema_aircraft import Aircraft
from anser.scenario.schema_environment import INTENSITIES, Atmosphere
from anser.shapes import ScalarLike, Vector3
from anser.units import DEG_RAD, FOOT_M

_AIR_LAYERS = 8  # smallest bucket size of the layers of an atmosphere
_LAYERS = 4  # smallest bucket size of a shear profile
_PADDING_SPACING_M = 1000.0  # between the altitudes of padding layers


def build_environment(scenario: Scenario) -> Environment:
    """Build atmosphere, wind and Earth: flat, with the gravity at the origin's latitude, or the WGS-84 ellipsoid."""
    latitude, longitude = (as_array(x * DEG_RAD) for x in (scenario.earth.latitude_deg, scenario.earth.longitude_deg))
    earth = wgs84_earth(latitude, longitude) if scenario.earth.model == "wgs84" else FlatEarth(somigliana(latitude))
    return Environment(build_atmosphere(scenario.atmosphere), build_wind(scenario), earth)


def build_atmosphere(atmosphere: Atmosphere | None) -> AbstractAtmosphere:
    """Build the atmosphere of a table [atmosphere]; None: the standard atmosphere."""
    if atmosphere is None:
        return StandardAtmosphere()
    layers = atmosphere.layers
    return LayeredAtmosphere(as_array(padded_layers(layers, bucket_size(len(layers), _AIR_LAYERS))))


def build_wind(scenario: Scenario) -> AbstractWind:
    """Build the wind of a scenario: uniform, in layers, or the wind field of a file."""
    if scenario.wind.field is not None:
        return build_wind_field(scenario.wind, scenario.earth)
    profile = scenario.wind.profile_m_s
    if scenario.wind.layers is None:
        return SteadyWind(ned(profile[0][1]))
    altitudes, velocities = zip(*profile, strict=True)
    padding_count = bucket_size(len(altitudes), _LAYERS) - len(altitudes)
    padding_altitudes = [altitudes[-1] + k * _PADDING_SPACING_M for k in range(1, padding_count + 1)]
    return LayeredWind(
        as_array([*altitudes, *padding_altitudes]),
        stack_rows([ned(velocity) for velocity in [*velocities, *[velocities[-1]] * padding_count]]),
    )


def ned(position_up_m: Sequence[float]) -> Vector3:
    """Convert a vector (north, east, up) to an array (north, east, down), shape (3,)."""
    north, east, up = position_up_m
    return as_array([north, east, -up])


def build_gusts(scenario: Scenario, aircraft: Aircraft, span_m: ScalarLike) -> AbstractGusts:
    """Build the gusts of one aircraft: turbulence, scaled with the wing span, and the scenario's discrete gusts.

    Discrete gusts of other aircraft have zero velocity, so that all aircraft have equal pytree structures.
    """
    parts: list[AbstractGusts] = []
    turbulence = scenario.turbulence
    if turbulence.intensity != "none":
        wind_20ft_m_s, probability = INTENSITIES[turbulence.intensity]
        parts.append(
            Turbulence(
                wind_20ft=as_array(wind_20ft_m_s),
                log_probability=as_array(math.log10(probability)),
                table=exceedance_table(),
                span=as_array(span_m),
                family=turbulence.spectrum,
            )
        )
    for gust in scenario.gust:
        is_affected = gust.aircraft in (None, aircraft.name)
        parts.append(
            DiscreteGust(
                amplitudes=as_array(
                    [is_affected * gust.along_m_s, is_affected * gust.right_m_s, -is_affected * gust.up_m_s]
                ),
                length=as_array(gust.length_m),
                start=as_array(gust.time_s),
                returns=as_array(gust.returns, bool),
            )
        )
    if not parts:
        return NoGusts()
    return parts[0] if len(parts) == 1 else SummedGusts(tuple(parts))


@functools.cache
def exceedance_table() -> ExceedanceTable:
    """Read the table of turbulence intensity, m/s, by height, m, and log10 of the probability of exceedance."""
    path = resources.files("anser.environment").joinpath("data/turbulence.json")
    data = json.loads(path.read_text(encoding="utf-8"))
    with jax.ensure_compile_time_eval():  # cached, so it must not belong to the trace of the first caller
        return ExceedanceTable(
            heights=as_array([FOOT_M * height for height in data["heights_ft"]]),
            log_probabilities=as_array([math.log10(p) for p in data["probabilities"]]),
            sigmas=as_array([[FOOT_M * sigma for sigma in sigmas] for sigmas in data["sigma_ft_s"]]),
        )
