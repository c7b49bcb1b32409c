"""Random flights that end near the rendezvous: initial values of the collocation."""

import numpy as np
from jaxtyping import Float

from trials.flight import Flight

__all__ = ["sample_flight"]

_SAMPLES = 300
_ELITE = 30
_SEGMENTS, _SEGMENT_S = (6, 20), 50.0
"""Of steady turn: least and greatest number, and about how long, s. Parameters after them: two airspeeds, height."""
_FIRST_SPREAD = (0.15, 0.4, 0.8)
_LEFT_SPREAD = 0.05
_HEIGHT_M = 800.0


def sample_flight(
    flight: Flight,
    rng: np.random.Generator,
    tracks: list[tuple[Float[np.ndarray, "3 node"], float, float]],
    rounds: int = 5,
) -> Float[np.ndarray, " unknown"]:
    """Draw the unknowns of a flight that ends near its rendezvous.

    Parameters
    ----------
    flight
        The flight to sample.
    rng
        Random generator.
    tracks
        Cylinders to avoid if possible: centres (NED, m) at the nodes' times, radius and half height, m.
    rounds
        Number of rounds of the cross-entropy method.

    Notes
    -----
    Piecewise constant turn rate, airspeed with one change, height linear to the rendezvous plus a hump: sampled from a
    normal distribution that moves to the best samples round by round (cross-entropy method). The initial distribution
    is random too, for a variety of flights. The remaining miss is distributed over the path.
    """
    segments = int(np.clip((flight.arrival - flight.case.starts.time) / _SEGMENT_S, *_SEGMENTS))
    mean = rng.normal(0.0, 0.5 * rng.random(), segments + 3)
    if rng.random() < 0.4:
        mean[:segments] = rng.choice([-1.0, 1.0]) * rng.uniform(0.2, 1.0)
    mean[-2] = rng.uniform(-1.0, 1.0)
    mean[-1] *= rng.random() < 0.5
    spread = np.full(mean.size, rng.choice(_FIRST_SPREAD))
    best = mean
    cost_min = np.inf
    for _ in range(rounds):
        samples = mean + spread * rng.normal(size=(_SAMPLES, mean.size))
        cost = _cost(flight, _fly(flight, samples), tracks)
        order = np.argsort(cost)[:_ELITE]
        if cost[order[0]] < cost_min:
            best, cost_min = samples[order[0]], cost[order[0]]
        mean, spread = samples[order].mean(axis=0), np.maximum(samples[order].std(axis=0), _LEFT_SPREAD)
    return _unknowns(flight, _fly(flight, best[None]))


def _fly(flight: Flight, samples: Float[np.ndarray, "sample parameter"]) -> dict[str, np.ndarray]:
    """Node and middle values (sample, 2 intervals + 1) of flights from sampled parameters."""
    case, aircraft, L, start = flight.case, flight.aircraft, flight.case.limits, flight.first_node()
    count = 2 * flight.intervals + 1
    share = np.linspace(0.0, 1.0, count)
    step = 0.5 * flight.width
    samples = np.clip(samples, -1.0, 1.0)
    turn = samples[:, np.minimum((share * (samples.shape[1] - 3)).astype(int), samples.shape[1] - 4)]
    middle, half = (
        0.5 * (L.speed_max[aircraft] + L.speed_min[aircraft]),
        0.45 * (L.speed_max[aircraft] - L.speed_min[aircraft]),
    )
    target_speed = middle + half * np.where(share < 0.5, samples[:, -3, None], samples[:, -2, None])
    rate = 0.4 * min(float(L.acceleration_max[aircraft]), float(L.deceleration_max[aircraft])) * step
    V = np.empty(turn.shape)
    V[:, 0] = start[3]
    for k in range(1, count):
        V[:, k] = V[:, k - 1] + np.clip(target_speed[:, k] - V[:, k - 1], -rate, rate)
    end_altitudes = -start[2], -case.goals.meeting_n(aircraft, np.array([flight.arrival]))[0, 2]
    hump = samples[:, -1, None] * _HEIGHT_M * np.sin(np.pi * share) ** 2
    altitude = end_altitudes[0] + (end_altitudes[1] - end_altitudes[0]) * (3.0 * share**2 - 2.0 * share**3) + hump
    altitude = np.clip(altitude, L.altitude_min[aircraft], L.altitude_max[aircraft])
    climb = np.gradient(altitude, step, axis=1)
    gamma = np.arcsin(np.clip(climb, -L.climb_rate_max[aircraft], L.climb_rate_max[aircraft]) / V)
    lift = min(np.tan(float(L.bank_max[aircraft])), np.sqrt(max(float(L.load_factor_max[aircraft]) ** 2 - 1.0, 1e-3)))
    chi_rate = 0.9 * turn * lift * case.gravity / V
    chi_rate[:, :2] = 0.0
    chi = start[5] + np.cumsum(chi_rate, axis=1) * step
    wind = case.wind.at(altitude)
    speed = V * np.cos(gamma)
    velocity = np.stack([speed * np.cos(chi) + wind[0], speed * np.sin(chi) + wind[1]])
    moved = np.zeros((2, *V.shape))
    moved[:, :, 1:] = np.cumsum(0.5 * step * (velocity[:, :, 1:] + velocity[:, :, :-1]), axis=2)
    positions = np.concatenate([start[:2, None, None] + moved, -altitude[None]])
    return {"place": positions, "V": V, "gamma": gamma, "chi": chi, "chi_rate": chi_rate, "velocity": velocity}


def _cost(
    flight: Flight, flown: dict[str, np.ndarray], tracks: list[tuple[Float[np.ndarray, "3 node"], float, float]]
) -> Float[np.ndarray, " sample"]:
    """Miss at arrival, km, plus course error and fraction of time inside cylinders."""
    case, aircraft, positions = flight.case, flight.aircraft, flown["place"]
    rendezvous = case.goals.meeting_n(aircraft, np.array([flight.arrival]))[0]
    cost = np.hypot(positions[0, :, -1] - rendezvous[0], positions[1, :, -1] - rendezvous[1]) / 1000.0
    course = float(case.goals.course[aircraft])
    if np.isfinite(course):
        north, east = flown["velocity"][:, :, -1]
        cost = cost + 1.0 - np.cos(np.arctan2(east, north) - course)
    for centre, radius, half in tracks:
        offset = positions[:, :, ::2] - centre[:, None]
        depth = np.minimum(1.0 - np.hypot(offset[0], offset[1]) / radius, 1.0 - np.abs(offset[2]) / half)
        cost = cost + 20.0 * np.mean(np.maximum(depth, 0.0), axis=1)
    return cost


def _unknowns(flight: Flight, flown: dict[str, np.ndarray]) -> Float[np.ndarray, " unknown"]:
    """Unknowns of a single flight, with the miss distributed over the path."""
    case, g = flight.case, flight.case.gravity
    position, V, gamma, chi = flown["place"][:, 0], flown["V"][0], flown["gamma"][0], flown["chi"][0]
    share = np.linspace(0.0, 1.0, V.size)
    miss = case.goals.meeting_n(flight.aircraft, np.array([flight.arrival]))[0] - position[:, -1]
    position = position + miss[:, None] * share
    step = 0.5 * flight.width
    along = np.gradient(V, step) + g * np.sin(gamma)
    normal = g * np.cos(gamma) + V * np.gradient(gamma, step)
    values = np.stack([*position, V, gamma, chi, along, V * np.cos(gamma) * flown["chi_rate"][0], normal])
    return np.concatenate([values[:, ::2].T.ravel(), values[3:, 1::2].T.ravel()])
