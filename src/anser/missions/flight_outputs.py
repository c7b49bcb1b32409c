"""Outputs of a flight that a study defines: an expression over the flight's variables, reduced to one number."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from pydantic import Field

from anser.config.errors import Problem, describe_value
from anser.config.expressions import LENGTH_MAX, ExpressionError, parse_expression
from anser.config.tables import Table, expects, identifier, slug
from anser.numerics.arrays import cast_to_precision
from anser.parts.perception import Instant
from anser.results.documents import finite_or_none
from anser.results.variable_labels import to_dataset_units
from anser.scenario.schema import Scenario
from anser.shapes import Integer
from anser.simulation.closed_loop import HOLD
from anser.simulation.recorders import AbstractRecorder, FleetSample, record
from anser.variables import all_surface_names, catalogue

if TYPE_CHECKING:
    import xarray as xr

Reduction = Literal["greatest", "least", "mean", "integral", "final", "time"]
_EXTREMES = ("greatest", "least")


class FlightOutput(Table):
    """Output of each flight: an expression over the flight's variables, reduced over time to one number."""

    name: str = slug("name of the output, also of its column")
    expression: str = Field(
        min_length=1,
        max_length=LENGTH_MAX,
        description="expression over the flight's variables by their names in datasets; angles in degrees",
        json_schema_extra=expects(
            f'an expression of at most {LENGTH_MAX} characters in quotes, such as "abs(bank_deg)"'
        ),
    )
    reduction: Reduction = Field(
        description="reduction over time: the greatest, the least, the mean or the final value, the integral over "
        "time, or the time (s) for which a condition holds"
    )
    aircraft: str | None = identifier(
        "name of the aircraft; left out: greatest and least of the whole fleet", "the name of an aircraft", None
    )
    until: Literal["end", "arrival"] = Field(
        default="end", description="end of the samples: the end of the flight, or the start of the aircraft's hold"
    )
    unit: str = Field(
        "",
        max_length=32,
        description="unit of the output in labels; left out: s for a time, otherwise none",
        json_schema_extra=expects("a text in quotes, at most 32 characters"),
    )

    def consistency_problems(self) -> list[Problem]:
        """Return the problems of the expression and the reduction; empty if valid.

        A condition requires the reduction "time", and this reduction requires a condition.
        """
        try:
            expression = parse_expression(self.expression)
        except ExpressionError as error:
            return [Problem("expression", error.arrived, error.expected)]
        if expression.is_condition and self.reduction != "time":
            return [Problem("reduction", describe_value(self.reduction), '"time", for the expression is a condition')]
        if not expression.is_condition and self.reduction == "time":
            expected = 'a condition, such as "abs(bank_deg) > 30", for the reduction is "time"'
            return [Problem("expression", f"{describe_value(self.expression)}, which is a number", expected)]
        return []

    @property
    def is_upper(self) -> bool:
        """Whether greater values count as worse: for every reduction but "least"."""
        return self.reduction != "least"

    @property
    def labels(self) -> tuple[str, str]:
        """Unit and description of the output, for datasets and pages."""
        verb = "time of" if self.reduction == "time" else self.reduction
        aircraft = "" if self.aircraft is None else f" of {self.aircraft}"
        until = " until the arrival" if self.until == "arrival" else ""
        unit = self.unit or ("s" if self.reduction == "time" else "1")
        return unit, f"{self.name}: {verb} {self.expression}{aircraft}{until}"


class OutputFormula(NamedTuple):
    """Output of a study for a certain fleet, with the methods that compute the output during or after a flight."""

    expression: str  # expression over variables by their names in datasets
    reduction: Reduction  # reduction over time
    aircraft: int | None  # index of the aircraft; None: all
    until_arrival: bool  # whether samples in the hold are left out

    def partial(self, values: Mapping[str, Any], weights: Any, xp: Any) -> tuple[Any, Any]:
        """Reduce some consecutive samples to the pair (running value, weight), for `combine` and `finish`.

        Samples without a value (NaN) do not count, except for "final". If a variable of the expression is missing, the
        pair is (NaN, 0).

        `values` are arrays (time, aircraft) in dataset units by dataset name; `weights`, (time,), is the duration of
        each sample, s; `xp` is `numpy` or `jax.numpy`.
        """
        expression = parse_expression(self.expression)
        if any(name not in values for name in expression.names):
            return xp.asarray(np.nan), xp.asarray(0.0)
        result = expression.evaluate(values, xp) * 1.0  # a condition counts as 1 where it holds
        included = values["phase"] != HOLD if self.until_arrival else xp.ones(result.shape, dtype=bool)
        if self.aircraft is not None:
            result, included = (array[:, self.aircraft, None] for array in (result, included))
        if self.reduction == "final":  # one aircraft: the last included sample
            last = included.shape[0] - 1 - xp.argmax(included[::-1, 0])
            return result[last, 0], xp.any(included) * 1.0
        included = included & ~xp.isnan(result)
        if self.reduction in _EXTREMES:
            sign = 1.0 if self.reduction == "greatest" else -1.0
            return xp.max(xp.where(included, sign * result, -np.inf)), xp.asarray(0.0)
        seconds = xp.where(included, weights[:, None], 0.0)
        return xp.sum(xp.where(included, result * seconds, 0.0)), xp.sum(seconds)

    @property
    def start(self) -> tuple[float, float]:
        """Pair (running value, weight) before the first sample."""
        return (-np.inf if self.reduction in _EXTREMES else 0.0), 0.0

    def combine(self, earlier: tuple[Any, Any], later: tuple[Any, Any]) -> tuple[Any, Any]:
        """Combine the pair (running value, weight) of earlier samples with the pair of later samples."""
        (value, weight), (later_value, later_weight) = earlier, later
        if self.reduction in _EXTREMES:
            return jnp.maximum(value, later_value), weight
        if self.reduction == "final":
            return jnp.where(later_weight > 0.0, later_value, value), jnp.maximum(weight, later_weight)
        return value + later_value, weight + later_weight

    def finish(self, value: float, weight: float) -> float | None:
        """Return the output from the running value and weight of a whole flight; None if there is no finite value."""
        if self.reduction in _EXTREMES:
            return finite_or_none(value if self.reduction == "greatest" else -value)
        if weight <= 0.0 and self.reduction != "time":
            return None
        return finite_or_none(value / weight if self.reduction == "mean" else value)


