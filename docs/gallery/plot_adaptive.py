"""
Half an elevator
================

At 20 s the elevator loses half of its effectiveness. The adaptive inversion learns it from the next manoeuvre; the band
is two standard deviations of its estimate.
"""

import matplotlib.pyplot as plt

import anser

f16 = anser.aircraft("f16")
trim = f16.trim(speed_m_s=150, altitude_m=1000)
manoeuvre = {
    name: anser.doublet(size, start_s=25.0, width_s=4.0) for name, size in (("course_deg", 15), ("path_angle_deg", 3))
}
damage = {"time_s": 20.0, "surface_effectiveness": {"elevator": 0.5}}
flight = anser.simulate(
    f16, trim, controller="adaptive", command=manoeuvre, change=damage, duration_s=40, record_period_s=0.05
)
data = flight.dataset
estimate, sigma = data.pitch_effectiveness_estimate, data.pitch_effectiveness_sigma
figure, axes = plt.subplots(2, sharex=True, figsize=(7, 6), layout="constrained")
axes[0].plot(data.time, data.elevator_deg)
axes[0].set_ylabel("elevator, deg")
axes[1].fill_between(data.time, estimate - 2 * sigma, estimate + 2 * sigma, alpha=0.3)
axes[1].plot(data.time, estimate)
axes[1].plot([0, 20, 20, 40], [1, 1, 0.5, 0.5], "k--", linewidth=0.8, label="true")
axes[1].set(xlabel="time, s", ylabel="effectiveness in pitch", ylim=(0, 1.6))
axes[1].legend()
plt.show()
