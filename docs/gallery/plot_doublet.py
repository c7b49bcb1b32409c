"""
An elevator doublet
===================

The F-16 answers an elevator doublet in open loop: the short period in angle of attack and pitch rate, then the phugoid
in pitch and airspeed.
"""

import matplotlib.pyplot as plt

import anser

f16 = anser.aircraft("f16")
trim = f16.trim(speed_m_s=150, altitude_m=1000)
flight = anser.simulate(f16, trim, {"elevator": anser.doublet(1.0)}, duration_s=60).dataset

panels = {"elevator_deg": "elevator, deg", "alpha_deg": "angle of attack, deg", "pitch_rate_deg_s": "pitch rate, deg/s",
          "pitch_deg": "pitch, deg", "airspeed_m_s": "airspeed, m/s"}  # fmt: skip
figure, axes = plt.subplots(len(panels), sharex=True, figsize=(7, 8), layout="constrained")
for axis, (name, label) in zip(axes, panels.items(), strict=True):
    axis.plot(flight.time, flight[name])
    axis.set_ylabel(label)
axes[-1].set_xlabel("time, s")
plt.show()
