"""
A thousand aircraft, step by step
=================================

1,024 F-16s start with random pitch rates and angles of attack about a trim; `anser.Simulator` steps them all at once.
"""

import matplotlib.pyplot as plt
import numpy as np

import anser

f16 = anser.aircraft("f16", x_cg_over_c=0.3)
trim = f16.start(f16.trim(speed_m_s=150, altitude_m=3000))
random = np.random.default_rng(1)
starts = [
    {**trim, "alpha_deg": trim["alpha_deg"] + alpha, "pitch_rate_deg_s": rate}
    for alpha, rate in zip(random.normal(0, 2, 1024), random.normal(0, 4, 1024), strict=True)
]
simulator = anser.Simulator(f16, starts, step_s=0.02)
history = []
for _ in range(400):
    state = simulator.step({})
    history.append((np.asarray(state["alpha_deg"]), np.asarray(state["pitch_rate_deg_s"])))
alpha, rate = np.moveaxis(np.array(history), 1, 0)

figure, axis = plt.subplots(figsize=(7, 5), layout="constrained")
axis.plot(alpha, rate, color="C0", alpha=0.05, linewidth=0.6)
axis.scatter(alpha[0], rate[0], s=4, color="C1", label="start")
axis.scatter(alpha[-1], rate[-1], s=4, color="k", label="after 8 s")
axis.set(xlabel="angle of attack, deg", ylabel="pitch rate, deg/s")
axis.legend()
plt.show()
