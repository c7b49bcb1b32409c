"""
Frequency responses of the inversion
====================================

Responses of the commanded loop of the autopilot to its commands of airspeed, path angle and course, from the sampled
linear model of the whole closed loop.
"""

import matplotlib.pyplot as plt
import numpy as np

import anser

result = anser.linearize("f16", speed_m_s=150, altitude_m=3000, loop="velocity", step_s=0.01)
model = result.model
frequency = np.geomspace(0.01, 20, 300)
figure, axes = plt.subplots(2, sharex=True, figsize=(7, 6), layout="constrained")
gamma = model.C[model.outputs.index("theta")] - model.C[model.outputs.index("alpha")]  # wings level
rows = {"V": model.C[model.outputs.index("V")], "gamma": gamma, "chi": model.C[model.outputs.index("psi")]}
for column, (name, row) in enumerate(rows.items()):
    z = np.exp(1j * frequency * model.step)[:, None, None]
    response = row @ np.linalg.solve(z * np.eye(len(model.A)) - model.A, model.B[:, [column]])
    response = response.squeeze()
    axes[0].semilogx(frequency, 20 * np.log10(np.abs(response)), label=name)
    axes[1].semilogx(frequency, np.degrees(np.unwrap(np.angle(response))))
axes[0].set(ylabel="magnitude, dB", ylim=(-60, 10))
axes[1].set(xlabel="frequency, rad/s", ylabel="phase, deg", ylim=(-400, 40))
axes[0].legend()
plt.show()
