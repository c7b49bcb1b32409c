"""
Three aircraft, one instant
===========================

Three F-16s, each to its own moving goal, arrive at the same time: paths in space, goals on the surface below.
"""

import matplotlib.pyplot as plt

import anser

flight = anser.run("scenarios/three-aircraft.toml")
figure = plt.figure(figsize=(8, 6), layout="constrained")
axis = figure.add_subplot(projection="3d")
for aircraft in flight.summary["aircraft"]:
    name = aircraft["name"]
    path = flight.dataset.sel(aircraft=name, time=slice(0.0, aircraft["arrival_s"]))
    (line,) = axis.plot(path.east_m / 1e3, path.north_m / 1e3, path.altitude_m, label=name)
    axis.scatter(path.east_m[-1] / 1e3, path.north_m[-1] / 1e3, path.altitude_m[-1], color=line.get_color(), marker="o")
    axis.plot(path.east_m / 1e3, path.north_m / 1e3, 0 * path.altitude_m, color=line.get_color(), alpha=0.3)
axis.set(xlabel="east, km", ylabel="north, km", zlabel="altitude, m")
axis.legend()
plt.show()
