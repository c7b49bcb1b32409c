"""Cases and oracles shared by the tests of the certified planner."""

import jax
import jax.numpy as jnp
import numpy as np
from scipy.interpolate import BPoly

from anser.environment import LayeredWind, SteadyWind
from anser.numerics.integration import gauss_legendre
from anser.planning.certified.candidates import deliver
from anser.planning.certified.detours import WORDS, detour, direct_path, solve_detour
from anser.planning.certified.profile import make_profile, mean_to_last_speed, tabulate
from anser.planning.certified.routes import PathEndpoints, cis, route

GRAVITY = 9.81
STEADY = SteadyWind(jnp.array([10.0, 5.0, 0.0]))
LAYERED = LayeredWind(
    jnp.array([0.0, 1000.0, 2000.0, 5000.0]),
    jnp.array([[0.0, 0.0, 0.0], [5.0, -5.0, 0.0], [15.0, 0.0, 0.5], [10.0, 10.0, 0.0]]),
)
_RULE = gauss_legendre(48)


def number(x):
    return jnp.asarray(x, dtype=float)


def integrated(start, heading, pieces):
    """Positions and headings after each piece (length, first and last curvature), by Gauss quadrature of the headings.

    48 nodes are exact to rounding for pieces that turn by less than about 15 rad.
    """
    positions, headings = [complex(start)], [float(heading)]
    for length, begin, end in pieces:
        u = length * _RULE.nodes
        course = headings[-1] + begin * u + (0.5 * (end - begin) * u**2 / length if length > 0.0 else 0.0)
        positions.append(positions[-1] + length * np.sum(_RULE.weights * np.exp(1j * course)))
        headings.append(headings[-1] + 0.5 * length * (begin + end))
    return np.array(positions), np.array(headings)


def random_ends(seed, count, near, far, curvature_use=0.9, sharp=4.0, free=False, scale_max=12.0):
    """Stacked endpoints; distances from `near` to `far` least radii, ramps of 1 / `sharp` radius.

    `curvature_use` is the greatest initial curvature, as a fraction of the limit.
    """
    rng = np.random.default_rng(seed)
    radii = rng.uniform(600.0, 3000.0, count)
    start = rng.uniform(-1e4, 1e4, count) + 1j * rng.uniform(-1e4, 1e4, count)
    line = rng.uniform(near, far, count) * radii * np.exp(1j * rng.uniform(-np.pi, np.pi, count))
    return PathEndpoints(
        start=jnp.asarray(start),
        heading=jnp.asarray(rng.uniform(-np.pi, np.pi, count)),
        curvature=jnp.asarray(curvature_use * rng.uniform(-1.0, 1.0, count) / radii),
        end=jnp.asarray(start + line),
        end_heading=jnp.asarray(rng.uniform(-np.pi, np.pi, count)),
        end_free=jnp.full(count, free),
        curvature_max=jnp.asarray(1.0 / radii),
        sharpness=jnp.asarray(sharp / radii**2),
        scale_max=jnp.full(count, scale_max),
    )


_stacked_detours = jax.jit(jax.vmap(detour))


def detours_of(shapes, sides):
    """Stacked detours; the shapes are indices."""
    return _stacked_detours(jnp.asarray(shapes), jnp.asarray(sides, dtype=float))


def picked(tree, k):
    """The k-th member of a stack."""
    return jax.tree.map(lambda leaf: leaf[k], tree)


def _flown(heading, word, angles, straight):
    """End of a path of arcs of unit radius (senses in `word`, 0 is straight), from the origin."""
    position, angles = 0j, list(angles)
    for sense, angle in zip(word, angles, strict=True):
        if sense == 0:
            position += straight * np.exp(1j * heading)
        else:
            position += (np.exp(1j * (heading + sense * angle)) - np.exp(1j * heading)) / (1j * sense)
            heading += sense * angle
    return position, heading


