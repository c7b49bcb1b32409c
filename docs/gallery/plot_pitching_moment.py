"""
Lift and pitching moment to 90 degrees
======================================

NASA TP-1538 measured the F-16 from -20 to 90 deg of angle of attack; the textbook's tables end at 45 deg, and the
global model of Grauer and Morelli is smooth.
"""

import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np

import anser
from anser.aircraft.air_data import air_data
from anser.environment import standard_environment
from anser.spatial.wind_axes import air_direction_b

air = standard_environment().atmosphere.at(3000.0)
figure, axes = plt.subplots(2, sharex=True, figsize=(7, 6), layout="constrained")
for variant, top_deg in (("textbook", 45), ("global", 45), ("tp1538", 90)):
    airframe = anser.aircraft("f16", variant).airframe

    def lift_and_moment(alpha, airframe=airframe):
        data = air_data(150.0 * air_direction_b(alpha, 0.0), 3000.0, air)
        wrench = airframe.aerodynamics(data, jnp.zeros(3), jnp.zeros(len(airframe.actuators.names)))
        lift = wrench.force_b[0] * jnp.sin(alpha) - wrench.force_b[2] * jnp.cos(alpha)
        return lift / 1e3, wrench.moment_b[1] / 1e3

    alpha_deg = np.linspace(-10, top_deg, 300)
    curves = jax.vmap(lift_and_moment)(np.radians(alpha_deg))
    for axis, curve in zip(axes, curves, strict=True):
        axis.plot(alpha_deg, curve, label=variant)
axes[0].set_ylabel("lift, kN")
axes[1].set(xlabel="angle of attack, deg", ylabel="pitching moment, kN m")
axes[0].legend()
plt.show()
