"""Random tasks of three aircraft with a descent to rendezvous above boats, planned as published."""

import numpy as np

import anser

_START_MAX_M = 15_000.0
_NEAREST = 0.25  # of that distance
_DESCENT_MAX_M = 5_000.0
MILD = 100
"""First seed of the mild tasks: similar distances, descents of at most 2.5 km, starts toward the goals."""


def descending_task(seed, duration_s=220.0):
    """Text of a scenario: starts within 15 km, up to 5 km above rendezvous 150 to 600 m above boats.

    Every task has three aircraft, so that one compiled program is sufficient. Many plans cannot be flown, for example a
    descent of 5 km over 4 km.
    """
    rng = np.random.default_rng([19, seed])
    speed = rng.uniform(120.0, 200.0)
    lines = [
        "format = 1",
        f'name = "descent-{seed}"',
        "[timing]",
        f"duration_s = {duration_s}",
        "record_period_s = 1.0",
        "[fleet]",
        f"speed_m_s = {speed:.3f}",
        "[wind]",
        f"speed_m_s = {rng.uniform(0.0, 12.0):.3f}",
        f"from_deg = {rng.uniform(0.0, 360.0):.3f}",
        "[hold]",
        f"radius_m = {rng.uniform(3000.0, 6000.0):.1f}",
        f'direction = "{rng.choice(["right", "left"])}"',
    ]
    for k in range(3):
        up = rng.uniform(150.0, 600.0)
        distance, bearing = _START_MAX_M * np.sqrt(rng.uniform(_NEAREST**2, 1.0)), rng.uniform(0.0, 360.0)
        descent = rng.uniform(0.0, _DESCENT_MAX_M)
        aside = rng.uniform(-60.0, 60.0)
        if seed >= MILD:
            distance, descent, aside = 10_000.0 + distance / 3, descent / 2, aside / 4
        course = bearing + 180.0 + aside
        lines += [
            "[[aircraft]]",
            f'name = "aircraft-{k + 1}"',
            f'goal = "boat-{k + 1}"',
            f"start = {{ north_m = {distance * np.cos(np.radians(bearing)):.1f}, "
            f"east_m = {distance * np.sin(np.radians(bearing)):.1f}, altitude_m = {up + descent:.1f}, "
            f"speed_m_s = {speed * rng.uniform(0.9, 1.1):.3f}, course_deg = {(course + 180.0) % 360.0 - 180.0:.2f} }}",
            f"rendezvous = {{ stand_off_up_m = {up:.1f}, stand_off_north_m = {rng.uniform(-500.0, 500.0):.1f}, "
            f"stand_off_east_m = {rng.uniform(-500.0, 500.0):.1f} }}",
        ]
    for k in range(3):
        lines += [
            "[[goal]]",
            f'name = "boat-{k + 1}"',
            'kind = "surface"',
            f"north_m = {rng.uniform(-2000.0, 2000.0):.1f}",
            f"east_m = {rng.uniform(-2000.0, 2000.0):.1f}",
            f"speed_m_s = {rng.uniform(0.0, 20.0):.3f}",
            f"course_deg = {rng.uniform(-180.0, 180.0):.2f}",
        ]
    return "\n".join(lines) + "\n"


def flown_descent(seed):
    """Fly a task; return the announcement of its plan, the final statuses, and the lowest altitudes, m."""
    flown = anser.run(anser.loads(descending_task(seed)))
    return {
        "seed": seed,
        "met": flown.met,
        "problems": [problem.split(": ", 1)[1] for problem in flown.planned.problems()],
        "status": [aircraft["status"] for aircraft in flown.summary["aircraft"]],
        "arrived": [bool(arrived) for arrived in (flown.dataset["phase"].values == 2).any(axis=0)],
        "lowest_m": [round(float(low), 1) for low in flown.dataset["altitude_m"].min("time")],
        "text": str(flown).splitlines()[0],
    }
