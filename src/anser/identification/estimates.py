"""Estimated parameters with covariance and intervals, fit statistics, whiteness of the residuals, and collinearity."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from jaxtyping import Float, Inexact
from scipy import stats

from anser.results.documents import notebook_table

Samples = Inexact[np.ndarray, "sample response"]

COLLINEARITY_MAX = 1000.0
"""Greatest condition number of regressors scaled to unit length; above, an estimate depends on the last digits."""
_COLLINEARITY_NOTABLE = (
    30.0  # strong collinearity (D. A. Belsley, E. Kuh, R. E. Welsch, *Regression Diagnostics*, 1980)
)


class Whiteness(NamedTuple):
    """Autocorrelation of residuals over the lags 1, 2, ..., and the 95 % bound of white residuals."""

    autocorrelation: Float[np.ndarray, "lag response"]
    bound: float

    @property
    def share_outside(self) -> Float[np.ndarray, " response"]:
        """Share of the lags outside the bounds; about 0.05 for white residuals."""
        return np.mean(np.abs(self.autocorrelation) > self.bound, axis=0)


@dataclass(frozen=True, repr=False)
class Estimate:
    """Estimated parameters: printed, a table with the 95 % interval of each parameter, then the fit.

    Attributes
    ----------
    method
        Name of the method, for labels.
    names, values, covariance
        Names of the parameters, their values (parameter,) and the covariance of their errors (parameter, parameter).
    degrees_of_freedom
        Degrees of freedom of the residual variance: intervals follow Student's distribution.
    responses
        Names of the measured quantities that the model reproduces.
    measured, fitted
        Measured and fitted values, shape (sample, response); complex in the frequency domain.
    sample_points
        Times of the samples, s, or their frequencies, Hz (`is_spectrum`).
    condition_number, variance_inflation
        Collinearity of the regressors or sensitivities: ratio of the extreme singular values after scaling to unit
        length, and by parameter the factor on the variance from the correlation with the remaining parameters.
    is_spectrum
        Whether the samples are those of a Fourier transform.
    white_covariance
        Covariance as if the residuals were white: the published bound, for comparison.
    notes
        Remarks for the reader of the table.
    """

    method: str
    names: tuple[str, ...]
    values: Float[np.ndarray, " parameter"]
    covariance: Float[np.ndarray, "parameter parameter"]
    degrees_of_freedom: float
    responses: tuple[str, ...]
    measured: Samples
    fitted: Samples
    sample_points: Float[np.ndarray, " sample"]
    condition_number: float
    variance_inflation: Float[np.ndarray, " parameter"]
    is_spectrum: bool = False
    white_covariance: Float[np.ndarray, "parameter parameter"] | None = None
    notes: tuple[str, ...] = ()

    def __getitem__(self, name: str) -> float:
        """Return the value of a parameter; the interval is `interval()`."""
        return float(self.values[self.names.index(name)])

    @property
    def parameters(self) -> dict[str, float]:
        """Values by name, as the model functions take them."""
        return dict(zip(self.names, map(float, self.values), strict=True))

    @property
    def standard_errors(self) -> Float[np.ndarray, " parameter"]:
        """Roots of the diagonal of the covariance."""
        return np.sqrt(np.diag(self.covariance))

    def interval(self, level: float = 0.95) -> Float[np.ndarray, "parameter 2"]:
        """Return the confidence interval of each parameter (Student's distribution), `level` above 0 and below 1."""
        if not 0.0 < level < 1.0:
            raise ValueError(f"level: arrived {level!r}; expected a probability between 0 and 1, such as 0.95")
        half = stats.t.ppf(0.5 + 0.5 * level, self.degrees_of_freedom) * self.standard_errors
        return np.stack([self.values - half, self.values + half], axis=1)

    def ellipse(self, first: str, second: str, level: float = 0.95) -> Float[np.ndarray, "point 2"]:
        """Return points on the joint confidence ellipse of two parameters, closed; `level` above 0 and below 1."""
        indices = [self.names.index(name) for name in (first, second)]
        root = np.linalg.cholesky(self.covariance[np.ix_(indices, indices)])
        radius = np.sqrt(2.0 * stats.f.ppf(level, 2, self.degrees_of_freedom))
        angle = np.linspace(0.0, 2.0 * np.pi, 101)
        return self.values[indices] + radius * np.stack([np.cos(angle), np.sin(angle)], axis=1) @ root.T

    @property
    def correlation(self) -> Float[np.ndarray, "parameter parameter"]:
        """Correlation of the errors of the parameters."""
        return self.covariance / np.outer(self.standard_errors, self.standard_errors)

    @property
    def residuals(self) -> Samples:
        """Measured minus fitted values."""
        return self.measured - self.fitted

    @property
    def r_squared(self) -> Float[np.ndarray, " response"]:
        """Coefficient of determination R^2 of each response: 1 is a perfect fit.

        The variation of a response is about its mean; the transform of a response has no mean.
        """
        measured = np.asarray(self.measured)
        middle = 0.0 if self.is_spectrum else np.mean(measured, axis=0)
        return 1.0 - _squares(self.residuals) / _squares(measured - middle)

    @property
    def rms(self) -> Float[np.ndarray, " response"]:
        """Root mean square of the residuals of each response."""
        return np.sqrt(_squares(self.residuals) / len(self.measured))

    @property
    def theil_inequality(self) -> Float[np.ndarray, " response"]:
        """Theil's inequality coefficient of each response: 0 for a perfect fit, 1 without any; below 0.25 to 0.3: good.

        Source: R. V. Jategaonkar, *Flight Vehicle System Identification*, section 11.2.
        """
        roots = [np.sqrt(_squares(values)) for values in (self.residuals, self.measured, self.fitted)]
        return roots[0] / (roots[1] + roots[2])

    @property
    def whiteness(self) -> Whiteness | None:
        """Autocorrelation of the residuals up to a fifth of the record; None in the frequency domain."""
        if self.is_spectrum:
            return None
        gamma = autocovariances(np.real(self.residuals), len(self.measured) // 5)
        autocovariance = np.diagonal(gamma, axis1=1, axis2=2)
        return Whiteness(autocovariance[1:] / autocovariance[0], 1.96 / float(np.sqrt(len(self.measured))))

    def __repr__(self) -> str:
        return text_table(self._title(), self._entries(), [*self._fit_lines(), *self.notes])

    def _repr_html_(self) -> str:
        return notebook_table(self._title(), self._entries(), [*self._fit_lines(), *self.notes])

    def _title(self) -> str:
        return f"{self.method}: {', '.join(self.responses)} from {len(self.measured)} samples"

    def _entries(self) -> list[dict[str, str]]:
        columns = zip(
            self.names, self.values, self.interval(), self.standard_errors, self.variance_inflation, strict=True
        )
        return [
            {
                "parameter": name,
                "estimate": f"{value:.{digits}g}",
                "95 % interval": f"{low:.{digits}g} to {high:.{digits}g}",
                "standard error": f"{error:.2g}",
                "variance inflation": f"{inflation:.3g}",
            }
            for name, value, (low, high), error, inflation in columns
            for digits in [_significant_digits(value, error)]
        ]

    def _fit_lines(self) -> list[str]:
        fits = zip(self.responses, self.r_squared, self.theil_inequality, self.rms, strict=True)
        lines = [f"{name}: R2 {r2:.4f}, TIC {tic:.3f}, RMS {rms:.3g}" for name, r2, tic, rms in fits]
        lines.append(f"condition number {self.condition_number:.3g}")
        if self.condition_number > _COLLINEARITY_NOTABLE:
            worst = [self.names[k] for k in np.argsort(-self.variance_inflation)[:2]]
            lines[-1] += f" (above {_COLLINEARITY_NOTABLE:g}: {' and '.join(worst)} are hard to tell apart)"
        if (whiteness := self.whiteness) is not None:
            shares = zip(self.responses, whiteness.share_outside, strict=True)
            text = ", ".join(f"{name} {100.0 * share:.0f} %" for name, share in shares)
            lines.append(f"lags outside the bounds of white residuals (5 % if white): {text}")
        return lines

    @property
    def dataset(self) -> xr.Dataset:
        """Estimate, fit and residuals as a labelled dataset; complex samples as their real and imaginary parts."""
        names, inflation = np.array(self.names), self.variance_inflation
        interval = self.interval()
        data: dict[str, Any] = {
            "estimate": ("parameter", self.values, {"long_name": "Estimate"}),
            "standard_error": ("parameter", self.standard_errors, {"long_name": "Standard error"}),
            "interval_low": ("parameter", interval[:, 0], {"long_name": "Lower bound of the 95 % interval"}),
            "interval_high": ("parameter", interval[:, 1], {"long_name": "Upper bound of the 95 % interval"}),
            "variance_inflation": ("parameter", inflation, {"long_name": "Factor on the variance from collinearity"}),
            "covariance": (("parameter", "parameter_2"), self.covariance, {"long_name": "Covariance of the errors"}),
            "correlation": (("parameter", "parameter_2"), self.correlation, {"long_name": "Correlation of the errors"}),
            "r_squared": ("response", self.r_squared, {"long_name": "Coefficient of determination"}),
            "theil_inequality": ("response", self.theil_inequality, {"long_name": "Theil's inequality coefficient"}),
            "rms_residual": ("response", self.rms, {"long_name": "Root mean square of the residuals"}),
        }
        axis, unit, long_name = ("frequency", "Hz", "Frequency") if self.is_spectrum else ("time", "s", "Time")
        for name, samples in (("measured", self.measured), ("fitted", self.fitted), ("residual", self.residuals)):
            label = {"long_name": f"{name.capitalize()} response"}
            if self.is_spectrum:
                parts = np.stack([np.real(samples), np.imag(samples)], axis=2)
                data[name] = ((axis, "response", "part"), parts, label)
            else:
                data[name] = ((axis, "response"), samples, label)
        coordinates: dict[str, Any] = {
            "parameter": names,
            "parameter_2": names,
            "response": np.array(self.responses),
            axis: (axis, self.sample_points, {"units": unit, "long_name": long_name}),
        }
        if self.is_spectrum:
            coordinates["part"] = np.array(["real", "imaginary"])
        if (whiteness := self.whiteness) is not None:
            coordinates["lag"] = np.arange(1, len(whiteness.autocorrelation) + 1)
            label = {"long_name": "Autocorrelation of the residuals", "bound_95": whiteness.bound}
            data["autocorrelation"] = (("lag", "response"), whiteness.autocorrelation, label)
        attributes: dict[str, Any] = {
            "method": self.method,
            "degrees_of_freedom": self.degrees_of_freedom,
            "condition_number": self.condition_number,
            "notes": "; ".join(self.notes),
        }
        return xr.Dataset(data, coordinates, attributes)


def _significant_digits(value: float, error: float) -> int:
    """Return the digits of a value that show two digits of its standard error, from 4 to 8."""
    ratio = max(abs(value), error) / max(error, 1e-300)
    return int(np.clip(np.ceil(np.log10(ratio)) + 2, 4, 8)) if np.isfinite(ratio) else 4


def text_table(title: str, entries: Sequence[Mapping[str, str]], notes: Sequence[str]) -> str:
    """Return a table as text, with a title above and notes below; the entries hold the cells by column name."""
    widths = {name: max(len(name), *(len(entry[name]) for entry in entries)) for name in entries[0]}
    table = [dict(zip(widths, widths, strict=True)), *entries]
    lines = ["  ".join(f"{entry[name]:>{width}}" for name, width in widths.items()) for entry in table]
    return "\n".join([title, *(f"  {line}" for line in lines), *notes])


def _squares(samples: Samples) -> Float[np.ndarray, " response"]:
    return np.sum(np.abs(samples) ** 2, axis=0)


def autocovariances(
    residuals: Float[np.ndarray, "sample response"], lag_max: int
) -> Float[np.ndarray, "lag response response_2"]:
    """Return the sums of v_i v_(i + lag)^T over a record of residuals v at the lags 0 to `lag_max`, over its length.

    The division by the length of the record keeps their Fourier transform, a spectrum, positive.
    """
    count = len(residuals)
    return np.stack([residuals[: count - lag].T @ residuals[lag:] for lag in range(lag_max + 1)]) / count


class ErrorCovariance(NamedTuple):
    """Covariance of estimated parameters, with white errors for comparison, and the degrees of freedom behind it."""

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
    """Compute the covariance of parameters with the errors A^-1 sum S_i^T v_i, for coloured v (theory, identification).

    The autocovariances up to a greatest lag are estimated from the residuals and tapered to zero (M. S. Bartlett,
    1950), so that the spectrum has 3 samples / lags degrees of freedom. The fit has removed the errors' spectrum near
    the frequencies of the sensitivities from the residuals: each variance is divided by the share that would remain of
    white errors. Source: E. A. Morelli, V. Klein, *Accuracy of aerodynamic model parameters estimated from flight test
    data*, J. Guidance 20(1), 1997; the taper and the share are additions.

    Parameters
    ----------
    sensitivities
        S_i; of several responses, weighted so that their errors have about the same variance.
    residuals
        Estimated errors v, weighted likewise.
    inverse
        A^-1, the inverse of the sum of S_i^T S_i for least squares.
    is_record
        False: the samples are independent, and the covariance is that of white errors.
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
    total, remaining = np.zeros_like(square), np.zeros_like(square)
    for lag in range(lag_max + 1):
        products = columns[: count - lag].T @ columns[lag:]
        products = products.reshape(responses, parameters, responses, parameters)
        white = np.eye(responses) * (lag == 0) - np.einsum("apbq,pq->ab", products, inverse) / count
        weight = (1.0 if lag else 0.5) * (1.0 - lag / (lag_max + 1))
        for covariance, sums in ((gamma[lag], total), (white, remaining)):
            part = weight * np.einsum("ab,apbq->pq", covariance, products)
            sums += part + part.T
    share = np.diag(inverse @ remaining @ inverse) / np.diag(inverse @ square @ inverse)
    scale = 1.0 / np.sqrt(np.clip(share, 0.1, 1.0))
    covariance = scale[:, None] * (inverse @ total @ inverse) * scale
    return ErrorCovariance(covariance, white_covariance, min(freedom, 3.0 * count / max(lag_max, 1)))


class Collinearity(NamedTuple):
    """Condition number of scaled regressors, and the factor on each variance; see `Estimate`."""

    condition_number: float
    variance_inflation: Float[np.ndarray, " parameter"]


def collinearity(
    information: Float[np.ndarray, "parameter parameter"],
    names: Sequence[str],
    subject: str = "regressors",
    condition_max: float = COLLINEARITY_MAX,
) -> Collinearity:
    """Compute the collinearity from an information matrix, such as X^T X of regressors X.

    Raises
    ------
    ValueError
        An entry of the diagonal is zero (no excitation), or the condition number exceeds `condition_max`; the message
        names the parameters in the combination without information.
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
    if condition_number > condition_max:
        involved = ", ".join(names[int(k)] for k in np.argsort(-np.abs(vectors[:, 0])) if abs(vectors[k, 0]) > 0.1)
        raise ValueError(
            f"{subject}: {involved} are collinear (condition number {condition_number:.3g}); expected at most "
            f"{condition_max:g}: a manoeuvre that moves them apart, fewer parameters, or prior values"
        )
    inverse = (vectors / eigenvalues) @ vectors.T
    return Collinearity(condition_number, np.diag(inverse))
