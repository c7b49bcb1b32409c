"""
Specific excess power
=====================

Rate of climb that the full thrust of the F-16 sustains at constant airspeed: the performance sheet of an aircraft. The
line of zero bounds the level flights.
"""

import matplotlib.pyplot as plt
import numpy as np

import anser

sheet = anser.aircraft("f16").performance(3000.0).dataset
figure, axis = plt.subplots(figsize=(7, 5), layout="constrained")
levels = np.arange(0, 226, 25)
values = (sheet.airspeed, sheet.altitude / 1e3, sheet.specific_excess_power_m_s)
areas = axis.contourf(*values, levels=levels, cmap="viridis", extend="both")
axis.contour(*values, levels=[0.0], colors="k")
figure.colorbar(areas, label="specific excess power, m/s")
axis.set(xlabel="airspeed, m/s", ylabel="altitude, km")
plt.show()
