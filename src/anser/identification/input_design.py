"""Design of experiments: predicted standard errors of the parameters that a planned manoeuvre will identify."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr
from jaxtyping import ArrayLike, Float

from anser.identification.dynamic_models import DynamicModel, make_manoeuvre, prepare_parameters
from anser.identification.estimates import collinearity
from anser.identification.fits import PrintedTable
from anser.parts.input_signals import InputSignal
from anser.results.variable_labels import unit_attributes


@dataclass(frozen=True, repr=False)
class PlannedManoeuvre(PrintedTable):
    """Predicted errors of the parameters that a planned manoeuvre will identify; prints as a table.

    Attributes
    ----------
    names, values
        Names of the parameters, and their assumed values.
    information
        Fisher's information matrix; the inverse is the Cramer-Rao bound of the covariance.
    condition_number, variance_inflation
        Collinearity of the sensitivities: see `Estimate`.
    time_s, outputs, output_names
        Times of the samples, s, and predicted outputs in the model's units, with their names.
    """

    names: tuple[str, ...]
    values: Float[np.ndarray, " parameter"]
    information: Float[np.ndarray, "parameter parameter"]
    condition_number: float
    variance_inflation: Float[np.ndarray, " parameter"]
    time_s: Float[np.ndarray, " sample"]
    outputs: Float[np.ndarray, "sample output"]
    output_names: tuple[str, ...]

    @property
    def covariance(self) -> Float[np.ndarray, "parameter parameter"]:
        """Cramer-Rao bound of the parameters' covariance for white noise of the outputs, in the parameters' units."""
        return np.linalg.inv(self.information)

    @property
    def standard_errors(self) -> Float[np.ndarray, " parameter"]:
        """Predicted standard errors of the parameters, in their units."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def correlation(self) -> Float[np.ndarray, "parameter parameter"]:
        """Predicted correlation coefficients of the errors of the parameters, -1 to 1."""
        return self.covariance / np.outer(self.standard_errors, self.standard_errors)

    @property
    def dataset(self) -> xr.Dataset:
        """Predicted errors, correlation, information and outputs as a labelled dataset."""
        one, pair = ("parameter",), ("parameter", "parameter_2")
        variables = {
            "assumed_value": (one, self.values, "Assumed value"),
            "standard_error": (one, self.standard_errors, "Predicted standard error"),
            "variance_inflation": (one, self.variance_inflation, "Factor on the variance from collinearity"),
            "information": (pair, self.information, "Information"),
            "correlation": (pair, self.correlation, "Predicted correlation of the errors"),
            "output": (("time", "response"), self.outputs, "Predicted output"),
        }
        names = np.array(self.names)
        coordinates = {"parameter": names, "parameter_2": names, "response": np.array(self.output_names)}
        return xr.Dataset(
            {key: (axes, values, unit_attributes("", label)) for key, (axes, values, label) in variables.items()},
            coordinates | {"time": ("time", self.time_s, unit_attributes("s", "Time"))},
            {"condition_number": self.condition_number},
        )

    def _table(self) -> tuple[str, list[dict[str, str]], list[str]]:
        columns = zip(self.names, self.values, self.standard_errors, self.variance_inflation, strict=True)
        entries = [
            {
                "parameter": name,
                "assumed": f"{value:.4g}",
                "standard error": f"{error:.2g}",
                "relative": f"{100.0 * error / abs(value):.2g} %" if value else "",
                "variance inflation": f"{inflation:.3g}",
            }
            for name, value, error, inflation in columns
        ]
        ranges = zip(self.output_names, self.outputs.min(axis=0), self.outputs.max(axis=0), strict=True)
        texts = [f"{name} {low:.3g} to {high:.3g}" for name, low, high in ranges]
        remarks = [f"condition number {self.condition_number:.3g}", f"outputs: {', '.join(texts)}"]
        return f"planned manoeuvre of {self.time_s[-1] - self.time_s[0]:g} s", entries, remarks


def plan_manoeuvre(
    model: DynamicModel,
    parameters: Mapping[str, float],
    time_s: ArrayLike,
    inputs: Mapping[str, InputSignal | Sequence[float] | Float[np.ndarray, " sample"]],
    noise: Mapping[str, float],
    *,
    fixed: Mapping[str, float] | None = None,
    initial_state: ArrayLike | None = None,
    initial_states: Sequence[str] = (),
    held: bool = True,
) -> PlannedManoeuvre:
    """Predict how well a manoeuvre will identify parameters: Fisher information, standard errors and correlation.

    The information is the sum of S^T R^-1 S over the samples, with the sensitivities S of the outputs to the parameters
    and the covariance R of the measurement noise. Source: V. Klein, E. A. Morelli, *Aircraft System Identification*,
    AIAA 2006, chapters 6 and 9.

    Parameters
    ----------
    model
        Model, linear or not, such as `short_period_model`.
    parameters
        Assumed values of the parameters to be estimated, by name.
    time_s
        Times of the samples, s, with equal steps.
    inputs
        Input signal, or its samples, by the input's name, in the model's units; inputs without an entry are zero.
    noise
        Standard deviation of the measurement noise of every output, by name, in the model's units.
    fixed
        Values of the model's remaining parameters, by name.
    initial_state
        State at the first sample, shape (state,); None: zero.
    initial_states
        Names of the states whose initial value is estimated too, as the parameter `STATE(0)`.
    held
        True: an input is constant over the step after its sample. False: straight lines between the samples.

    Raises
    ------
    ValueError
        If a name is unknown, a number or shape is not valid, an output diverges, or the outputs do not determine the
        parameters; the message names the parameters.
    """
    times = np.asarray(time_s, dtype=float)
    if not set(inputs) <= set(model.inputs) or not inputs:
        raise ValueError(f"inputs: arrived {list(inputs)}; expected some of {', '.join(model.inputs)}")
    if set(noise) != set(model.outputs) or not all(0.0 < level < np.inf for level in noise.values()):
        raise ValueError(f"noise: arrived {dict(noise)}; expected positive numbers for {', '.join(model.outputs)}")
    columns = np.zeros((times.size, len(model.inputs)))
    for name, values in inputs.items():
        column = values(times) if isinstance(values, InputSignal) else np.asarray(values, dtype=float)
        if np.shape(column) != times.shape:
            raise ValueError(f"inputs: arrived {name} of shape {np.shape(column)}; expected {times.shape}, like time_s")
        columns[:, model.inputs.index(name)] = column
    unmeasured = np.zeros((times.size, len(model.outputs)))
    manoeuvre = make_manoeuvre(model, times, columns, unmeasured, initial_state, held=held)
    prepared, assumed = prepare_parameters(model, manoeuvre, parameters, fixed, initial_states)
    prediction = prepared.predict(assumed, manoeuvre)
    levels = np.array([float(noise[name]) for name in model.outputs])
    S = (prediction.sensitivities / levels[:, None]).reshape(-1, assumed.size)
    information = S.T @ S
    checked = collinearity(information, prepared.names, "planned manoeuvre")
    return PlannedManoeuvre(
        names=prepared.names,
        values=assumed,
        information=information,
        **checked._asdict(),
        time_s=times,
        outputs=prediction.outputs,
        output_names=model.outputs,
    )
