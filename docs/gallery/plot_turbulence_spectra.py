"""
Spectra of turbulence
=====================

Vertical gusts of ten minutes in moderate turbulence: Dryden's and von Karman's spectra have the same intensity and
scale, and fall with the powers 2 and 5/3 of the frequency.
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.signal import welch

import anser

f16 = anser.aircraft("f16")
trim = f16.trim(speed_m_s=150, altitude_m=3000)
figure, axis = plt.subplots(figsize=(7, 4.5), layout="constrained")
for spectrum in ("dryden", "von-karman"):
    flight = anser.simulate(
        f16, trim, controller="inversion", duration_s=600, record_period_s=0.02,
        turbulence={"intensity": "moderate", "spectrum": spectrum},
    )  # fmt: skip
    frequency, density = welch(flight.dataset.gust_w_m_s, 50.0, nperseg=4096)
    axis.loglog(frequency[1:], density[1:], label=spectrum)
band = np.array([0.5, 10.0])
axis.loglog(band, 2.0 * band**-2.0, "k--", linewidth=0.8, label="power -2")
axis.loglog(band, 6.0 * band ** (-5 / 3), "k:", linewidth=0.8, label="power -5/3")
axis.set(xlabel="frequency, Hz", ylabel="density of the vertical gust, (m/s)$^2$/Hz", xlim=(0.01, 20), ylim=(1e-4, 1e3))
axis.legend()
plt.show()
