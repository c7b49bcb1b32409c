"""Distributions of dispersed parameters: keys of a table [[vary]], and values from cumulative probabilities."""

from typing import Annotated, Literal

import numpy as np
from pydantic import Field
from scipy import stats

from anser.config.errors import Problem, describe_value, format_number
from anser.config.tables import Table, expects, number, ordering_problems

_LARGEST = 1e9
_FARTHEST_SIGMA = 8.0
_PATH = 'a path of the scenario in quotes, such as "wind.speed_m_s" or "aircraft[0].start.speed_m_s"'
_KEYS = {
    "normal": ("mean", "sigma"),
    "truncated": ("mean", "sigma", "low", "high"),
    "uniform": ("low", "high"),
    "log-normal": ("median", "sigma"),
    "triangular": ("low", "mode", "high"),
    "choice": ("values",),
}
"""Required keys of each distribution by name; `weights` of a choice is optional."""

DistributionName = Literal["normal", "truncated", "uniform", "log-normal", "triangular", "choice"]
Value = float | int | str | bool


def _bound(description: str) -> float | None:
    return number(description, -_LARGEST, _LARGEST, "", None)


class Dispersion(Table):
    """Dispersion of one scenario parameter."""

    path: str = Field(
        min_length=1, description="path of the parameter in the scenario", json_schema_extra=expects(_PATH)
    )
    distribution: DistributionName = Field(description="distribution of the values")
    how: Literal["set", "add", "multiply"] = Field(
        default="set", description="whether a value replaces the scenario's value, is added to it or multiplies it"
    )
    mean: float | None = _bound("mean; of a truncated distribution the mean before truncation")
    median: float | None = number("median", 0, _LARGEST, "", None, exclusive_minimum=True)
    sigma: float | None = number(
        "standard deviation; of a log-normal distribution that of the natural logarithm, of a truncated distribution "
        "the value before truncation",
        *(0, _LARGEST, "", None),
        exclusive_minimum=True,
    )
    low: float | None = _bound("least value")
    mode: float | None = _bound("most frequent value")
    high: float | None = _bound("greatest value")
    values: tuple[Value, ...] | None = Field(
        None,
        min_length=1,
        strict=False,
        description="values to choose from",
        json_schema_extra=expects("a list of numbers, of texts or of true and false, one at least"),
    )
    weights: tuple[Annotated[float, Field(gt=0.0)], ...] | None = Field(
        None,
        strict=False,
        description="relative frequencies of the values; default: equal; not with a grid",
        json_schema_extra=expects("a list of numbers above 0, as many as there are values"),
    )

    def consistency_problems(self) -> list[Problem]:
        """Return the problems of missing, superfluous or contradictory keys; empty if the table is valid."""
        required = _KEYS[self.distribution]
        superfluous = {key for keys in _KEYS.values() for key in keys} - {*required}
        if self.distribution != "choice":
            superfluous.add("weights")
        keys_text = f"{self.distribution} has {', '.join(required)}"
        problems = [
            Problem(key, "nothing", f"a value: the distribution {keys_text}")
            for key in required
            if getattr(self, key) is None
        ]
        problems += [
            Problem(key, describe_value(getattr(self, key)), f"no such key: {keys_text}")
            for key in sorted(superfluous)
            if getattr(self, key) is not None
        ]
        if problems:
            return problems
        if self.distribution == "choice":
            return self._choice_problems()
        if self.low is not None:
            problems = ordering_problems(self, "low", "high", "")
        if not problems and self.mode is not None and not self.low <= self.mode <= self.high:  # pyright: ignore
            problems = [Problem("mode", format_number(self.mode), f"from low to high: {self.low:g} to {self.high:g}")]
        if not problems and self.distribution == "truncated":
            low, high = self._scaled_bounds()
            if max(low, -high) > _FARTHEST_SIGMA:
                arrived = f"{self.low:g} to {self.high:g}, all beyond {_FARTHEST_SIGMA:g} sigma"
                problems = [Problem("low", arrived, "bounds with a part of the distribution between them")]
        return problems

    def _choice_problems(self) -> list[Problem]:
        values, kinds = self.values or (), {_kind(value) for value in self.values or ()}
        problems = []
        if len(kinds) > 1:
            problems.append(Problem("values", " and ".join(sorted(kinds)), "values of one kind"))
        elif len(set(values)) < len(values):
            problems.append(Problem("values", "a value twice", "each once; weights say how often it is chosen"))
        elif self.how != "set" and kinds != {"numbers"}:
            problems.append(Problem("how", f'"{self.how}" for {kinds.pop()}', '"set"'))
        if self.weights is not None and len(self.weights) != len(values):
            problems.append(Problem("weights", f"a list of {len(self.weights)}", f"{len(values)}, one for each value"))
        return problems

    def quantile(self, shares: np.ndarray) -> np.ndarray:
        """Return the parameter's values at cumulative probabilities `shares` (0 to 1, exclusive); shape of `shares`.

        For "choice", the listed values divide the interval from 0 to 1 in proportion to their weights.
        """
        low, mode, high, mean, sigma = (getattr(self, key) for key in ("low", "mode", "high", "mean", "sigma"))
        match self.distribution:
            case "normal":
                return stats.norm.ppf(shares, mean, sigma)
            case "truncated":
                return np.clip(stats.truncnorm.ppf(shares, *self._scaled_bounds(), mean, sigma), low, high)
            case "uniform":
                return stats.uniform.ppf(shares, low, high - low)
            case "log-normal":
                return stats.lognorm.ppf(shares, sigma, scale=self.median)
            case "triangular":
                return stats.triang.ppf(shares, (mode - low) / (high - low), low, high - low)
        values = self.values or ()
        cumulative_weights = np.cumsum(np.ones(len(values)) if self.weights is None else self.weights)
        indices = np.searchsorted(cumulative_weights / cumulative_weights[-1], shares, side="right")
        return np.array(values)[np.minimum(indices, len(values) - 1)]

    @property
    def is_number(self) -> bool:
        """Whether the values are numbers, not texts or truth values."""
        return self.values is None or _kind(self.values[0]) == "numbers"

    def _scaled_bounds(self) -> tuple[float, float]:
        """Return (low - mean) / sigma and (high - mean) / sigma of a truncated normal distribution."""
        low, high, mean, sigma = (getattr(self, key) for key in ("low", "high", "mean", "sigma"))
        return (low - mean) / sigma, (high - mean) / sigma


def _kind(value: Value) -> str:
    if isinstance(value, bool):
        return "truth values"
    return "texts" if isinstance(value, str) else "numbers"
