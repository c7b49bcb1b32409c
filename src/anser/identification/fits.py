"""Fit of a model to measured responses: R^2, Theil's inequality coefficient, whiteness; results printed as tables."""

import abc
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Inexact

from anser.results.documents import notebook_table

Samples = Inexact[np.ndarray, "sample response"]


class PrintedTable(abc.ABC):
    """Base class of results that print, in a console or a notebook, as a table with a title above and remarks below."""

    @abc.abstractmethod
    def _table(self) -> tuple[str, list[dict[str, str]], list[str]]:
        """Return the title, the rows of the table (cell by column name), and the lines below the table."""

    def __repr__(self) -> str:
        title, entries, remarks = self._table()
        widths = {name: max(len(name), *(len(entry[name]) for entry in entries)) for name in entries[0]}
        table = [dict(zip(widths, widths, strict=True)), *entries]
        lines = ["  ".join(f"{entry[name]:>{width}}" for name, width in widths.items()) for entry in table]
        return "\n".join([title, *(f"  {line}" for line in lines), *remarks])

    def _repr_html_(self) -> str:
        return notebook_table(*self._table())


class Whiteness(NamedTuple):
    """Normalized autocorrelation of residuals at the lags 1, 2, ... samples, and the 95 % bound for white residuals."""

    autocorrelation: Float[np.ndarray, "lag response"]
    bound: float

    @property
    def share_outside(self) -> Float[np.ndarray, " response"]:
        """Share of the lags, 0 to 1, at which a response's autocorrelation exceeds the bound; about 0.05 if white."""
        return np.mean(np.abs(self.autocorrelation) > self.bound, axis=0)


@dataclass(frozen=True, kw_only=True, repr=False)
class Fit:
    """Measured responses of a manoeuvre, and a model's responses to the same inputs, over time or frequency.

    `sample_points` are times, s. If `is_spectrum` is true, `sample_points` are frequencies, Hz, and the values are
    complex Fourier transforms.
    """

    responses: tuple[str, ...]
    measured: Samples
    fitted: Samples
    sample_points: Float[np.ndarray, " sample"]
    is_spectrum: bool = False

    @property
    def residuals(self) -> Samples:
        """Measured minus fitted values, in the responses' units."""
        return self.measured - self.fitted

    @property
    def r_squared(self) -> Float[np.ndarray, " response"]:
        """Coefficient of determination R^2 of each response, about the mean or, for spectra, about 0; 1 is perfect."""
        return 1.0 - _squares(self.residuals) / _squares(self.measured - self._middle)

    @property
    def rms(self) -> Float[np.ndarray, " response"]:
        """Root mean square of the residuals of each response, in its unit."""
        return np.sqrt(_squares(self.residuals) / len(self.measured))

    @property
    def theil_inequality(self) -> Float[np.ndarray, " response"]:
        """Theil's inequality coefficient of each response: 0 is perfect, 1 worst; below 0.25 to 0.3 is good.

        The mean of the measured response is subtracted, except for spectra. Source: R. V. Jategaonkar, *Flight Vehicle
        System Identification*, section 11.2.
        """
        parts = (self.residuals, self.measured - self._middle, self.fitted - self._middle)
        error, measured, fitted = (np.sqrt(_squares(part)) for part in parts)
        return error / (measured + fitted)

    @property
    def autocorrelation(self) -> Float[np.ndarray, "lag response"]:
        """Autocorrelation of each response's residuals at the lags 0 (value 1) to a fifth of the number of samples."""
        gamma = autocovariances(np.real(self.residuals), len(self.measured) // 5)
        autocovariance = np.diagonal(gamma, axis1=1, axis2=2)
        return autocovariance / autocovariance[0]

    @property
    def whiteness(self) -> Whiteness | None:
        """Autocorrelation of the residuals with the 95 % bound for white residuals; None in the frequency domain."""
        bound = 1.96 / float(np.sqrt(len(self.measured)))
        return None if self.is_spectrum else Whiteness(self.autocorrelation[1:], bound)

    @property
    def _middle(self) -> Inexact[np.ndarray, " response"]:
        """Mean of the measured responses; 0 for Fourier transforms."""
        return np.mean(self.measured, axis=0) * (not self.is_spectrum)


def _squares(samples: Samples) -> Float[np.ndarray, " response"]:
    return np.sum(np.abs(samples) ** 2, axis=0)


def autocovariances(
    residuals: Float[np.ndarray, "sample response"], lag_max: int
) -> Float[np.ndarray, "lag response response_2"]:
    """Return the autocovariances of residuals v at the lags 0 to `lag_max` samples; the mean is not subtracted.

    At each lag, the value is the sum of v_i v_(i + lag)^T divided by the number of all samples. With this divisor, the
    Fourier transform of the autocovariances is positive semidefinite.
    """
    count = len(residuals)
    return np.stack([residuals[: count - lag].T @ residuals[lag:] for lag in range(lag_max + 1)]) / count
