"""Random flights that end near the rendezvous: what the collocation starts from."""

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
    """Draw unknowns of a flight that nearly arrives.

    Parameters
    ----------
    flight
        Which.
    rng
        Source of all that is random.
    tracks
        Cylinders to avoid if possible: centres (NED, m) at the nodes' times, radius and half height, m.
    rounds
        Of the cross-entropy method.

    Notes
    -----
    Turn rate steady by segments, airspeed with one change, height linear to the rendezvous with a hump: sampled from a
    normal distribution that is moved to the best samples round by round (cross-entropy method). Where it begins is
    random too, so that different flights come of it. What is left of the miss is spread over the path.
    """
    segments = int(np.clip((flight.arrival - flight.case.starts.time) / _SEGMENT_S, *_SEGMENTS))
    mean = rng.normal(0.0, 0.5 * rng.random(), segments + 3)
    if rng.random() < 0.4:
        mean[:segments] = rng.choice([-1.0, 1.0]) * rng.uniform(0.2, 1.0)
    mean[-2] = rng.uniform(-1.0, 1.0)
    mean[-1] *= rng.random() < 0.5
    spread = np.full(mean.size, rng.choice(_FIRST_SPREAD))
    best = mean
    least = np.inf
    for _ in range(rounds):
        drawn = mean + spread * rng.normal(size=(_SAMPLES, mean.size))
        cost = _cost(flight, _fly(flight, drawn), tracks)
        order = np.argsort(cost)[:_ELITE]
        if cost[order[0]] < least:
            best, least = drawn[order[0]], cost[order[0]]
        mean, spread = drawn[order].mean(axis=0), np.maximum(drawn[order].std(axis=0), _LEFT_SPREAD)
    return _unknowns(flight, _fly(flight, best[None]))


def _fly(flight: Flight, drawn: Float[np.ndarray, "sample parameter"]) -> dict[str, np.ndarray]:
    """Node and middle values (sample, 2 intervals + 1) of flights by their parameters."""
    case, who, L, start = flight.case, flight.who, flight.case.limits, flight.first()
    count = 2 * flight.intervals + 1
    share = np.linspace(0.0, 1.0, count)
    step = 0.5 * flight.width
    drawn = np.clip(drawn, -1.0, 1.0)
    turn = drawn[:, np.minimum((share * (drawn.shape[1] - 3)).astype(int), drawn.shape[1] - 4)]
    middle, half = 0.5 * (L.speed_max[who] + L.speed_min[who]), 0.45 * (L.speed_max[who] - L.speed_min[who])
    wanted = middle + half * np.where(share < 0.5, drawn[:, -3, None], drawn[:, -2, None])
    rate = 0.4 * min(float(L.acceleration_max[who]), float(L.deceleration_max[who])) * step
    V = np.empty(turn.shape)
    V[:, 0] = start[3]
    for k in range(1, count):
        V[:, k] = V[:, k - 1] + np.clip(wanted[:, k] - V[:, k - 1], -rate, rate)
    ends = -start[2], -case.goals.meeting_n(who, np.array([flight.arrival]))[0, 2]
    hump = drawn[:, -1, None] * _HEIGHT_M * np.sin(np.pi * share) ** 2
    altitude = ends[0] + (ends[1] - ends[0]) * (3.0 * share**2 - 2.0 * share**3) + hump
    altitude = np.clip(altitude, L.altitude_min[who], L.altitude_max[who])
    climb = np.gradient(altitude, step, axis=1)
    gamma = np.arcsin(np.clip(climb, -L.climb_rate_max[who], L.climb_rate_max[who]) / V)
    lift = min(np.tan(float(L.bank_max[who])), np.sqrt(max(float(L.load_factor_max[who]) ** 2 - 1.0, 1e-3)))
    chi_rate = 0.9 * turn * lift * case.gravity / V
    chi_rate[:, :2] = 0.0
    chi = start[5] + np.cumsum(chi_rate, axis=1) * step
    wind = case.wind.at(altitude)
    speed = V * np.cos(gamma)
    velocity = np.stack([speed * np.cos(chi) + wind[0], speed * np.sin(chi) + wind[1]])
    moved = np.zeros((2, *V.shape))
    moved[:, :, 1:] = np.cumsum(0.5 * step * (velocity[:, :, 1:] + velocity[:, :, :-1]), axis=2)
    place = np.concatenate([start[:2, None, None] + moved, -altitude[None]])
    return {"place": place, "V": V, "gamma": gamma, "chi": chi, "chi_rate": chi_rate, "velocity": velocity}


def _cost(
    flight: Flight, flown: dict[str, np.ndarray], tracks: list[tuple[Float[np.ndarray, "3 node"], float, float]]
) -> Float[np.ndarray, " sample"]:
    """Miss at arrival in km, course error, and share of the time inside cylinders."""
    case, who, place = flight.case, flight.who, flown["place"]
    there = case.goals.meeting_n(who, np.array([flight.arrival]))[0]
    cost = np.hypot(place[0, :, -1] - there[0], place[1, :, -1] - there[1]) / 1000.0
    course = float(case.goals.course[who])
    if np.isfinite(course):
        north, east = flown["velocity"][:, :, -1]
        cost = cost + 1.0 - np.cos(np.arctan2(east, north) - course)
    for centre, radius, half in tracks:
        apart = place[:, :, ::2] - centre[:, None]
        depth = np.minimum(1.0 - np.hypot(apart[0], apart[1]) / radius, 1.0 - np.abs(apart[2]) / half)
        cost = cost + 20.0 * np.mean(np.maximum(depth, 0.0), axis=1)
    return cost


def _unknowns(flight: Flight, flown: dict[str, np.ndarray]) -> Float[np.ndarray, " unknown"]:
    """Unknowns of a single flight, with its miss spread over it."""
    case, g = flight.case, flight.case.gravity
    place, V, gamma, chi = flown["place"][:, 0], flown["V"][0], flown["gamma"][0], flown["chi"][0]
    share = np.linspace(0.0, 1.0, V.size)
    miss = case.goals.meeting_n(flight.who, np.array([flight.arrival]))[0] - place[:, -1]
    place = place + miss[:, None] * share
    step = 0.5 * flight.width
    along = np.gradient(V, step) + g * np.sin(gamma)
    normal = g * np.cos(gamma) + V * np.gradient(gamma, step)
    rows = np.stack([*place, V, gamma, chi, along, V * np.cos(gamma) * flown["chi_rate"][0], normal])
    return np.concatenate([rows[:, ::2].T.ravel(), rows[3:, 1::2].T.ravel()])
