"""Point-mass flight of one aircraft on collocation intervals: unknowns, bounds, and delivered knots."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from trials.data import PlanCase, WindProfile

__all__ = ["HINGE_M", "MID", "NODE", "Flight", "Margins", "Quartics", "air_velocity", "smooth_wind"]

NODE = ("north", "east", "down", "V", "gamma", "chi", "along", "side", "normal")
"""Unknowns of a node: position (m), air velocity (m/s, rad, rad), force per mass without gravity (m/s^2)."""
MID = NODE[3:]
"""Unknowns in the middle of an interval; the position is determined by the nodes."""
HINGE_M = 5.0
"""Height over which the wind's slope changes at a layer, for the solver's second derivatives. The dense check uses the
exact wind, with corners."""
_TURN_SHARE = 14.0
"""Intervals per full turn at the bank limit."""
_WIDTHS_S = (2.0, 6.0)
_INTERVALS = (10, 400)
_GAMMA_MOST = 1.0
_FORCE_MOST = 200.0


@dataclass(frozen=True)
class Margins:
    """Distance of the collocation points from each limit, so that the path between them satisfies the limit too."""

    speed: float = 0.02
    """m/s."""
    bank: float = 2e-3
    """rad."""
    load_factor: float = 2e-3
    """-."""
    climb_rate: float = 0.02
    """m/s."""
    altitude: float = 0.1
    """m."""
    along: float = 5e-3
    """m/s^2."""

    def widened(self, excess: dict[str, float], share: float = 1.3) -> "Margins":
        """Margins increased by a fraction of the excess over each limit, units as in `trials.report.LIMITS`."""

        def more(margin: float, *limits: str) -> float:
            return margin + share * max(0.0, *(excess[limit] for limit in limits))

        return Margins(
            more(self.speed, "speed_min", "speed_max"),
            more(self.bank, "bank_max"),
            more(self.load_factor, "load_factor_max"),
            more(self.climb_rate, "climb_rate_max"),
            more(self.altitude, "altitude_min", "altitude_max"),
            more(self.along, "acceleration_max", "deceleration_max"),
        )


_WIDEST = Margins(speed=0.2, bank=0.03, load_factor=0.05, climb_rate=0.5, altitude=5.0, along=0.05)
"""Widest margins; beyond them, shorter intervals are more effective."""


@dataclass(frozen=True)
class Flight:
    """One aircraft's flight from its start to its rendezvous at a given time.

    Attributes
    ----------
    case, aircraft
        Planning task, and index of the aircraft.
    arrival
        Arrival time, s.
    intervals
        Number of equal intervals, with a node at each end.
    margins
        Margins at nodes and middles.
    """

    case: PlanCase
    aircraft: int
    arrival: float
    intervals: int
    margins: Margins

    @staticmethod
    def of(case: PlanCase, aircraft: int, arrival: float) -> "Flight":
        """Flight with intervals short enough for the turns of this aircraft."""
        L = case.limits
        speed = float(L.speed_min[aircraft])
        lift = min(float(np.tan(L.bank_max[aircraft])), float(L.load_factor_max[aircraft]))
        width = np.clip(2.0 * np.pi * speed / (case.gravity * lift) / _TURN_SHARE, *_WIDTHS_S)
        count = int(np.clip(np.ceil((arrival - case.starts.time) / width), *_INTERVALS))
        return Flight(case, aircraft, arrival, count, Margins())

    @property
    def width(self) -> float:
        """Width of an interval, s."""
        return (self.arrival - self.case.starts.time) / self.intervals

    @property
    def unknowns(self) -> int:
        """Number of unknowns: nodes first, then middles."""
        return len(NODE) * (self.intervals + 1) + len(MID) * self.intervals

    def tightened(self, excess: dict[str, float]) -> "Flight":
        """The flight with margins increased after a dense check; with half intervals if the margins become too wide."""
        wider = self.margins.widened(excess)
        if any(getattr(wider, limit) > widest for limit, widest in vars(_WIDEST).items()):
            return replace(self, intervals=2 * self.intervals)
        return replace(self, margins=wider)

    def split(self, x: Float[np.ndarray, " unknown"]) -> tuple[Float[np.ndarray, "9 node"], Float[np.ndarray, "6 mid"]]:
        """Nodes and middles of unknowns."""
        nodes = len(NODE) * (self.intervals + 1)
        return x[:nodes].reshape(-1, len(NODE)).T, x[nodes:].reshape(-1, len(MID)).T

    def bounds(self) -> tuple[Float[np.ndarray, " unknown"], Float[np.ndarray, " unknown"]]:
        """Lower and upper bounds of the unknowns; equal bounds fix the start and the rendezvous position."""
        case, aircraft, L, m = self.case, self.aircraft, self.case.limits, self.margins
        width = float(L.speed_max[aircraft] - L.speed_min[aircraft])
        speed = min(m.speed, 0.25 * width)
        low = np.array([
            -np.inf, -np.inf, m.altitude - L.altitude_max[aircraft], L.speed_min[aircraft] + speed,
            -_GAMMA_MOST, -np.inf, m.along - L.deceleration_max[aircraft], -_FORCE_MOST, 0.0,
        ])  # fmt: skip
        high = np.array([
            np.inf, np.inf, -m.altitude - L.altitude_min[aircraft], L.speed_max[aircraft] - speed, _GAMMA_MOST, np.inf,
            L.acceleration_max[aircraft] - m.along, _FORCE_MOST, _FORCE_MOST,
        ])  # fmt: skip
        lows, highs = (
            np.concatenate([np.tile(b, self.intervals + 1), np.tile(b[3:], self.intervals)]) for b in (low, high)
        )
        lows[: len(NODE)] = highs[: len(NODE)] = self.first_node()
        last_node = len(NODE) * self.intervals
        lows[last_node : last_node + 3] = highs[last_node : last_node + 3] = case.goals.meeting_n(
            aircraft, np.array([self.arrival])
        )[0]
        return lows, highs

    def first_node(self) -> Float[np.ndarray, "9"]:
        """Unknowns of the first node, from the start's state."""
        case, aircraft, start = self.case, self.aircraft, self.case.starts
        north, east, down = start.velocity_n[aircraft] - smooth_wind(case.wind, -start.position_n[aircraft, 2:])[:, 0]
        speed, chi = float(np.linalg.norm([north, east, down])), float(np.arctan2(east, north))
        gamma = float(-np.arcsin(down / speed))
        force = start.acceleration_n[aircraft] - np.array([0.0, 0.0, case.gravity])
        return np.array([*start.position_n[aircraft], speed, gamma, chi, *(axes(gamma, chi) @ force)])

    def unknowns_of(self, path: "Quartics") -> Float[np.ndarray, " unknown"]:
        """Unknowns of a given path, sampled at the nodes and middles."""
        case = self.case
        times = np.linspace(case.starts.time, self.arrival, 2 * self.intervals + 1)
        position, velocity, acceleration = (path.at(times, order) for order in range(3))
        north, east, down = velocity - smooth_wind(case.wind, -position[2])
        V, chi = np.sqrt(north**2 + east**2 + down**2), np.unwrap(np.arctan2(east, north))
        gamma = -np.arcsin(down / V)
        force = acceleration - np.array([[0.0], [0.0], [case.gravity]])
        force_components = np.stack([axes(g, c) @ f for g, c, f in zip(gamma, chi, force.T, strict=True)], axis=1)
        values = np.stack([*position, V, gamma, chi, *force_components])
        return np.concatenate([values[:, ::2].T.ravel(), values[3:, 1::2].T.ravel()])

    def path(self, x: Float[np.ndarray, " unknown"]) -> "Quartics":
        """Path over the ground."""
        nodes, mids = self.split(x)
        wind = smooth_wind(self.case.wind, -nodes[2])
        velocity = air_velocity(*nodes[3:6]) + wind
        return Quartics(
            self.case.starts.time, self.width, nodes[:3], velocity,
            accelerations(nodes[4:], self.case.gravity), accelerations(mids[1:], self.case.gravity),
        )  # fmt: skip


