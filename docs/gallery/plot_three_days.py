"""
One calibrated airspeed, three days
===================================

True airspeed and Mach number of a climb at 140 m/s of calibrated airspeed, in the standard atmosphere and 30 K below
and above it.
"""

import jax
import matplotlib.pyplot as plt
import numpy as np

from anser.environment import true_from_calibrated
from anser.scenario.build_environment import build_atmosphere
from anser.scenario.schema_environment import Atmosphere

altitude_m = np.linspace(0, 12_000, 200)
figure, axes = plt.subplots(1, 2, sharey=True, figsize=(8, 4.5), layout="constrained")
for offset_k in (-30.0, 0.0, 30.0):
    atmosphere = build_atmosphere(Atmosphere(temperature_offset_k=offset_k))
    air = jax.vmap(atmosphere.at)(altitude_m)
    airspeed = true_from_calibrated(140.0, air)
    axes[0].plot(airspeed, altitude_m / 1e3)
    axes[1].plot(airspeed / air.speed_of_sound, altitude_m / 1e3, label=f"{offset_k:+g} K")
axes[0].set(xlabel="true airspeed, m/s", ylabel="altitude, km")
axes[1].set_xlabel("Mach number")
axes[1].legend()
plt.show()