def dubins(start_heading, end, end_heading, radius, three_turns=True):
    """Length of Dubins' shortest path (L. E. Dubins, 1957; forms of Shkel and Lumelsky, 2001), m.

    Parameters
    ----------
    start_heading, end_heading
        Headings, rad.
    end
        From the start, north + i east, m.
    radius
        Least radius, m.
    three_turns
        Whether paths of three turns are included.
    """
    full = 2 * np.pi
    d = abs(end) / radius
    lengths = []
    for mirror in (1.0, -1.0):
        a, b = (mirror * (h - np.angle(end)) for h in (start_heading, end_heading))
        # A turn of sense +1 raises the heading. +0+ and +0-:
        candidates = []
        square = 2 + d * d - 2 * np.cos(a - b) + 2 * d * (np.sin(a) - np.sin(b))
        course = np.arctan2(np.cos(b) - np.cos(a), d + np.sin(a) - np.sin(b))
        candidates.append(((1, 0, 1), ((course - a) % full, 0.0, (b - course) % full), np.sqrt(max(square, 0.0))))
        square = -2 + d * d + 2 * np.cos(a - b) + 2 * d * (np.sin(a) + np.sin(b))
        if square >= 0.0:
            straight = np.sqrt(square)
            course = np.arctan2(-np.cos(a) - np.cos(b), d + np.sin(a) + np.sin(b)) - np.arctan2(-2.0, straight)
            candidates.append(((1, 0, -1), ((course - a) % full, 0.0, (course - b) % full), straight))
        cosine = (6 - d * d + 2 * np.cos(a - b) + 2 * d * (np.sin(a) - np.sin(b))) / 8
        if three_turns and abs(cosine) <= 1.0:
            middle = (full - np.arccos(cosine)) % full
            first_turn = (a - np.arctan2(np.cos(a) - np.cos(b), d - np.sin(a) + np.sin(b)) + 0.5 * middle) % full
            candidates.append(((-1, 1, -1), (first_turn, middle, (a - b - first_turn + middle) % full), 0.0))
        for word, angles, straight in candidates:
            position, heading = _flown(a, word, angles, straight)
            # Whatever is printed in a paper: the path must lead there.
            assert abs(position - d) < 1e-6
            assert abs(np.exp(1j * heading) - np.exp(1j * b)) < 1e-6
            lengths.append(radius * (sum(angles) + straight))
    return min(lengths)


def dubins_of(endpoints, three_turns=True):
    """Dubins' lengths of stacked endpoints."""
    columns = (endpoints.heading, endpoints.end - endpoints.start, endpoints.end_heading, 1.0 / endpoints.curvature_max)
    cases = zip(*map(np.asarray, columns), strict=True)
    return np.array([dubins(start, line, end, radius, three_turns) for start, line, end, radius in cases])


class Dense:
    """A delivered path sampled densely by SciPy's interpolant of its knots, with the demands on its aircraft."""

    def __init__(self, path, wind, step=1e-3):
        times, air, drift = (np.asarray(x) for x in (path.times, path.air_n, path.drift_n))
        real = np.append(True, np.diff(times) > 0.0)
        times, ground = times[real], (air + drift)[real]
        self.path = BPoly.from_derivatives(times, ground)
        self.time = np.arange(times[0], times[-1], step)
        self.position = self.path(self.time)
        self.velocity = self.path.derivative(1)(self.time)
        self.acceleration = self.path.derivative(2)(self.time)
        self.blowing = blowing(wind, -self.position[:, 2])
        drifting = BPoly.from_derivatives(times, drift[real]).derivative(1)(self.time)
        self.wind_error = np.linalg.norm(drifting - self.blowing, axis=1)

    def extremes(self, drag=None):
        """Extremes, named as in `PathBounds`; `drag` returns factor and increment of the drag relative to the start."""
        through, push = self.velocity - self.blowing, self.acceleration
        speed, level = np.linalg.norm(through, axis=1), np.hypot(through[:, 0], through[:, 1])
        side = (through[:, 0] * push[:, 1] - through[:, 1] * push[:, 0]) / level
        forward = (through[:, 0] * push[:, 0] + through[:, 1] * push[:, 1]) / level
        sine, cosine = -through[:, 2] / speed, level / speed
        lift = GRAVITY * cosine - push[:, 2] * cosine - forward * sine
        along = np.sum(through * push, axis=1) / speed + GRAVITY * sine
        share, rise = (1.0, 0.0) if drag is None else drag(speed, np.hypot(side, lift) / GRAVITY)
        return {
            "speed_min": np.min(speed),
            "speed_max": np.max(speed),
            "bank_max": np.max(np.abs(np.arctan2(side, lift))),
            "load_factor_max": np.max(np.hypot(side, lift)) / GRAVITY,
            "load_factor_min": np.min(lift) / GRAVITY,
            "climb_rate_max": np.max(np.abs(through[:, 2])),
            "altitude_min": np.min(-self.position[:, 2]),
            "altitude_max": np.max(-self.position[:, 2]),
            "acceleration_max": np.max(along + rise),
            "deceleration_max": np.max(-along / share),
            "wind_error_max": np.max(self.wind_error),
        }


