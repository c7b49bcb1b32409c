"""Equation error in the time domain: ordinary, total and stepwise least squares, and regression with prior values.

The response is a linear combination of measured regressors plus an error, which may be coloured: covariances then
follow from the autocorrelation of the residuals (E. A. Morelli, V. Klein, *Accuracy of aerodynamic model parameters
estimated from flight test data*, J. Guidance 20(1), 1997).
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import ArrayLike, Float

from anser.identification.estimates import Collinearity, Estimate, autocovariances, collinearity

CONSTANT = "constant"
"""Name of the parameter of the constant term."""
Matrix = Float[np.ndarray, "sample parameter"]


class Regression(NamedTuple):
    """A linear regression problem: z = X theta + v."""

    names: tuple[str, ...]  # parameters, by the names of their regressors
    X: Matrix  # regressors; the column of `CONSTANT` is 1
    z: Float[np.ndarray, " sample"]
    time_s: Float[np.ndarray, " sample"] | None  # times of a uniformly sampled record; None: independent samples
    response: str  # name of z

    def information(self) -> Float[np.ndarray, "parameter parameter"]:
        """Return X^T X, with the constant term eliminated from the remaining parameters (deviations from the mean)."""
        X = self.X.copy()
        if self.names[-1] == CONSTANT:
            X[:, :-1] -= np.mean(X[:, :-1], axis=0)
            X[:, :-1][:, np.ptp(self.X[:, :-1], axis=0) == 0.0] = 0.0  # without the rounding of the mean
        return X.T @ X

    def subset(self, names: Sequence[str]) -> "Regression":
        """Return the problem with these parameters only."""
        return self._replace(names=tuple(names), X=self.X[:, [self.names.index(name) for name in names]])


def prepare_regression(
    regressors: Mapping[str, ArrayLike],
    response: ArrayLike,
    time_s: ArrayLike | None = None,
    *,
    response_name: str = "response",
    constant: bool = True,
) -> Regression:
    """Check the measured series and arrange a regression problem.

    Parameters
    ----------
    regressors
        Series by name, shape (sample,).
    response
        Series to be explained, shape (sample,).
    time_s
        Times of a uniformly sampled record, s; None: the samples are independent, their order has no meaning.
    response_name
        Name of the response, for labels.
    constant
        Whether a constant term, named `constant`, is added.

    Raises
    ------
    ValueError
        A series has another length, a number that is not finite, or no more samples than parameters; or a regressor
        of a record is white noise (no excitation).
    """
    series = {name: np.asarray(values, dtype=float) for name, values in {**regressors, response_name: response}.items()}
    z = series[response_name]
    if len(series) != len(regressors) + 1 or not regressors or CONSTANT in series:
        raise ValueError(f"regressors: arrived {list(regressors)}; expected names, none {response_name} or {CONSTANT}")
    for name, values in series.items():
        if values.shape != z.shape or values.ndim != 1:
            raise ValueError(
                f"{name}: arrived an array of shape {values.shape}; expected ({z.size},), like the response"
            )
        if not np.all(np.isfinite(values)):
            count = int(np.sum(~np.isfinite(values)))
            raise ValueError(f"{name}: arrived {count} samples of {values.size} that are not finite; expected numbers")
    times = None if time_s is None else _uniform_times(time_s, z.size)
    columns = {name: series[name] for name in regressors}
    if times is not None:
        for name, values in columns.items():
            _require_excitation(name, values)
    if constant:
        columns[CONSTANT] = np.ones_like(z)
    if z.size <= len(columns):
        raise ValueError(
            f"{response_name}: arrived {z.size} samples for {len(columns)} parameters; expected more samples"
        )
    return Regression(tuple(columns), np.stack(list(columns.values()), axis=1), z, times, response_name)


def _uniform_times(time_s: ArrayLike, count: int) -> Float[np.ndarray, " sample"]:
    times = np.asarray(time_s, dtype=float)
    if times.shape != (count,) or not np.all(np.isfinite(times)):
        raise ValueError(f"time_s: arrived an array of shape {times.shape}; expected ({count},) finite times, s")
    steps = np.diff(times)
    if not (np.all(steps > 0.0) and np.ptp(steps) <= 1e-3 * np.mean(steps)):
        raise ValueError(
            f"time_s: arrived steps from {np.min(steps):g} to {np.max(steps):g} s; expected equal steps: a record "
            "that is resampled"
        )
    return times


def _require_excitation(name: str, values: Float[np.ndarray, " sample"]) -> None:
    """Refuse a series in which the noise, estimated from third differences, is half of the variance or more."""
    noise = np.mean(np.diff(values, 3) ** 2) / 20.0  # 1 + 9 + 9 + 1: gain of third differences on white noise
    variance = np.var(values)
    if variance > 0.0 and noise > 0.5 * variance:
        raise ValueError(
            f"{name}: no excitation: {100.0 * min(noise / variance, 1.0):.0f} % of the variance is white noise; "
            "expected a manoeuvre that moves it well above its noise"
        )


def regress(
    regressors: Mapping[str, ArrayLike],
    response: ArrayLike,
    time_s: ArrayLike | None = None,
    *,
    response_name: str = "response",
    constant: bool = True,
) -> Estimate:
    """Estimate parameters by ordinary least squares; arguments and errors as for `prepare_regression`.

    The covariance is corrected for coloured residuals if the samples are a record in time.

    Raises
    ------
    ValueError
        The regressors are singular or nearly collinear; the message names the regressors concerned.
    """
    problem = prepare_regression(regressors, response, time_s, response_name=response_name, constant=constant)
    return solve_ordinary(problem, "equation error, ordinary least squares")


def solve_ordinary(problem: Regression, method: str, notes: tuple[str, ...] = ()) -> Estimate:
    """Solve a regression problem by ordinary least squares: see `regress`."""
    checked = collinearity(problem.information(), problem.names)
    values = np.linalg.lstsq(problem.X, problem.z, rcond=None)[0]
    inverse = np.linalg.inv(problem.X.T @ problem.X)
    errors = sandwich(problem, problem.X, problem.z - problem.X @ values, inverse)
    return _estimate(problem, method, values, errors, checked, notes)


def _estimate(
    problem: Regression,
    method: str,
    values: Float[np.ndarray, " parameter"],
    errors: "ErrorCovariance",
    checked: Collinearity,
    notes: tuple[str, ...],
) -> Estimate:
    return Estimate(
        method=method,
        names=problem.names,
        values=values,
        covariance=errors.covariance,
        degrees_of_freedom=float(errors.degrees_of_freedom),
        responses=(problem.response,),
        measured=problem.z[:, None],
        fitted=(problem.X @ values)[:, None],
        sample_points=np.arange(problem.z.size, dtype=float) if problem.time_s is None else problem.time_s,
        condition_number=checked.condition_number,
        variance_inflation=checked.variance_inflation,
        notes=notes,
    )


class ErrorCovariance(NamedTuple):
    """Covariance of estimated parameters, and the degrees of freedom of the variance of the errors behind it."""

    covariance: Float[np.ndarray, "parameter parameter"]
    degrees_of_freedom: float


def sandwich(
    problem: Regression,
    X: Matrix,
    residuals: Float[np.ndarray, " sample"],
    inverse: Float[np.ndarray, "parameter parameter"],
) -> ErrorCovariance:
    """Compute the covariance A^-1 X^T Gamma X A^-1, with the covariance Gamma of the errors from the residuals.

    In a record, Gamma has the autocovariances up to `lag_max`, tapered to zero (M. S. Bartlett, 1950), so that its
    spectrum has 3 samples / lags degrees of freedom. The fit removes the errors' spectrum near the frequencies of the
    regressors from the residuals: each variance is divided by the share that would remain of white errors. Without
    times the errors are independent.

    Parameters
    ----------
    problem
        The regression.
    X
        Factors of the errors in the estimate; for ordinary least squares the regressors.
    residuals
        Estimated errors v.
    inverse
        A^-1, the inverse of X^T X for ordinary least squares.
    """
    count, parameters = X.shape
    if problem.time_s is None:
        variance = residuals @ residuals / (count - parameters)
        return ErrorCovariance(variance * inverse @ (X.T @ X) @ inverse, count - parameters)
    lag_max = min(count // 5, int(4.0 * np.sqrt(count)))
    gamma = autocovariances(residuals[:, None], lag_max)[:, 0]
    square = X.T @ X
    total, white = gamma[0] * square, (1.0 - parameters / count) * square
    for lag in range(1, lag_max + 1):
        weight = 1.0 - lag / (lag_max + 1)
        products = X[:-lag].T @ X[lag:]
        products = weight * (products + products.T)
        total = total + gamma[lag] * products
        white = white - np.sum(inverse * products) / (2.0 * weight * count) * products
    remaining = np.diag(inverse @ white @ inverse) / np.diag(inverse @ square @ inverse)
    scale = 1.0 / np.sqrt(np.clip(remaining, 0.1, 1.0))
    covariance = scale[:, None] * (inverse @ total @ inverse) * scale
    return ErrorCovariance(covariance, min(count - parameters, 3.0 * count / lag_max))
