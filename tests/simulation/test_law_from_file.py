"""Closed loop with a control law from a file: NASA's F-16 over a flat Earth."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array

from anser.control import NamedCommands, dave_ml_law
from anser.environment import standard_environment
from anser.parts import Instant
from anser.sensing import IdealSensors, TrackingEstimator
from anser.simulation import AbstractRecorder, Vehicle
from anser.simulation.closed_loop import fly_alone, trimmed_vehicle
from anser.steady import solve_trim, trim_target
from anser.verification.nesc_flight import prompt_f16, published_model

STEP_S = 0.0025


def level(trim, airspeed, altitude):
    """Inputs of the law: autopilot on, stick centred, trim as feed-forward, 100 ft up after one second."""
    return NamedCommands(
        initial_commands={
            **dict.fromkeys((f"pilotControl_{axis}" for axis in ("throttle", "long", "lat", "yaw")), 0.0),
            "stabilityAugmentationOn_disc": 1.0,
            "autopilotOn_disc": 1.0,
            "trimmedPilotControl_throttle": trim.power / 100.0,
            "trimmedPilotControl_long": -jnp.rad2deg(trim.controls.surfaces[0]) / 25.0,
            "equivalentAirspeedCommand": airspeed,
            "altitudeMslCommand": altitude,
            "trueBaseCourseCommand": 0.0,
            "lateralDeviationError": 0.0,
        },
        change={"altitudeMslCommand": 30.48},
        change_time=1.0,
    )


@jax.jit
def flown(law, airframe, altitude):
    """Altitude every 0.1 s of a flight of 20 s from trim at 172.4 m/s."""
    environment = standard_environment()
    trim = solve_trim(airframe, environment, trim_target(172.4, altitude))
    density_ratio = environment.atmosphere.at(altitude).density / environment.atmosphere.at(0.0).density
    guidance = level(trim, 172.4 * jnp.sqrt(density_ratio), altitude)
    vehicle = Vehicle(airframe, IdealSensors(), TrackingEstimator(), guidance, law)
    start = trimmed_vehicle(vehicle, Instant(environment, jnp.asarray(0), jnp.asarray(STEP_S)), trim)
    return fly_alone(vehicle, environment, start, STEP_S, 8000, Altitude())[2]


class Altitude(AbstractRecorder):
    """Altitude, m."""

    stride: int = 40

    def output(self, sample, instant) -> Array:
        return sample.truth.condition.air_data.altitude


@pytest.mark.long
def test_the_commanded_altitude_is_reached():
    law = dave_ml_law(published_model("F16_control"))
    altitude = np.asarray(flown(law, prompt_f16(STEP_S), jnp.asarray(3052.0)))
    assert np.ptp(altitude[:10]) < 0.1
    assert altitude[-1] - 3052.0 == pytest.approx(30.48, abs=0.3)
    assert np.max(altitude) - 3052.0 < 35.0
