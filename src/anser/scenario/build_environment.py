"""From a scenario to its air and Earth: environment and wind, and the gusts that an aircraft meets."""

import functools
import json
import math
from collections.abc import Sequence
from importlib import resources

import jax

from anser.environment.atmosphere import StandardAtmosphere
from anser.environment.earth import FlatEarth, somigliana, wgs84_earth
from anser.environment.environment import AbstractWind, Environment, LayeredWind, SteadyWind
from anser.environment.gusts import AbstractGusts, DiscreteGust, NoGusts, SummedGusts
from anser.environment.turbulence import ExceedanceTable, Turbulence
from anser.numerics.arrays import as_array, bucket_size, stack_rows
from anser.scenario.schema import Scenario
from anser.scenario.schema_aircraft import Aircraft
from anser.scenario.schema_environment import INTENSITIES
from anser.shapes import ScalarLike, Vector3
from anser.units import DEG_RAD

_FOOT_M = 0.3048
_LAYERS = 4  # least size of a shear profile
_PADDING_SPACING_M = 1000.0  # between the altitudes that fill up a shear profile


def build_environment(scenario: Scenario) -> Environment:
    """Standard atmosphere; the flat Earth with normal gravity at the scenario's latitude, or WGS-84; the wind."""
    latitude, longitude = (as_array(x * DEG_RAD) for x in (scenario.earth.latitude_deg, scenario.earth.longitude_deg))
    earth = wgs84_earth(latitude, longitude) if scenario.earth.model == "wgs84" else FlatEarth(somigliana(latitude))
    return Environment(StandardAtmosphere(), build_wind(scenario), earth)


def build_wind(scenario: Scenario) -> AbstractWind:
    """Wind, the same at every altitude or layered."""
    profile = scenario.wind.profile_m_s
    if scenario.wind.layers is None:
        return SteadyWind(ned(profile[0][1]))
    altitudes, velocities = zip(*profile, strict=True)
    more = bucket_size(len(altitudes), _LAYERS) - len(altitudes)
    above = [
        altitudes[-1] + k * _PADDING_SPACING_M for k in range(1, more + 1)
    ]  # where the wind is that of the last layer
    return LayeredWind(
        as_array([*altitudes, *above]),
        stack_rows([ned(velocity) for velocity in [*velocities, *[velocities[-1]] * more]]),
    )


def ned(position_up_m: Sequence[float]) -> Vector3:
    """(north, east, up) as (north, east, down)."""
    north, east, up = position_up_m
    return as_array([north, east, -up])


def build_gusts(scenario: Scenario, aircraft: Aircraft, span_m: ScalarLike) -> AbstractGusts:
    """Turbulence and single gusts that an aircraft of a wing span meets."""
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
        met = gust.aircraft in (None, aircraft.name)
        parts.append(
            DiscreteGust(
                amplitudes=as_array([met * gust.along_m_s, met * gust.right_m_s, -met * gust.up_m_s]),
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
    """Intensity of turbulence by height and probability, from its data file."""
    path = resources.files("anser.environment").joinpath("data/turbulence.json")
    data = json.loads(path.read_text(encoding="utf-8"))
    with jax.ensure_compile_time_eval():  # kept, so never of the trace in which it may first be asked for
        return ExceedanceTable(
            heights=as_array([_FOOT_M * height for height in data["heights_ft"]]),
            log_probabilities=as_array([math.log10(p) for p in data["probabilities"]]),
            sigmas=as_array([[_FOOT_M * sigma for sigma in row] for row in data["sigma_ft_s"]]),
        )
