"""
An aircraft is lost
===================

At the time of the event one aircraft leaves the mission; the planner finds new paths for the others, which arrive
together at a new time.
"""

import matplotlib.pyplot as plt

import anser

flight = anser.run("scenarios/lost-aircraft.toml")
data = flight.dataset.sel(time=slice(0.0, 70.0))
figure, axes = plt.subplots(1, 2, figsize=(9, 4.5), layout="constrained")
for name in data.aircraft.values:
    path = data.sel(aircraft=name)
    axes[0].plot(path.east_m / 1e3, path.north_m / 1e3, label=name)
    axes[1].plot(data.time, path.range_to_rendezvous_m / 1e3)
for event in flight.scenario.event:
    axes[1].axvline(event.time_s, color="0.5", linewidth=0.8)
axes[0].set(xlabel="east, km", ylabel="north, km", aspect="equal")
axes[1].set(xlabel="time, s", ylabel="range to the rendezvous, km")
axes[0].legend()
plt.show()