class OutputRecording(eqx.Module):
    """Selection of the outputs that are computed for many flights during the flights."""

    formulas: tuple[tuple[str, OutputFormula], ...] = eqx.field(static=True)  # (name of the output, formula)

    @classmethod
    def of_study(cls, outputs: Sequence[FlightOutput], scenario: Scenario) -> "OutputRecording | None":
        """Return the selection of a study's outputs for the fleet of a scenario; None if there are no outputs."""
        names = [aircraft.name for aircraft in scenario.aircraft]

        def formula(o: FlightOutput) -> OutputFormula:
            index = None if o.aircraft is None else names.index(o.aircraft)
            return OutputFormula(o.expression, o.reduction, index, o.until == "arrival")

        return cls(tuple((o.name, formula(o)) for o in outputs)) if outputs else None

    def recorder(self, inner: AbstractRecorder, last_sample: Integer | None) -> "OutputRecorder":
        """Return a recorder that adds the outputs to the recorder `inner`; samples after `last_sample` do not count."""
        formulas = tuple(formula for _, formula in self.formulas)
        return OutputRecorder(inner=inner, formulas=formulas, last_sample=last_sample, stride=inner.stride)

    def values(self, output_state: Sequence[tuple[Any, Any]], index: int) -> dict[str, float | None]:
        """Return the outputs of the flight `index` of a batch by name, from the recorder state at the end."""
        return {
            name: formula.finish(float(value[index]), float(weight[index]))
            for (name, formula), (value, weight) in zip(self.formulas, output_state, strict=True)
        }

    def values_from_dataset(self, dataset: "xr.Dataset", step_s: float) -> dict[str, float | None]:
        """Return the outputs by name, from the dataset of a flight recorded at every step; `step_s` in s."""
        weights = np.full(dataset.sizes["time"], step_s)
        weights[-1] = 0.0
        arrays = {str(name): values.values for name, values in dataset.items()}
        with np.errstate(all="ignore"):  # a division by zero has no value, as in the compiled loop
            return {
                name: formula.finish(*map(float, formula.partial(arrays, weights, np)))
                for name, formula in self.formulas
            }


class OutputRecorder(AbstractRecorder):
    """Recorder that adds outputs to an inner recorder; recorder state: the pair (inner state, running values)."""

    inner: AbstractRecorder  # recorder that stores the rows
    formulas: tuple[OutputFormula, ...] = eqx.field(static=True)
    last_sample: Integer | None  # number of the last sample that counts; None: no limit
    stride: int = eqx.field(static=True)  # steps between two rows of the inner recorder

    def init(self, aircraft: int) -> tuple[Any, Any]:
        """Return the pair (state of the inner recorder, running values) at the start; `aircraft`: size of the fleet."""
        running = tuple((jnp.asarray(value), jnp.asarray(weight)) for value, weight in (f.start for f in self.formulas))
        return self.inner.init(aircraft), running

    def update(self, recorder_state: tuple[Any, Any], sample: FleetSample, instant: Instant) -> tuple[Any, Any]:
        """Return the pair (state of the inner recorder, running values) after one more sample."""
        inner_state, running = recorder_state

        def extended() -> tuple[Any, ...]:
            rows = cast_to_precision(sample.rows(record), float)
            surfaces = all_surface_names(group.truth.airframe.actuators.names for group in sample.groups)
            variables = {
                v.name: to_dataset_units(v, rows[v.key], jnp)[None] for v in catalogue(surfaces) if v.key in rows
            }
            is_last = False if self.last_sample is None else instant.number == self.last_sample
            weights = jnp.where(is_last, 0.0, cast_to_precision(instant.step, float))[None]
            return tuple(
                formula.combine(state, formula.partial(variables, weights, jnp))
                for formula, state in zip(self.formulas, running, strict=True)
            )

        if self.last_sample is None:
            next_running = extended()
        else:
            next_running = jax.lax.cond(instant.number <= self.last_sample, extended, lambda: running)
        return self.inner.update(inner_state, sample, instant), next_running

    def output(self, sample: FleetSample, instant: Instant) -> Any:
        """Return the row that the inner recorder stores for a sample; the outputs store no rows."""
        return self.inner.output(sample, instant)
