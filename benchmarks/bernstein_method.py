"""The method of BeBOT, reimplemented: Bernstein polynomials in time, limits on elevated coefficients, SLSQP.

Kielas-Jensen, Cichella, Berry, Kaminer, Walton, Pascoal, "Bernstein Polynomial-Based Method for Solving Optimal
Trajectory Generation Problems", Sensors 22 (2022) 1869. The polynomial arithmetic is Farouki, "The Bernstein polynomial
basis: A centennial retrospective" (2012), section 5.
"""

import math
import time
from dataclasses import dataclass
from functools import cache
from itertools import combinations

import numpy as np
from airliners_example import Example, Flown
from scipy.interpolate import BPoly
from scipy.optimize import OptimizeResult, minimize

COMPLEX_STEP = 1e-30  # a complex step takes no difference, so that no digits cancel


@dataclass(frozen=True)
class BernsteinPlan:
    """Result of the Bernstein method."""

    points_m: np.ndarray
    """(aircraft, axis, degree + 1): control points."""
    durations_s: np.ndarray
    seconds: float
    """Wall time of the solver alone."""
    iterations: int
    converged: bool
    message: str

    def flown(self) -> Flown:
        """Evaluate the plan by SciPy's own Bernstein polynomials, for the dense check."""
        curves = [
            BPoly(points.T[:, None], [0.0, duration])
            for points, duration in zip(self.points_m, self.durations_s, strict=True)
        ]
        return Flown(self.durations_s, lambda i, t: tuple(curves[i](t, nu=order) for order in range(3)))


@cache
def _product(m: int, n: int, degree: int) -> np.ndarray:
    """Matrix ((m + 1)(n + 1), degree + 1) of the product of two Bernstein polynomials, elevated to a degree."""
    tensor = np.zeros((m + 1, n + 1, degree + 1))
    for i in range(m + 1):
        for j in range(n + 1):
            weight = math.comb(m, i) * math.comb(n, j)
            for k in range(i + j, degree - (m + n) + i + j + 1):
                tensor[i, j, k] = weight * math.comb(degree - m - n, k - i - j) / math.comb(degree, k)
    return tensor.reshape(-1, degree + 1)


def multiply(a: np.ndarray, b: np.ndarray, degree: int) -> np.ndarray:
    """Multiply polynomials (..., m + 1) and (..., n + 1): coefficients (..., degree + 1) of the product at a degree."""
    outer = a[..., :, None] * b[..., None, :]
    return outer.reshape(*outer.shape[:-2], -1) @ _product(a.shape[-1] - 1, b.shape[-1] - 1, degree)


def differentiate(points: np.ndarray, duration: np.ndarray) -> np.ndarray:
    """Coefficients of the time derivative, (..., n), from those of a polynomial, (..., n + 1), over a duration, s."""
    return (points.shape[-1] - 1) * np.diff(points) / duration[..., None]