def smooth_wind(wind: WindProfile, altitude: Float[np.ndarray, " time"]) -> Float[np.ndarray, "3 time"]:
    """Wind whose slope changes smoothly at the layers, as in the solver's equations, NED, m/s."""
    levels, winds = wind.altitudes, wind.velocities_n
    passed = 0.5 * (altitude - levels[:, None] + np.hypot(altitude - levels[:, None], HINGE_M))
    slope = np.diff(winds, axis=0) / np.diff(levels)[:, None]
    return winds[0][:, None] + slope.T @ (passed[:-1] - passed[1:])


def axes(gamma: float, chi: float) -> Float[np.ndarray, "3 3"]:
    """Unit vectors along the air path, to the right and normal to it (upward), as rows, NED."""
    sg, cg, sc, cc = np.sin(gamma), np.cos(gamma), np.sin(chi), np.cos(chi)
    return np.array([[cg * cc, cg * sc, -sg], [-sc, cc, 0.0], [-sg * cc, -sg * sc, -cg]])


def air_velocity(
    V: Float[np.ndarray, " time"], gamma: Float[np.ndarray, " time"], chi: Float[np.ndarray, " time"]
) -> Float[np.ndarray, "3 time"]:
    """Velocity relative to the air, NED, m/s."""
    return V * np.stack([np.cos(gamma) * np.cos(chi), np.cos(gamma) * np.sin(chi), -np.sin(gamma)])


