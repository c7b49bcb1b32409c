"""
A sweep over the wind
=====================

One mission in winds of 0 to 25 m/s from four directions: the time of arrival moves, the miss does not.
"""

import matplotlib.pyplot as plt

import anser

swept = anser.sweep(
    "scenarios/single-aircraft.toml",
    {"wind.from_deg": [0.0, 90.0, 180.0, 270.0], "wind.speed_m_s": [0.0, 5.0, 10.0, 15.0, 20.0, 25.0]},
)
figure, axes = plt.subplots(2, sharex=True, figsize=(7, 6), layout="constrained")
for axis, name in zip(axes, ("arrival_s", "miss_m"), strict=True):
    values = swept[name].squeeze("aircraft")
    values.plot.line(ax=axis, x="wind.speed_m_s", marker="o", add_legend=axis is axes[0])
    axis.set(xlabel="", title="")
axes[1].set_xlabel("wind speed, m/s")
plt.show()
