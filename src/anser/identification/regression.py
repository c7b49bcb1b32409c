"""Equation error in the time domain: ordinary, total and stepwise least squares, and regression with prior values.

The response is a linear combination of measured regressors plus an error. In a record, the error may be coloured, and
the covariance is computed from the autocorrelation of the residuals (E. A. Morelli, V. Klein, *Accuracy of aerodynamic
model parameters estimated from flight test data*, J. Guidance 20(1), 1997).
"""

from collections.abc import Collection, Mapping, Sequence
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import ArrayLike, Float

from anser.identification.estimates import Collinearity, ErrorCovariance, Estimate, collinearity, coloured_covariance

CONSTANT = "constant"
"""Name of the parameter of the constant term."""
Matrix = Float[np.ndarray, "sample parameter"]
Square = Float[np.ndarray, "parameter parameter"]


class Regression(NamedTuple):
    """A linear regression problem z = X theta + v: response z, regressors X, parameters theta, error v.

    `names` are the names of the regressors; the regressor `CONSTANT` is 1. `time_s` are the times of a uniformly
    sampled record, s; None: independent samples. `response` is the name of z. `noise` holds the standard deviations of
    the white noise in the regressors.
    """

    names: tuple[str, ...]
    X: Matrix
    z: Float[np.ndarray, " sample"]
    time_s: Float[np.ndarray, " sample"] | None
    response: str
    noise: Float[np.ndarray, " parameter"]

    def information(self) -> Square:
        """Return X^T X minus the expected contribution of the regressors' noise."""
        return self.X.T @ self.X - len(self.X) * np.diag(self.noise**2)

    def check_collinearity(self) -> Collinearity:
        """Return the collinearity of the noise-free regressors; the means are subtracted if a constant is estimated.

        Raises ValueError if noise is more than half of a regressor's power, or if regressors are collinear.
        """
        X = self.require_excitation()
        return collinearity(X.T @ X - len(X) * np.diag(self.noise**2), self.names)

    def require_excitation(self) -> Matrix:
        """Return the regressors; the means are subtracted if a constant is estimated.

        Raises ValueError if a regressor does not vary, or if more than half of its power is noise. In a record, the
        noise is at least the white noise that the samples show.
        """
        X, noise = self.X.copy(), self.noise**2
        if self.names[-1] == CONSTANT:
            X[:, :-1] -= np.mean(X[:, :-1], axis=0)
            X[:, :-1][:, np.ptp(self.X[:, :-1], axis=0) == 0.0] = 0.0  # without the rounding of the mean
        if self.time_s is not None:
            noise = np.maximum(noise, white_variance(self.X))
        require_signal(self.names, np.sum(X**2, axis=0), len(X) * noise)
        return X

    def error_covariance(self, X: Matrix, residuals: Float[np.ndarray, " sample"], inverse: Square) -> ErrorCovariance:
        """Return the covariance of the parameter errors `inverse` @ X^T v, with the error v of the regression.

        `residuals` are the estimates of v. If `time_s` is None, v counts as white; if not, v may be coloured.
        """
        return coloured_covariance(X[:, None], residuals[:, None], inverse, is_record=self.time_s is not None)

    def subset(self, names: Sequence[str]) -> "Regression":
        """Return the regression problem with the regressors `names` only."""
        columns = [self.names.index(name) for name in names]
        return self._replace(names=tuple(names), X=self.X[:, columns], noise=self.noise[columns])


def require_signal(
    names: Sequence[str], power: Float[np.ndarray, " parameter"], noise: Float[np.ndarray, " parameter"]
) -> None:
    """Raise ValueError if the power of the noise in a regressor is more than half of the regressor's power."""
    weak = [
        f"{name} ({100.0 * n / p:.0f} % noise)" for name, p, n in zip(names, power, noise, strict=True) if n > 0.5 * p
    ]
    if weak:
        raise ValueError(f"regressors: no excitation of {', '.join(weak)}; expected a manoeuvre well above the noise")


