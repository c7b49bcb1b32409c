"""
The rendezvous in numbers
=========================

Range to the rendezvous of each aircraft: all lines reach their least at one instant, at a miss of centimetres.
"""

import matplotlib.pyplot as plt

import anser

flight = anser.run("scenarios/three-aircraft.toml")
figure, axis = plt.subplots(figsize=(7, 4.5), layout="constrained")
for aircraft in flight.summary["aircraft"]:
    range_m = flight.dataset.range_to_rendezvous_m.sel(aircraft=aircraft["name"])
    axis.semilogy(range_m.time, range_m, label=f"{aircraft['name']}: miss {aircraft['miss_m']:.2f} m")
    axis.axvline(aircraft["arrival_s"], color="0.5", linewidth=0.8)
axis.set(xlabel="time, s", ylabel="range to the rendezvous, m", ylim=(0.05, 2e4))
axis.legend()
plt.show()