def restrict(points: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Coefficients (..., n + 1) of the first part of a polynomial, up to the fraction `end` (...) of its duration."""
    n = points.shape[-1] - 1
    coefficients = []
    for i in range(n + 1):
        weights = [math.comb(i, j) * end**j * (1 - end) ** (i - j) for j in range(i + 1)]
        coefficients.append(sum(weight * points[..., j] for j, weight in enumerate(weights)))
    return np.stack(coefficients, axis=-1)


class BernsteinProblem:
    """The example as a nonlinear program; the unknowns are the inner control points and the flight times.

    The first two and last two control points follow from the end states. Without `scaled` everything is as published:
    metres from the origin of the projection, seconds, and SciPy's forward differences. With `scaled` the same method is
    better conditioned: unknowns of order one (in `LENGTH_M` from the middle of each leg, and in `TIME_S`), constraints
    relative to their limits, and the exact Jacobian.
    """

    LENGTH_M, TIME_S = 1e6, 1e4

    def __init__(self, example: Example, *, scaled: bool):
        self.example, self.scaled = example, scaled
        self.count = len(example.names)
        self.free = example.degree - 3
        self.pairs = np.array(list(combinations(range(self.count), 2))).T
        self.bound_degree = 2 * example.degree + example.elevation
        middle = (example.start_m + example.goal_m) / 2
        self.origin = np.repeat(middle, self.free, axis=-1).ravel() if scaled else 0.0
        self.length, self.time = (self.LENGTH_M, self.TIME_S) if scaled else (1.0, 1.0)

    def unpack(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Control points (..., aircraft, 2, degree + 1), m, and flight times (..., aircraft), s, of unknowns."""
        example, lead = self.example, x.shape[:-1]
        durations = x[..., -self.count :] * self.time
        inner = (x[..., : -self.count] * self.length + self.origin).reshape(*lead, self.count, 2, self.free)
        step = durations[..., None] / example.degree
        start = np.broadcast_to(example.start_m, inner.shape[:-1])
        goal = np.broadcast_to(example.goal_m, inner.shape[:-1])
        end_points = (start, start + step * example.start_velocity_m_s, goal - step * example.goal_velocity_m_s, goal)
        start_point, second_point, last_but_one, goal_point = (point[..., None] for point in end_points)
        return np.concatenate([start_point, second_point, inner, last_but_one, goal_point], axis=-1), durations

    def guess(self) -> np.ndarray:
        """Straight lines between the second and the penultimate control points, at the middle of the speed range."""
        example = self.example
        speed = (example.speed_min_m_s + example.speed_max_m_s) / 2
        durations = np.linalg.norm(example.goal_m - example.start_m, axis=1) / speed
        step = durations[:, None] / example.degree
        second_point = example.start_m + step * example.start_velocity_m_s
        penultimate_point = example.goal_m - step * example.goal_velocity_m_s
        inner = np.linspace(second_point, penultimate_point, example.degree - 1, axis=-1)[..., 1:-1].ravel()
        return np.concatenate([(inner - self.origin) / self.length, durations / self.time])

    def cost(self, x: np.ndarray) -> float:
        """Sum of the flight times."""
        return float(x[-self.count :].sum())

    def cost_gradient(self, x: np.ndarray) -> np.ndarray:
        """Gradient of the cost."""
        return np.concatenate([np.zeros(x.size - self.count), np.ones(self.count)])

    def constraints(self, x: np.ndarray) -> np.ndarray:
        """Constraints (at least 0): elevated coefficients of speed squared, turn rate and distance squared."""
        example, degree, lead = self.example, self.bound_degree, x.shape[:-1]
        points, durations = self.unpack(x)
        over = durations[..., None]
        velocity = differentiate(points, over)
        acceleration = differentiate(velocity, over)
        speed2 = multiply(velocity, velocity, degree).sum(-2)
        across = multiply(velocity[..., 0, :], acceleration[..., 1, :], degree)
        across = across - multiply(velocity[..., 1, :], acceleration[..., 0, :], degree)
        # a rational polynomial with positive weights (here of speed squared) lies between its coefficients
        rate = across / speed2

        duration_i, duration_j = durations[..., self.pairs[0]], durations[..., self.pairs[1]]
        common = np.where(np.real(duration_i) <= np.real(duration_j), duration_i, duration_j)
        path_i = restrict(points[..., self.pairs[0], :, :], (common / duration_i)[..., None])
        path_j = restrict(points[..., self.pairs[1], :, :], (common / duration_j)[..., None])
        distance2 = multiply(path_i - path_j, path_i - path_j, degree).sum(-2)

        speed_unit = example.speed_max_m_s**2 if self.scaled else 1.0
        rate_unit = example.turn_rate_max_rad_s if self.scaled else 1.0
        parts = (
            (speed2 - example.speed_min_m_s**2) / speed_unit,
            (example.speed_max_m_s**2 - speed2) / speed_unit,
            (example.turn_rate_max_rad_s - rate) / rate_unit,
            (rate + example.turn_rate_max_rad_s) / rate_unit,
            (distance2 - example.separation_m**2) / self.length**2,
        )
        return np.concatenate([part.reshape(*lead, -1) for part in parts], axis=-1)

    def constraint_jacobian(self, x: np.ndarray) -> np.ndarray:
        """Exact Jacobian (constraints, unknowns) by one complex step per unknown."""
        return np.imag(self.constraints(x + 1j * COMPLEX_STEP * np.eye(x.size))).T / COMPLEX_STEP

    def solve(self) -> BernsteinPlan:
        """Run SLSQP from the straight lines, with the tolerance and the iterations of the source."""
        guess = self.guess()
        exact = {"jac": self.constraint_jacobian} if self.scaled else {}
        bounds = [(None, None)] * (guess.size - self.count) + [(0.001, None)] * self.count
        began = time.perf_counter()
        result: OptimizeResult = minimize(
            self.cost,
            guess,
            jac=self.cost_gradient if self.scaled else None,
            bounds=bounds,
            constraints=[{"type": "ineq", "fun": self.constraints, **exact}],
            method="SLSQP",
            options={"maxiter": self.example.iterations_max, "ftol": self.example.cost_tolerance_s / self.time},
        )
        seconds = time.perf_counter() - began
        points, durations = self.unpack(result.x)
        return BernsteinPlan(
            points_m=points,
            durations_s=durations,
            seconds=seconds,
            iterations=int(result.nit),
            converged=bool(result.success),
            message=str(result.message),
        )