def blowing(wind, altitudes):
    """Wind at altitudes, by numpy: (altitude, axis)."""
    if isinstance(wind, SteadyWind):
        return np.tile(np.asarray(wind.velocity_n), (altitudes.size, 1))
    layers, velocities = np.asarray(wind.altitudes), np.asarray(wind.velocities_n)
    return np.stack([np.interp(altitudes, layers, velocities[:, k]) for k in range(3)], axis=1)


INTERVALS = 128
START_S = 10.0
FLOWN = {
    "duration": [100.0, 90.0, 140.0, 110.0, 100.0, 120.0],
    "altitude_0": [2500.0, 800.0, 1500.0, 1500.0, 2600.0, 900.0],
    "altitude_1": [800.0, 2400.0, 1500.0, 1450.0, 900.0, 2100.0],
    "climb_0": [0.0, 3.0, 0.0, -1.0, -8.0, 5.0],
    "climb_dot_0": [0.3, -0.2, 0.0, 0.1, 0.0, 0.4],
    "detour": [100.0, 0.0, 0.0, 300.0, 0.0, -200.0],
    "speed_0": [150.0, 160.0, 130.0, 170.0, 150.0, 140.0],
    "speed_dot_0": [0.2, 0.0, 0.0, -0.3, 0.1, 0.0],
    "mean": [150.0, 150.0, 145.0, 150.0, 165.0, 140.0],
    "heading": [0.3, -1.0, 2.5, 0.0, 1.5, -2.0],
    "bend": [0.3, -0.4, 0.0, 0.5, -0.2, 0.1],
    "course": [0.8, -1.6, 2.8, 0.4, 1.0, -1.8],
}
"""Six flights with climbs, descents, 38 deg of bank, deceleration and acceleration; initial and final conditions."""
WAYS = detours_of([0, 2, 3, 0, 4, 1], [-1, 1, -1, -1, -1, -1])
BANK = np.radians(38.0)


def delivered(wind):
    """The flights of `FLOWN` in a wind: endpoints, tabulated profiles, solved detours, routes and delivered paths."""

    def deliver_flight(flight, shape_of_detour):
        final_speed = mean_to_last_speed(flight["mean"], flight["speed_0"], flight["duration"])
        profile = make_profile(
            flight["duration"],
            (flight["altitude_0"], flight["altitude_1"]),
            (flight["climb_0"], 0.0),
            flight["climb_dot_0"],
            flight["detour"],
            (flight["speed_0"], final_speed, final_speed),
            flight["speed_dot_0"],
        )
        table = tabulate(profile, wind, INTERVALS)
        fastest = profile.speed_max
        curvature = jnp.tan(BANK) * GRAVITY / fastest**2
        zero = jnp.zeros(())
        endpoints = PathEndpoints(
            start=jax.lax.complex(zero, zero),
            heading=flight["heading"],
            curvature=flight["bend"] * curvature,
            end=0.87 * table.length * cis(flight["heading"] + 0.2),
            end_heading=flight["course"],
            end_free=jnp.asarray(False),
            curvature_max=curvature,
            sharpness=curvature / (2.0 * fastest),
            scale_max=jnp.ones(()),
        )
        directs = jax.vmap(lambda word: direct_path(endpoints, word))(jnp.asarray(WORDS))
        base = jax.tree.map(lambda leaf: leaf[jnp.argmin(directs.length)], directs)
        solved = solve_detour(endpoints, base, shape_of_detour, table.length)
        shape = route(endpoints, solved)
        return endpoints, table, solved, shape, deliver(START_S, table, shape)

    return jax.vmap(deliver_flight)({name: jnp.asarray(values) for name, values in FLOWN.items()}, WAYS)
