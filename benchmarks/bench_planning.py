"""Planning time of a fleet with the certified planner, compiled: `python benchmarks/bench_planning.py [aircraft ...]`.

With `--figure FILE` (png or svg) the times are drawn against the number of aircraft.

A field of buoys 2 km apart, each visited by one aircraft; the aircraft start in a wider field 25 km away, at jittered
positions and altitudes, with headings up to 40 deg off. The separation is 500 m or 150 m, the wind 15 m/s, and the
arrival time common. Prints the time of the first call (with compilation) and of later calls, the number of certified
aircraft, and the number of aircraft in conflict on their cheapest paths.
"""

import argparse
import time
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

from anser.compiling import enable_compilation_cache
from anser.environment import SteadyWind
from anser.numerics.arrays import stack_rows
from anser.parts import make_rendezvous
from anser.planning import PathLimits, Separation
from anser.planning.certified.candidates import fleet_candidates
from anser.planning.certified.certified_plan import choose_interval_count, plan_at
from anser.planning.certified.clearance import BoundingCylinders, Track, bounding_cylinders, fleet_clearance_ratio
from anser.planning.certified.task import AircraftTask, Airspace, KeepOuts
from anser.planning.certified.timed_profiles import MINIMAL, STANDARD
from anser.report.style import new_figure, save_figure

_FLEETS = (3, 10, 30, 100, 300, 1000)
_SPEED = 150.0
_SPACING_M = 2000.0
_WIDER = 1.3
_OFFSET_M = np.array([-20_000.0, 15_000.0])