def accelerations(motion: Float[np.ndarray, "5 time"], gravity: float) -> Float[np.ndarray, "3 time"]:
    """Acceleration over the ground, NED, m/s^2, from gamma, chi and the force per mass (along, side, normal)."""
    by_axis = np.stack([axes(gamma, chi) for gamma, chi in motion[:2].T], axis=2)
    return np.einsum("kat,kt->at", by_axis, motion[2:]) + np.array([[0.0], [0.0], [gravity]])


@dataclass(frozen=True)
class Quartics:
    """Path with quadratic acceleration in each interval, given at both ends and the middle: Hermite-Simpson."""

    begin: float
    """Start time, s."""
    width: float
    """Width of an interval, s."""
    position: Float[np.ndarray, "3 node"]
    velocity: Float[np.ndarray, "3 node"]
    acceleration: Float[np.ndarray, "3 node"]
    middle: Float[np.ndarray, "3 interval"]
    """Acceleration in the middle of each interval."""

    def at(self, times: Float[np.ndarray, " time"], order: int = 0) -> Float[np.ndarray, "3 time"]:
        """Position, NED, m, or its derivative of an order up to 2; constant before and after the flight."""
        share = np.clip((times - self.begin) / self.width, 0.0, self.middle.shape[1])
        k = np.minimum(share.astype(int), self.middle.shape[1] - 1)
        s, h = share - k, self.width
        shapes = (
            (s**2 / 2 - s**3 / 2 + s**4 / 6, 2 * s**3 / 3 - s**4 / 3, s**4 / 6 - s**3 / 6),
            (s - 3 * s**2 / 2 + 2 * s**3 / 3, 2 * s**2 - 4 * s**3 / 3, 2 * s**3 / 3 - s**2 / 2),
            (1 - 3 * s + 2 * s**2, 4 * s - 4 * s**2, 2 * s**2 - s),
        )[order]
        forces = (self.acceleration[:, k], self.middle[:, k], self.acceleration[:, k + 1])
        value = h ** (2 - order) * (shapes[0] * forces[0] + shapes[1] * forces[1] + shapes[2] * forces[2])
        if order == 2:
            return value
        value = value + self.velocity[:, k] * (h * s if order == 0 else 1.0)
        return value + self.position[:, k] if order == 0 else value

    def knots(self) -> tuple[Float[np.ndarray, " knot"], Float[np.ndarray, "knot 3 3"]]:
        """Times and derivatives [order, axis] at the nodes; the quartics between them are exact quintic cells."""
        times = self.begin + self.width * np.arange(self.position.shape[1])
        return times, np.stack([self.position, self.velocity, self.acceleration]).transpose(2, 0, 1)
