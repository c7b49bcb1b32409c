"""Estimated parameters with covariance and confidence intervals, covariance for coloured residuals, collinearity."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from jaxtyping import Float
from scipy import stats

from anser.identification.fits import Fit, PrintedTable, autocovariances
from anser.results.variable_labels import unit_attributes

COLLINEARITY_MAX = 1000.0
"""Condition number of the regressors, scaled to unit length, above which an estimate is refused as indeterminate."""
COLLINEARITY_NOTABLE = 30.0
"""Condition number for a caution (D. A. Belsley, E. Kuh, R. E. Welsch, *Regression Diagnostics*, 1980)."""
_LABELS = {
    "estimate": "Estimate",
    "standard_error": "Standard error",
    "low": "Lower bound of the 95 % interval",
    "high": "Upper bound of the 95 % interval",
    "variance_inflation": "Factor on the variance from collinearity",
}


@dataclass(frozen=True, kw_only=True, repr=False)
class Estimate(Fit, PrintedTable):
    """Estimated parameters with covariance, and the fit to the measured responses; prints a table of 95 % intervals.

    Attributes
    ----------
    method
        Name of the method, for labels.
    names, values, covariance
        Names of the parameters, their values, and the covariance of the errors, in the parameters' units.
    degrees_of_freedom
        Degrees of freedom of Student's distribution for the intervals.
    condition_number
        Greatest / least singular value of the regressors or sensitivities after scaling to unit length.
    variance_inflation
        Factor by which the correlation with the remaining parameters raises the variance of each parameter.
    white_covariance
        Covariance for white residuals (the textbook value), for comparison; None: not computed.
    notes
        Remarks on the estimate, printed below the table.
    """

    method: str
    names: tuple[str, ...]
    values: Float[np.ndarray, " parameter"]
    covariance: Float[np.ndarray, "parameter parameter"]
    degrees_of_freedom: float
    condition_number: float
    variance_inflation: Float[np.ndarray, " parameter"]
    white_covariance: Float[np.ndarray, "parameter parameter"] | None = None
    notes: tuple[str, ...] = ()

    def __getitem__(self, name: str) -> float:
        """Return the value of a parameter by its name; raises ValueError if the name is unknown."""
        return float(self.values[self.names.index(name)])

    @property
    def parameters(self) -> dict[str, float]:
        """Values of the parameters by name."""
        return dict(zip(self.names, map(float, self.values), strict=True))

    @property
    def standard_errors(self) -> Float[np.ndarray, " parameter"]:
        """Standard errors of the parameters, in the units of the parameters."""
        return np.sqrt(np.diag(self.covariance))

    def interval(self, level: float = 0.95) -> Float[np.ndarray, "parameter 2"]:
        """Return lower and upper bound of each parameter's confidence interval, by Student's distribution.

        Raises ValueError unless the probability `level` is above 0 and below 1.
        """
        _require_level(level)
        half = stats.t.ppf(0.5 + 0.5 * level, self.degrees_of_freedom) * self.standard_errors
        return np.stack([self.values - half, self.values + half], axis=1)

    def ellipse(self, first: str, second: str, level: float = 0.95) -> Float[np.ndarray, "point 2"]:
        """Return 101 points (first, second) on the closed joint confidence ellipse of two parameters, given by name.

        Raises ValueError for an unknown name, or unless the probability `level` is above 0 and below 1.
        """
        _require_level(level)
        unknown = [name for name in (first, second) if name not in self.names]
        if unknown:
            raise ValueError(f"ellipse: arrived {unknown[0]!r}; expected names among {', '.join(self.names)}")
        indices = [self.names.index(name) for name in (first, second)]
        root = np.linalg.cholesky(self.covariance[np.ix_(indices, indices)])
        radius = np.sqrt(2.0 * stats.f.ppf(level, 2, self.degrees_of_freedom))
        angle = np.linspace(0.0, 2.0 * np.pi, 101)
        return self.values[indices] + radius * np.stack([np.cos(angle), np.sin(angle)], axis=1) @ root.T

    @property
    def correlation(self) -> Float[np.ndarray, "parameter parameter"]:
        """Correlation coefficients of the errors of the parameters, -1 to 1."""
        return self.covariance / np.outer(self.standard_errors, self.standard_errors)

    def rows(self) -> list[dict[str, Any]]:
        """Return per parameter: `name`, `estimate`, `standard_error`, `low` and `high` (95 %), `variance_inflation`."""
        low, high = self.interval().T
        columns = self.values, self.standard_errors, low, high, self.variance_inflation
        keyed = [dict(zip(_LABELS, map(float, row), strict=True)) for row in zip(*columns, strict=True)]
        return [{"name": name, **row} for name, row in zip(self.names, keyed, strict=True)]

    def _table(self) -> tuple[str, list[dict[str, str]], list[str]]:
        title = f"{self.method}: {', '.join(self.responses)} from {len(self.measured)} samples"
        return title, table_entries(self.rows()), [*self._fit_lines(), *self.notes]

    def _fit_lines(self) -> list[str]:
        fits = zip(self.responses, self.r_squared, self.theil_inequality, self.rms, strict=True)
        lines = [f"{name}: R2 {r2:.4f}, TIC {tic:.3f}, RMS {rms:.3g}" for name, r2, tic, rms in fits]
        lines.append(f"condition number {self.condition_number:.3g}")
        if self.condition_number > COLLINEARITY_NOTABLE:
            worst = [self.names[k] for k in np.argsort(-self.variance_inflation)[:2]]
            lines[-1] += f" (above {COLLINEARITY_NOTABLE:g}: {' and '.join(worst)} are hard to tell apart)"
        if (whiteness := self.whiteness) is not None:
            shares = zip(self.responses, whiteness.share_outside, strict=True)
            text = ", ".join(f"{name} {100.0 * share:.0f} %" for name, share in shares)
            lines.append(f"lags outside the bounds of white residuals (5 % if white): {text}")
        return lines

    @property
    def dataset(self) -> xr.Dataset:
        """Estimate, fit and residuals as a labelled dataset, with complex samples as real and imaginary parts."""
        axis, unit, long_name = ("frequency", "Hz", "Frequency") if self.is_spectrum else ("time", "s", "Time")
        dimensions, parts = (axis, "response"), ()
        if self.is_spectrum:
            dimensions, parts = (axis, "response", "part"), ("real", "imag")
        data = parameter_variables([self])
        for name, samples in (("measured", self.measured), ("fitted", self.fitted), ("residual", self.residuals)):
            values = np.stack([getattr(samples, part) for part in parts], axis=2) if parts else samples
            data[name] = (dimensions, values, unit_attributes("", f"{name.capitalize()} response"))
        for name, label in (("r_squared", "Coefficient of determination"), ("theil_inequality", "Theil's inequality")):
            data[name] = ("response", getattr(self, name), unit_attributes("1", label))
        coordinates: dict[str, Any] = {
            "response": np.array(self.responses),
            axis: (axis, self.sample_points, unit_attributes(unit, long_name)),
        }
        if parts:
            coordinates["part"] = np.array(parts)
        attributes: dict[str, Any] = {
            "method": self.method,
            "degrees_of_freedom": self.degrees_of_freedom,
            "condition_number": self.condition_number,
            "notes": "; ".join(self.notes),
        }
        return xr.Dataset(data, coordinates, attributes)


def _require_level(level: float) -> None:
    if not 0.0 < level < 1.0:
        raise ValueError(f"level: arrived {level!r}; expected a probability between 0 and 1, such as 0.95")


def table_entries(rows: Sequence[dict[str, Any]]) -> list[dict[str, str]]:
    """Return `Estimate.rows` as the text cells of a printed table, rounded according to the standard errors."""
    entries = []
    for row in rows:
        value, error = row["estimate"], row["standard_error"]
        ratio = max(abs(value), error) / max(error, 1e-300)
        # two digits of the standard error, from 4 to 8 in all
        digits = int(np.clip(np.ceil(np.log10(ratio)) + 2, 4, 8)) if np.isfinite(ratio) else 4
        interval = f"{row['low']:.{digits}g} to {row['high']:.{digits}g}"
        entries.append(
            {
                "parameter": row["name"],
                "estimate": f"{value:.{digits}g}",
                "95 % interval": interval,
                "standard error": f"{error:.2g}",
                "variance inflation": f"{row['variance_inflation']:.3g}",
            }
        )
    return entries


def parameter_variables(estimates: Sequence[Estimate]) -> dict[str, Any]:
    """Return dataset variables with the parameters of all estimates: values, intervals, and correlation of the errors.

    The correlation is NaN between parameters of different estimates.
    """
    rows = [row for estimate in estimates for row in estimate.rows()]
    correlation, start = np.full((len(rows), len(rows)), np.nan), 0
    for estimate in estimates:
        inside = slice(start, start + len(estimate.names))
        correlation[inside, inside], start = estimate.correlation, inside.stop
    labels = unit_attributes("1", "Correlation of the errors")
    if len(estimates) > 1:
        labels["comment"] = "NaN between parameters of different equations, whose errors are not related"
    names = np.array([row["name"] for row in rows])
    data: dict[str, Any] = {"parameter": names, "parameter_2": names}
    data |= {key: ("parameter", [row[key] for row in rows], {"long_name": label}) for key, label in _LABELS.items()}
    return data | {"correlation": (("parameter", "parameter_2"), correlation, labels)}


class ErrorCovariance(NamedTuple):
    """Covariance of estimated parameters for coloured and for white residuals, with the degrees of freedom."""

    covariance: Float[np.ndarray, "parameter parameter"]
    white_covariance: Float[np.ndarray, "parameter parameter"]
    degrees_of_freedom: float


def coloured_covariance(
    sensitivities: Float[np.ndarray, "sample response parameter"],
    residuals: Float[np.ndarray, "sample response"],
    inverse: Float[np.ndarray, "parameter parameter"],
    *,
    is_record: bool = True,
) -> ErrorCovariance:
    """Compute the covariance of estimated parameters if the errors of the samples are coloured.

    The errors of the parameters are A^-1 sum_i S_i^T v_i, where v_i is the error of sample i (theory, identification).
    The autocovariances of v are estimated from the residuals, with weights that fall linearly to 0 with the lag (M. S.
    Bartlett, 1950). A fit makes residuals smaller than errors; therefore each variance is divided by the ratio (at
    least 0.1) of estimated to true variance for white errors. Source, without weights and ratio: E. A. Morelli, V.
    Klein, *Accuracy of aerodynamic model parameters estimated from flight test data*, J. Guidance 20(1), 1997.

    Parameters
    ----------
    sensitivities
        Derivatives S_i of the responses with respect to the parameters. If there are several responses, S_i must be
        divided by the standard deviations of the responses' errors.
    residuals
        Residuals of the fit, divided by the same standard deviations.
    inverse
        A^-1; for least squares, A is the sum of S_i^T S_i.
    is_record
        True: the samples are a time series, whose errors may be correlated. False: the errors are taken as white.
    """
    count, responses, parameters = sensitivities.shape
    flat = sensitivities.reshape(-1, parameters)
    square, freedom = flat.T @ flat, float(count * responses - parameters)
    white_covariance = np.sum(residuals**2) / freedom * inverse @ square @ inverse
    if not is_record:
        return ErrorCovariance(white_covariance, white_covariance, freedom)
    lag_max = min(count // 5, int(4.0 * np.sqrt(count)))
    gamma = autocovariances(residuals, lag_max)
    columns = sensitivities.reshape(count, -1)
    lags = np.arange(lag_max + 1)
    products = np.stack([columns[: count - lag].T @ columns[lag:] for lag in lags])
    products = products.reshape(lags.size, responses, parameters, responses, parameters)
    white = -np.einsum("kapbq,pq->kab", products, inverse) / count
    white[0] += np.eye(responses)
    weights = np.where(lags == 0, 0.5, 1.0 - lags / lags.size)[:, None, None]
    parts = [np.einsum("kab,kapbq->pq", weights * covariances, products) for covariances in (gamma, white)]
    total, remaining = (part + part.T for part in parts)
    share = np.diag(inverse @ remaining @ inverse) / np.diag(inverse @ square @ inverse)
    scale = 1.0 / np.sqrt(np.clip(share, 0.1, 1.0))
    covariance = scale[:, None] * (inverse @ total @ inverse) * scale
    return ErrorCovariance(covariance, white_covariance, min(freedom, 3.0 * count / max(lag_max, 1)))


class Collinearity(NamedTuple):
    """Condition number of regressors scaled to unit length, and factor by which correlation raises each variance."""

    condition_number: float
    variance_inflation: Float[np.ndarray, " parameter"]


def collinearity(
    information: Float[np.ndarray, "parameter parameter"], names: Sequence[str], subject: str = "regressors"
) -> Collinearity:
    """Return the collinearity of an information matrix, such as X^T X of regressors X; `subject` starts error messages.

    Raises ValueError if a number is not finite, a parameter has no excitation (zero on the diagonal), or the condition
    number exceeds `COLLINEARITY_MAX`; the message names the parameters.
    """
    lengths = np.sqrt(np.diag(information))
    if not np.all(np.isfinite(information)):
        raise ValueError(f"{subject}: arrived numbers that are not finite; expected finite sensitivities of {names}")
    if np.any(lengths == 0.0):
        silent = ", ".join(name for name, length in zip(names, lengths, strict=True) if length == 0.0)
        raise ValueError(f"{subject}: no excitation of {silent}; expected a record in which each of them varies")
    scaled = information / np.outer(lengths, lengths)
    eigenvalues, vectors = np.linalg.eigh(scaled)
    condition_number = float(np.sqrt(eigenvalues[-1] / max(eigenvalues[0], 1e-16)))
    if condition_number > COLLINEARITY_MAX:
        involved = ", ".join(names[int(k)] for k in np.argsort(-np.abs(vectors[:, 0])) if abs(vectors[k, 0]) > 0.1)
        raise ValueError(
            f"{subject}: {involved} are collinear (condition number {condition_number:.3g}); expected at most "
            f"{COLLINEARITY_MAX:g}: a manoeuvre that moves them apart, fewer parameters, or prior values"
        )
    inverse = (vectors / eigenvalues) @ vectors.T
    return Collinearity(condition_number, np.diag(inverse))