def fleet(count: int, seed: int = 0) -> tuple[AircraftTask, float]:
    """A fleet and a feasible common arrival time, s."""
    rng = np.random.default_rng(seed)
    side = int(np.ceil(np.sqrt(count)))
    limits = PathLimits(*(jnp.asarray(x) for x in (90.0, 240.0, 0.9, 60.0, 100.0, 9000.0, 4.0, 4.0, 1.5)))
    cells = np.stack([np.arange(count) % side, np.arange(count) // side], axis=1) - 0.5 * (side - 1)
    goals = _SPACING_M * cells
    starts = _WIDER * goals + _OFFSET_M + rng.uniform(-0.35, 0.35, (count, 2)) * _WIDER * _SPACING_M
    farthest = float(np.max(np.linalg.norm(goals - starts, axis=1)))

    def aircraft_task(k: int) -> AircraftTask:
        line = goals[k] - starts[k]
        heading = np.arctan2(line[1], line[0]) + rng.uniform(-0.7, 0.7)
        return AircraftTask(
            position_n=jnp.asarray([*starts[k], -rng.uniform(1000.0, 3000.0)]),
            air_velocity_n=jnp.asarray([_SPEED * np.cos(heading), _SPEED * np.sin(heading), 0.0]),
            air_acceleration_n=jnp.zeros(3),
            goal_position_n=jnp.asarray([*goals[k], 0.0]),
            goal_velocity_n=jnp.zeros(3),
            rendezvous=make_rendezvous(jnp.asarray([0.0, 0.0, -300.0 - 200.0 * (k % 3)])),
            speed=jnp.asarray(_SPEED),
            side=jnp.asarray(0),
            limits=limits,
            roll_rate_max=jnp.asarray(0.35),
            active=jnp.asarray(1.0),
        )

    return stack_rows([aircraft_task(k) for k in range(count)]), 1.3 * farthest / _SPEED


def in_conflict(tasks: AircraftTask, airspace: Airspace, duration: float, intervals: int) -> int:
    """Number of aircraft in conflict if each flies its cheapest path."""

    def cheapest(tasks: AircraftTask) -> tuple[Track, BoundingCylinders]:
        count = tasks.speed.shape[0]
        candidates = fleet_candidates(tasks, airspace, jnp.full(count, duration), intervals, MINIMAL)
        best = jnp.argmin(jnp.where(candidates.valid, candidates.cost, jnp.inf), axis=1)
        tracks = jax.tree.map(lambda leaf: leaf[jnp.arange(count), best], candidates.tracks)
        return tracks, bounding_cylinders(tracks)

    def in_conflict_of(tracks: Track, cylinders: BoundingCylinders) -> jax.Array:
        aircraft_indices = jnp.arange(cylinders.radius.shape[0])

        def one(index: jax.Array) -> jax.Array:
            track, track_cylinders = jax.tree.map(lambda leaf: leaf[index], (tracks, cylinders))
            ratios = fleet_clearance_ratio(
                track,
                track_cylinders,
                cylinders,
                lambda indices: jax.tree.map(lambda leaf: leaf[indices], tracks),
                aircraft_indices != index,
                airspace.separation,
            )
            return jnp.any(ratios < 1.0)

        return jax.lax.map(one, aircraft_indices)

    return int(np.sum(jax.jit(lambda t: in_conflict_of(*cheapest(t)))(tasks)))


def measure(count: int, airspace: Airspace) -> float:
    """Plan a fleet, print a summary line and return the planning time without compilation, s."""
    tasks, duration = fleet(count)
    intervals, durations = choose_interval_count(duration), jnp.full(count, duration)
    for name, candidate_set in (("few", MINIMAL), ("many", STANDARD)):

        def plan(candidate_set=candidate_set):
            return jax.block_until_ready(plan_at(0.0, tasks, airspace, durations, intervals, candidate_set))

        start_time = time.perf_counter()
        result = plan()
        first_s = time.perf_counter() - start_time
        call_seconds = []
        for _ in range(5 if count <= 300 else 2):
            start_time = time.perf_counter()
            result = plan()
            call_seconds.append(time.perf_counter() - start_time)
        certified = int(np.sum(np.asarray(result.feasible)))
        print(
            f"{count:5d} aircraft, {name:4s}: first {first_s:6.1f} s, warm {min(call_seconds):8.4f} s, "
            f"{certified} proven; "
            f"{in_conflict(tasks, airspace, duration, intervals)} would be in conflict",
            flush=True,
        )
        if certified == count:
            return min(call_seconds)
    return float("nan")


def draw(counts: list[int], durations: list[float], path: Path) -> None:
    """Times against the number of aircraft, both logarithmic, with lines of slope 1 and 2."""
    _, figure = new_figure((5.2, 3.4))
    axes = figure.subplots()
    axes.loglog(counts, durations, "o-", color="#0072b2", label="measured")
    grid = np.array([counts[0], counts[-1]], dtype=float)
    for slope, dash in ((1, ":"), (2, "--")):
        axes.loglog(
            grid, durations[0] * (grid / grid[0]) ** slope, dash, color="#777777", label=f"∝ aircraft$^{slope}$"
        )
    for count, time_s in zip(counts, durations, strict=True):
        axes.annotate(f"{time_s:.2g} s", (count, time_s), textcoords="offset points", xytext=(4, -11), fontsize=7)
    axes.set(xlabel="aircraft", xlim=(counts[0] / 1.5, counts[-1] * 2))
    axes.set(ylabel="time to plan, compiled, s", ylim=(min(durations) / 2, max(durations) * 4))
    axes.legend()
    save_figure(figure, [path])


def main(counts: tuple[int, ...], figure: Path | None) -> None:
    """Print one line per fleet; draw the figure."""
    jax.config.update("jax_enable_x64", True)
    enable_compilation_cache()
    airspace = Airspace(
        SteadyWind(jnp.asarray([5.0, 14.0, 0.0])),
        jnp.asarray(9.80665),
        Separation(jnp.asarray(500.0), jnp.asarray(150.0)),
        KeepOuts(*map(jnp.zeros, ((0, 2), (0, 2), 0, 0, 0))),
    )
    durations = [measure(count, airspace) for count in counts]
    if figure is not None:
        draw(list(counts), durations, figure)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("aircraft", type=int, nargs="*", default=list(_FLEETS))
    parser.add_argument("--figure", type=Path)
    options = parser.parse_args()
    main(tuple(options.aircraft), options.figure)
