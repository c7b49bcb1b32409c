"""From the tables of a scenario on air that is not smooth to the gusts that an aircraft meets."""

import functools
import json
import math
from importlib import resources

import jax

from anser.environment import AbstractGusts, DiscreteGust, ExceedanceTable, NoGusts, SummedGusts, Turbulence
from anser.numerics import as_array
from anser.scenario.schema import Scenario
from anser.scenario.schema_air import INTENSITIES
from anser.scenario.schema_aircraft import Aircraft
from anser.shapes import ScalarLike

_FOOT_M = 0.3048


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
