"""
Load factor in discrete gusts
=============================

Greatest load factor of the Aerosonde in gusts of the form 1 - cos with equal strength, over the distance to the
greatest velocity. Short gusts meet the inertia of the aircraft, long ones its own response.
"""

import matplotlib.pyplot as plt
import numpy as np

import anser

uav = anser.aircraft("aerosonde")
trim = uav.trim(speed_m_s=25, altitude_m=300)
lengths_m = np.geomspace(2, 100, 12)
peaks = []
for length_m in lengths_m:
    gust = [{"time_s": 0.5, "up_m_s": 3.0, "length_m": length_m, "returns": True}]
    flight = anser.simulate(uav, trim, duration_s=12, gust=gust)
    peaks.append(float(flight.dataset.load_factor.max()))

figure, axis = plt.subplots(figsize=(7, 4), layout="constrained")
axis.semilogx(lengths_m, peaks, marker="o")
axis.set(xlabel="distance to the greatest velocity, m", ylabel="greatest load factor")
plt.show()
