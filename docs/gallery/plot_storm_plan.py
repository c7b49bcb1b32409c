"""
A plan around closed volumes
============================

The certified planner leads the aircraft to their rendezvous past closed cylinders, with limits and separation proven
also between the samples.
"""

import matplotlib.pyplot as plt
from matplotlib.patches import Circle

import anser

volumes = [
    {"name": "lake", "north_m": 9000.0, "east_m": -2500.0, "radius_m": 1500.0},
    {"name": "hills", "north_m": -8000.0, "east_m": 4500.0, "radius_m": 2000.0},
]
scenario = anser.load("scenarios/storm-sampling.toml").replace("keep_out", volumes)
flight = anser.run(scenario)
figure, axis = plt.subplots(figsize=(7, 7), layout="constrained")
for volume in scenario.keep_out:
    axis.add_patch(Circle((volume.east_m / 1e3, volume.north_m / 1e3), volume.radius_m / 1e3, color="0.85"))
for aircraft in flight.summary["aircraft"]:
    name = aircraft["name"]
    path = flight.dataset.sel(aircraft=name, time=slice(0.0, aircraft["arrival_s"]))
    (line,) = axis.plot(path.east_m / 1e3, path.north_m / 1e3, label=name)
    marks = path.isel(time=slice(0, None, 100))
    axis.plot(marks.east_m / 1e3, marks.north_m / 1e3, ".", color=line.get_color())
    axis.plot(path.east_m[-1] / 1e3, path.north_m[-1] / 1e3, "o", color=line.get_color())
axis.set(xlabel="east, km", ylabel="north, km", aspect="equal", title="dots every 10 s")
axis.legend()
plt.show()