def prepare_regression(
    regressors: Mapping[str, ArrayLike],
    response: ArrayLike,
    time_s: ArrayLike | None = None,
    *,
    response_name: str = "response",
    constant: bool = True,
    noise: Mapping[str, float] | None = None,
) -> Regression:
    """Return the regression problem of measured series, after checks of names, shapes and numbers.

    Parameters
    ----------
    regressors
        Series by name, shape (sample,).
    response
        Series to be explained, shape (sample,).
    time_s
        Times of a uniformly sampled record, s; None: the samples are independent.
    response_name
        Name of the response, for labels.
    constant
        Whether a constant term, named `constant`, is added.
    noise
        Standard deviations of the white noise in measured regressors, by name; 0 if absent. The contribution of the
        noise to X^T X is removed.

    Raises
    ------
    ValueError
        If a name is `constant` or occurs twice, a series differs in length or is not finite, there are no more samples
        than parameters, times have unequal steps, or `noise` is not valid.
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
    times = None if time_s is None else uniform_times(time_s, z.size)
    columns = {name: series[name] for name in regressors}
    if constant:
        columns[CONSTANT] = np.ones_like(z)
    if z.size <= len(columns):
        raise ValueError(
            f"{response_name}: arrived {z.size} samples for {len(columns)} parameters; expected more samples"
        )
    noise = noise or {}
    if not set(noise) <= set(columns) or not all(0.0 <= level < np.inf for level in noise.values()):
        raise ValueError(f"noise: arrived {dict(noise)}; expected standard deviations of {', '.join(regressors)}")
    levels = np.array([float(noise.get(name, 0.0)) for name in columns])
    return Regression(tuple(columns), np.stack(list(columns.values()), axis=1), z, times, response_name, levels)


def uniform_times(time_s: ArrayLike, count: int) -> Float[np.ndarray, " sample"]:
    """Return times (s) as an array; raises ValueError unless there are `count` times with equal steps (to 0.1 %)."""
    times = np.asarray(time_s, dtype=float)
    if times.shape != (count,) or not np.all(np.isfinite(times)):
        raise ValueError(f"time_s: arrived an array of shape {times.shape}; expected ({count},) finite times, s")
    if count < 2:
        raise ValueError(f"time_s: arrived {count} sample; expected at least 2")
    steps = np.diff(times)
    if not (np.all(steps > 0.0) and np.ptp(steps) <= 1e-3 * np.mean(steps)):
        raise ValueError(
            f"time_s: arrived steps from {np.min(steps):g} to {np.max(steps):g} s; expected equal steps: a record "
            "that is resampled"
        )
    return times


def white_variance(X: Matrix) -> Float[np.ndarray, " parameter"]:
    """Return the variance of white noise in each column of X from third differences, for an otherwise smooth column."""
    return np.mean(np.diff(X, 3, axis=0) ** 2, axis=0) / 20.0  # 1 + 9 + 9 + 1: squares of the weights


def regress(
    regressors: Mapping[str, ArrayLike],
    response: ArrayLike,
    time_s: ArrayLike | None = None,
    *,
    response_name: str = "response",
    constant: bool = True,
    noise: Mapping[str, float] | None = None,
) -> Estimate:
    """Estimate the parameters of a linear equation by ordinary least squares, in the time domain.

    If `time_s` is given, the covariance is corrected for coloured residuals. Arguments and further errors: see
    `anser.identification.regression.prepare_regression`. Raises ValueError if regressors are collinear or mostly noise;
    the message names the regressors.
    """
    problem = prepare_regression(
        regressors, response, time_s, response_name=response_name, constant=constant, noise=noise
    )
    method = "equation error, least squares without the noise of regressors" if noise else ORDINARY
    return _solve(problem, method)


ORDINARY = "equation error, ordinary least squares"


def _solve(problem: Regression, method: str, notes: tuple[str, ...] = ()) -> Estimate:
    checked = problem.check_collinearity()
    inverse = np.linalg.inv(problem.information())
    values = inverse @ problem.X.T @ problem.z
    if not problem.noise.any():
        values = np.linalg.lstsq(problem.X, problem.z, rcond=None)[0]
    errors = problem.error_covariance(problem.X, problem.z - problem.X @ values, inverse)
    return _estimate(problem, method, values, errors, checked, notes)


def _estimate(
    problem: Regression,
    method: str,
    values: Float[np.ndarray, " parameter"],
    errors: ErrorCovariance,
    checked: Collinearity,
    notes: tuple[str, ...] = (),
) -> Estimate:
    return Estimate(
        method=method,
        names=problem.names,
        values=values,
        **errors._asdict(),
        **checked._asdict(),
        responses=(problem.response,),
        measured=problem.z[:, None],
        fitted=(problem.X @ values)[:, None],
        sample_points=np.arange(problem.z.size, dtype=float) if problem.time_s is None else problem.time_s,
        notes=notes,
    )


def regress_total(
    regressors: Mapping[str, ArrayLike],
    response: ArrayLike,
    time_s: ArrayLike | None = None,
    *,
    noise: Mapping[str, float],
    response_noise: float,
    response_name: str = "response",
    constant: bool = True,
) -> Estimate:
    """Estimate the parameters of a linear equation by total least squares, for noise in response and regressors.

    `noise` contains the standard deviations of noise in regressors by name (absent: exact), `response_noise` is the
    standard deviation of noise in the response; only the ratios matter. Remaining arguments and errors: see `regress`.
    Source: S. Van Huffel, J. Vandewalle, *The Total Least Squares Problem*, SIAM 1991, section 3.6.
    """
    problem = prepare_regression(
        regressors, response, time_s, response_name=response_name, constant=constant, noise=noise
    )
    if not (np.any(problem.noise > 0.0) and 0.0 < response_noise < np.inf):
        raise ValueError(
            f"noise: arrived {dict(noise)}, and {response_noise!r} for the response; expected standard deviations"
        )
    checked = problem._replace(noise=np.zeros_like(problem.noise)).check_collinearity()
    noisy, values = problem.noise > 0.0, np.zeros(problem.noise.size)
    exact = problem.X[:, ~noisy]
    joint = np.column_stack([problem.X[:, noisy] / problem.noise[noisy], problem.z / response_noise])
    reduced = joint - exact @ np.linalg.lstsq(exact, joint, rcond=None)[0] if exact.size else joint
    direction = np.linalg.svd(reduced, full_matrices=False)[2][-1]
    values[noisy] = -direction[:-1] / direction[-1] * response_noise / problem.noise[noisy]
    remainder = problem.z - problem.X[:, noisy] @ values[noisy]
    values[~noisy] = np.linalg.lstsq(exact, remainder, rcond=None)[0]
    residuals = problem.z - problem.X @ values
    weight = response_noise**2 + np.sum((problem.noise * values) ** 2)
    scale = residuals @ residuals / ((residuals.size - values.size) * weight)  # factor on the squares of the noise
    scaled = problem._replace(noise=np.sqrt(scale) * problem.noise)
    clean = problem.X + np.outer(residuals, problem.noise**2 * values / weight)  # the regressors' expected values
    errors = problem.error_covariance(clean, residuals, np.linalg.inv(scaled.information()))
    return _estimate(problem, "equation error, total least squares", values, errors, checked)


def regress_stepwise(
    candidates: Mapping[str, ArrayLike],
    response: ArrayLike,
    time_s: ArrayLike | None = None,
    *,
    criterion: Literal["F", "PSE"] = "F",
    response_name: str = "response",
) -> Estimate:
    """Select regressors by stepwise regression, and estimate their parameters and a constant by ordinary least squares.

    At each step the candidate with the greatest partial correlation with the response enters. The notes of the estimate
    list the steps. Source: V. Klein, E. A. Morelli, *Aircraft System Identification*, AIAA 2006, section 5.4.

    - Criterion `F`: regressors with a partial F ratio of 20 or less leave. The selection ends if the entering candidate
      has a ratio of 20 or less, or R^2 grows by 0.005 or less.
    - Criterion `PSE`: no regressor leaves. The selection ends if the predicted squared error does not fall.

    Remaining arguments and errors: see `regress`. Raises ValueError if no candidate is significant.
    """
    if criterion not in ("F", "PSE"):
        raise ValueError(f"criterion: arrived {criterion!r}; expected 'F' (partial F ratio) or 'PSE'")
    problem = prepare_regression(candidates, response, time_s, response_name=response_name)
    z, count = problem.z, problem.z.size
    variation = np.sum((z - np.mean(z)) ** 2)
    if variation <= np.finfo(float).eps ** 2 * np.sum(z**2) * count:
        raise ValueError(f"{response_name}: arrived a constant; expected a response that varies")
    selected: list[str] = []
    steps: list[str] = []

    def squares(names: Sequence[str]) -> float:
        X = problem.subset([*names, CONSTANT]).X
        return float(np.sum((z - X @ np.linalg.lstsq(X, z, rcond=None)[0]) ** 2))

    def predicted_error(names: Sequence[str]) -> float:
        return squares(names) / count + float(variation) / (count - 1) * (len(names) + 1) / count

    def partial_f(name: str, names: Sequence[str]) -> float:
        """Return the partial F ratio of the regressor `name` in the model with the regressors `names`."""
        full = squares(names)
        return (squares([n for n in names if n != name]) / full - 1.0) * (count - len(names) - 1)

    while len(selected) < len(candidates):
        entrant = min(
            (name for name in candidates if name not in selected), key=lambda name: squares([*selected, name])
        )
        trial = [*selected, entrant]
        ratio, gain = partial_f(entrant, trial), (squares(selected) - squares(trial)) / variation
        improves = ratio > _F_MIN and gain > 0.005
        if criterion == "PSE":
            improves = predicted_error(trial) < predicted_error(selected)
        if not improves:
            break
        selected = [name for name in trial if partial_f(name, trial) > _F_MIN or criterion == "PSE"]
        steps.append(f"{entrant} enters: R2 {1.0 - squares(trial) / variation:.4f}, F {ratio:.3g}")
        steps += [f"{name} leaves" for name in trial if name not in selected]
        if steps[-1] == f"{entrant} leaves":
            break
    if not selected:
        raise ValueError(f"{response_name}: no candidate is significant; expected a response that depends on one")
    return _solve(problem.subset([*selected, CONSTANT]), "equation error, stepwise regression", tuple(steps))


_F_MIN = 20.0
"""Partial F ratio above which a regressor is significant: chance reaches 20 in 1 of 100,000 cases."""


def regress_with_prior(
    regressors: Mapping[str, ArrayLike],
    response: ArrayLike,
    prior: Mapping[str, tuple[float, float]],
    time_s: ArrayLike | None = None,
    *,
    response_name: str = "response",
    constant: bool = True,
) -> Estimate:
    """Estimate the parameters of a linear equation from a record and prior values, by mixed estimation.

    Source: H. Theil, A. S. Goldberger, 1961.

    Parameters
    ----------
    regressors, response, time_s, response_name, constant
        See `prepare_regression`. The regressors may be collinear if prior values tell the parameters apart.
    prior
        Prior value and standard error by parameter, for some or all parameters.

    Raises
    ------
    ValueError
        If a name in `prior` is no parameter, a standard error is not positive and finite, or record and prior values do
        not determine the parameters; further errors: see `regress`.
    """
    problem = prepare_regression(regressors, response, time_s, response_name=response_name, constant=constant)
    if not set(prior) <= set(problem.names) or not all(0.0 < error < np.inf for _, error in prior.values()):
        raise ValueError(f"prior: arrived {dict(prior)}; expected (value, standard error above 0) of a regressor")
    problem.require_excitation()
    X, z = problem.X, problem.z
    fit = X @ np.linalg.lstsq(X, z, rcond=1e-10)[0]
    inverse = np.linalg.pinv(X.T @ X, rcond=1e-10, hermitian=True)
    errors = problem.error_covariance(X, z - fit, inverse)
    # variance of white errors with the same information as the coloured ones
    variance = np.trace(errors.covariance @ X.T @ X) / np.linalg.matrix_rank(X, tol=1e-10 * np.linalg.norm(X))
    weights, targets = np.zeros(len(problem.names)), np.zeros(len(problem.names))
    for name, (value, error) in prior.items():
        weights[problem.names.index(name)], targets[problem.names.index(name)] = error**-2, value
    information = X.T @ X / variance + np.diag(weights)
    checked = collinearity(information, problem.names, "regressors and prior")
    covariance = np.linalg.inv(information)
    values = covariance @ (X.T @ z / variance + weights * targets)
    scores = X.T @ X @ errors.covariance @ X.T @ X / variance**2 + np.diag(weights)
    errors = errors._replace(covariance=covariance @ scores @ covariance, white_covariance=covariance)
    return _estimate(problem, "equation error, mixed estimation with prior values", values, errors, checked)


def step_means(
    regressors: Mapping[str, ArrayLike],
    state: ArrayLike,
    time_s: ArrayLike,
    held: Collection[str] = (),
) -> tuple[dict[str, Float[np.ndarray, " step"]], Float[np.ndarray, " step"], Float[np.ndarray, " step"]]:
    """Return for each step the means of the regressors by name, the mean rate of a state (per s) and the mid time (s).

    White noise of standard deviation sigma becomes sigma / sqrt(2) in a mean, and sqrt(2) sigma / step in a rate; the
    errors of the mean and of the rate in a step do not correlate. A regressor in `held` must be constant over the step
    after its sample.
    """
    times = uniform_times(time_s, np.asarray(time_s).size)
    series = {name: np.asarray(values, dtype=float) for name, values in regressors.items()}
    means = {name: x[:-1] if name in held else 0.5 * (x[1:] + x[:-1]) for name, x in series.items()}
    return means, np.diff(np.asarray(state, dtype=float)) / np.diff(times), 0.5 * (times[1:] + times[:-1])
