"""
Modes over the airspeed
=======================

Eigenvalues of the F-16 in level flight at airspeeds from 100 to 220 m/s, with the centre of gravity at 30 % of the
chord: Dutch roll and short period grow with the airspeed, the roll mode is the fast real one.
"""

import matplotlib.pyplot as plt
import numpy as np

import anser

f16 = anser.aircraft("f16", x_cg_over_c=0.3)
speeds_m_s = np.arange(100, 221, 10)
figure, axis = plt.subplots(figsize=(7, 5), layout="constrained")
for speed_m_s in speeds_m_s:
    poles = np.linalg.eigvals(np.asarray(f16.linearize(speed_m_s=speed_m_s, altitude_m=3000).model.A))
    points = axis.scatter(poles.real, poles.imag, c=np.full(poles.size, speed_m_s), vmin=100, vmax=220, cmap="viridis")
figure.colorbar(points, label="airspeed, m/s")
axis.axvline(0.0, color="0.6", linewidth=0.8)
axis.set(xlabel="real part, 1/s", ylabel="imaginary part, rad/s", xlim=(-4.0, 0.5))
plt.show()
