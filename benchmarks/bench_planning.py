"""Time to plan a fleet with the certified planner, warm: `python benchmarks/bench_planning.py [aircraft ...]`.

Fleets of random starts on a ring around a grid of buoys 2 km apart, 500 m or 150 m from each other, wind 15 m/s; all
arrive at one time. Prints the first call (it compiles), the warm time and how many of the fleet keep everything.
"""

import sys
import time

import jax
import jax.numpy as jnp
import numpy as np

from anser.compilation_cache import enable_compilation_cache
from anser.environment import SteadyWind
from anser.planning import PathLimits, make_rendezvous
from anser.planning.certified import Airspace, Separation, Traveller, no_keep_outs, plan_at, stacked, ticks_for
from anser.planning.certified.choices import FEW, MANY

_FLEETS = (3, 10, 30, 100)
_SPEED = 150.0
_SPACING_M = 2000.0


def fleet(count: int, seed: int = 0) -> tuple[Traveller, float]:
    """A fleet and a time at which all can arrive, s."""
    rng = np.random.default_rng(seed)
    side = int(np.ceil(np.sqrt(count)))
    radius = 12e3 + 0.8 * side * _SPACING_M
    limits = PathLimits(*(jnp.asarray(x) for x in (90.0, 240.0, 0.9, 60.0, 100.0, 9000.0, 4.0, 4.0, 1.5)))

    def one(k: int) -> Traveller:
        angle = 2 * np.pi * k / count + rng.uniform(-0.2, 0.2) / count
        out = radius * rng.uniform(0.9, 1.1)
        heading = angle + np.pi + rng.uniform(-0.7, 0.7)
        # Buoys on the same side of the grid as the start, in rows: neighbours stay neighbours.
        place = ((k % side) - 0.5 * (side - 1)) * _SPACING_M, ((k // side) - 0.5 * (side - 1)) * _SPACING_M
        return Traveller(
            position_n=jnp.asarray([out * np.cos(angle), out * np.sin(angle), -rng.uniform(1000.0, 3000.0)]),
            air_velocity_n=jnp.asarray([_SPEED * np.cos(heading), _SPEED * np.sin(heading), 0.0]),
            air_acceleration_n=jnp.zeros(3),
            goal_position_n=jnp.asarray([*place, 0.0]),
            goal_velocity_n=jnp.zeros(3),
            rendezvous=make_rendezvous(jnp.asarray([0.0, 0.0, -300.0 - 200.0 * (k % 3)])),
            speed=jnp.asarray(_SPEED),
            side=jnp.asarray(0),
            limits=limits,
            roll_rate_max=jnp.asarray(0.35),
            active=jnp.asarray(1.0),
        )

    return stacked([one(k) for k in range(count)]), 1.9 * radius / _SPEED


def main(counts: tuple[int, ...]) -> None:
    """Print one line per fleet."""
    jax.config.update("jax_enable_x64", True)
    enable_compilation_cache()
    airspace = Airspace(
        SteadyWind(jnp.asarray([5.0, 14.0, 0.0])),
        jnp.asarray(9.80665),
        Separation(jnp.asarray(500.0), jnp.asarray(150.0)),
        no_keep_outs(),
    )
    for count in counts:
        travellers, duration = fleet(count)
        for name, choices in (("few", FEW), ("many", MANY)):
            ticks = ticks_for(duration)
            durations = jnp.full(count, duration)

            def plan(choices=choices, ticks=ticks, durations=durations, travellers=travellers):
                return jax.block_until_ready(plan_at(0.0, travellers, airspace, durations, ticks, choices))

            begun = time.perf_counter()
            made = plan()
            first = time.perf_counter() - begun
            spent = []
            for _ in range(5 if count <= 100 else 1):
                begun = time.perf_counter()
                made = plan()
                spent.append(time.perf_counter() - begun)
            good = int(np.sum(np.asarray(made.good)))
            print(f"{count:5d} aircraft, {name:4s}: first {first:6.1f} s, warm {min(spent):8.4f} s, {good} proven")
            if good == count:
                break


if __name__ == "__main__":
    main(tuple(int(x) for x in sys.argv[1:]) or _FLEETS)
