"""Identification of an aircraft from a recorded flight: model, parameters with intervals, fit, validation, files."""

import dataclasses
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from anser.aircraft.airframe import AbstractAirframe
from anser.aircraft_files.library import is_aircraft_path
from anser.aircraft_files.schema import AirframeFile
from anser.aircraft_files.sources import LIBRARY_FILES, library_file, read_airframe
from anser.airframe_data import COEFFICIENTS
from anser.compiling.options import enable_compilation_cache
from anser.files import result_folder, write_file
from anser.identification.aircraft_file import aircraft_file_text, slug
from anser.identification.alignment import align_record
from anser.identification.coefficients import airframe_derivatives
from anser.identification.estimates import COLLINEARITY_NOTABLE, Estimate, parameter_variables, table_entries
from anser.identification.estimation import METHODS, estimate, fit_model, jump_cautions
from anser.identification.fits import Fit, PrintedTable
from anser.identification.models import LATERAL, LONGITUDINAL, MODELS, ModelData, arrange
from anser.identification.records import FlightRecord, flight_record, read_columns
from anser.results.documents import software_versions, version_attributes, write_json
from anser.results.netcdf import write_netcdf
from anser.results.variable_labels import unit_attributes
from anser.single_aircraft.model import AircraftModel
from anser.single_aircraft.model import aircraft as load_aircraft

_FIT_MIN = 0.8
"""Least coefficient of determination of a response without a caution."""


@dataclasses.dataclass(frozen=True, repr=False)
class Identification(PrintedTable):
    """Result of `anser.identify`: estimated parameters and fit; prints as a table of parameters with 95 % intervals.

    Attributes
    ----------
    model, method
        Model structure and method of estimation, as in `anser.identify`.
    estimates
        Estimate of each equation of the model; a single one for `output-error` and `filter-error`.
    fit
        Measured and modelled responses of the identified flight over time.
    validation
        Measured and predicted responses of the validation manoeuvre; None: no validation.
    data
        Record of the flight with the equations of the model.
    aircraft
        Aircraft with known mass properties, lengths and engine; None: linear model without an aircraft.
    """

    model: str
    method: str
    estimates: tuple[Estimate, ...]
    fit: Fit
    validation: Fit | None
    data: ModelData
    aircraft: AircraftModel | None

    def __getitem__(self, name: str) -> float:
        """Return the value of a parameter by its name; raises KeyError if the parameter is not estimated."""
        if name not in self.parameters:
            raise KeyError(f"{name!r} is not estimated; the names are {', '.join(self.parameters)}")
        return self.parameters[name]

    @property
    def parameters(self) -> dict[str, float]:
        """Values of all parameters by name, in SI units and radians."""
        return {name: value for estimate in self.estimates for name, value in estimate.parameters.items()}

    @property
    def record(self) -> FlightRecord:
        """Record of the flight, without the delays that were removed."""
        return self.data.record

    @property
    def notes(self) -> tuple[str, ...]:
        """Remarks on the record and on parameters without estimate; cautions on poor fit, collinearity, jumps."""
        cautions = [
            f"Caution: the model explains {100.0 * max(r2, 0.0):.0f} % of {name}. Its parameters and intervals are not "
            "to be trusted: too little excitation, too few samples per second, or a model that lacks an effect."
            for name, r2 in zip(self.fit.responses, self.fit.r_squared, strict=True)
            if r2 < _FIT_MIN
        ]
        cautions += [
            f"Caution: parameters of {', '.join(estimate.responses)} are hard to tell apart (condition number "
            f"{estimate.condition_number:.0f}); the correlation of the errors shows which."
            for estimate in self.estimates
            if estimate.condition_number > COLLINEARITY_NOTABLE
        ]
        estimator_notes = [note for estimate in self.estimates for note in estimate.notes]
        cautions += jump_cautions(self.record, self.method)
        return (*self.record.notes, *self.data.notes, *estimator_notes, *cautions)

    @property
    def title(self) -> str:
        """Title of tables and reports: aircraft, model, duration of the record (s) and method."""
        name = "" if self.aircraft is None else f"{self.aircraft.identity['aircraft']}: "
        return f"{name}{self.model} from {self.record.time_s[-1] - self.record.time_s[0]:g} s ({self.method})"

    def rows(self) -> list[dict[str, Any]]:
        """Return a row per parameter; see `Estimate.rows`."""
        return [row for estimate in self.estimates for row in estimate.rows()]

    def fit_rows(self) -> list[dict[str, Any]]:
        """Return a row per response: R^2 and Theil's inequality coefficient, of the fit and of any validation."""
        rows: list[dict[str, Any]] = [{"response": name} for name in self.fit.responses]
        for prefix, fit in (("", self.fit), ("validation_", self.validation)):
            if fit is None:
                continue
            for measure in ("r_squared", "theil_inequality"):
                values = dict(zip(fit.responses, map(float, getattr(fit, measure)), strict=True))
                for row in rows:
                    row[f"{prefix}{measure}"] = values.get(row["response"])
        return rows

    def _table(self) -> tuple[str, list[dict[str, str]], list[str]]:
        fits = []
        for row in self.fit_rows():
            other = row.get("validation_r_squared")
            text = "" if other is None else f", validation R2 {other:.4f}"
            fits.append(f"{row['response']}: R2 {row['r_squared']:.4f}, TIC {row['theil_inequality']:.3f}{text}")
        return self.title, table_entries(self.rows()), [*fits, *self.notes]

    @property
    def dataset(self) -> xr.Dataset:
        """Dataset: parameters, correlation of the errors, responses over time, autocorrelation of the residuals."""
        data = parameter_variables(self.estimates)
        for prefix, fit in (("", self.fit), ("validation_", self.validation)):
            if fit is None:
                continue
            time, response = f"{prefix}time", f"{prefix}response"
            data[response] = np.array(fit.responses)
            data[time] = (time, fit.sample_points, unit_attributes("s", "Time"))
            for name, values in (("measured", fit.measured), ("modelled", fit.fitted)):
                attributes = unit_attributes("", f"{name.capitalize()} response")
                data[f"{prefix}{name}"] = ((time, response), values, attributes)
        autocorrelation = self.fit.autocorrelation
        label = unit_attributes("1", "Autocorrelation of the residuals")
        data["autocorrelation"] = (("lag", "response"), autocorrelation, label)
        data["lag"] = ("lag", np.arange(len(autocorrelation)) * self.record.step_s, unit_attributes("s", "Lag"))
        identity = {} if self.aircraft is None else dict(self.aircraft.identity)
        attributes = {"model": self.model, "method": self.method, "notes": "\n".join(self.notes), "title": self.title}
        return xr.Dataset(data, attrs={**identity, **attributes, **version_attributes()})

    def document(self) -> dict[str, Any]:
        """Return parameters (SI units, radians), fit, notes and versions as plain data, for JSON."""
        return {
            "format_version": 1,
            "aircraft": {} if self.aircraft is None else dict(self.aircraft.identity),
            "model": self.model,
            "method": self.method,
            "units": "SI and radians",
            "samples": int(self.record.time_s.size),
            "parameters": self.rows(),
            "responses": self.fit_rows(),
            "notes": list(self.notes),
            "provenance": software_versions(),
        }

    def aircraft_file(self, name: str | None = None) -> str:
        """Return the text of an aircraft file with the estimated derivatives, ready to fly.

        Derivatives without an estimate, mass, geometry, actuators and engine are taken from the known aircraft. A
        lateral constant (`CY0`, `Cl0`, `Cn0`) is set to zero if its 95 % interval contains zero. The default of `name`
        is made from the known aircraft's name.

        Raises ValueError if the model is not `derivatives`, or the engine's power does not follow the throttle.
        """
        if self.model != "derivatives" or self.aircraft is None:
            raise ValueError(f"aircraft_file: arrived the model {self.model}; expected the model derivatives")
        rows = {row["name"]: row for row in self.rows()}
        # Without evidence of the contrary an aircraft is symmetric.
        symmetric = [
            f"{row}0" for row in LATERAL if f"{row}0" in rows and rows[f"{row}0"]["low"] < 0.0 < rows[f"{row}0"]["high"]
        ]
        estimated = {name: value for name, value in self.parameters.items() if name not in symmetric}
        return aircraft_file_text(
            name or slug(f"{self.aircraft.identity['aircraft']}-estimated"),
            self.record,
            self.aircraft.airframe,
            _file_of(str(self.aircraft.identity["aircraft"])),
            estimated,
            _assumed(self.data, self.aircraft.airframe, self.parameters),
            f"anser.identify, from a flight of {self.title}",
        )

    def save(self, folder: str | os.PathLike[str], *, force: bool = False) -> Path:
        """Write dataset, JSON document, page, figures and (model `derivatives`) an aircraft file; return the folder.

        Raises FileExistsError if the folder exists and `force` is False.
        """
        with result_folder(Path(folder), replace=force) as staging:
            self.write_into(staging)
        return Path(folder)

    def write_into(self, folder: Path) -> None:
        """Write the files of `save` into an existing folder; raises FileExistsError if one of the files exists."""
        from anser.report.identification_figures import write_identification_report

        dataset = self.dataset
        write_netcdf(dataset, folder / "identification.nc")
        write_json(self.document(), folder / "identification.json")
        write_identification_report(dataset, self.fit_rows(), folder)
        if self.model == "derivatives":
            write_file(folder / "aircraft.toml", self.aircraft_file())


def identify(
    recording: Any,
    model: str = "derivatives",
    *,
    aircraft: Any = None,
    method: str = "frequency",
    validate: Any = None,
    columns: Mapping[str, Any] | str | os.PathLike[str] | None = None,
    accelerometer_m: tuple[float, float, float] = (0.0, 0.0, 0.0),
    aircraft_name: str | None = None,
    window_s: tuple[float, float] | None = None,
    frequency_max_hz: float = 1.5,
    align: bool = True,
) -> Identification:
    """Estimate the parameters of an aircraft model from a recorded flight, with intervals, fit and validation.

    Parameters
    ----------
    recording
        Flight of this package, dataset, table, or path of a file: see `anser.identification.flight_record`.
    model
        - `short-period`: linear equations of the rates of alpha and q
        - `lateral`: linear equations of the rates of beta, p and r
        - `derivatives`: derivatives of the aerodynamic coefficients, as in an aircraft file
    aircraft
        Aircraft with known mass, inertia, lengths and engine: name, path of an aircraft file, airframe or
        `AircraftModel`. None: the aircraft named in the recording's attributes, if any; the model `derivatives` needs
        one.
    method
        - `frequency`: regression of Fourier transforms
        - `equation-error`: regression in time
        - `output-error`: maximum likelihood of the integrated responses, for linear models
        - `filter-error`: like `output-error`, with noise in the rates
    validate
        Recording of a second manoeuvre, whose responses are predicted; derivatives without an estimate are taken from
        the aircraft.
    columns
        Map from names of the catalogue to columns of the recordings, or the path of a TOML file with the map: see
        `anser.identification.flight_record`.
    accelerometer_m
        Position of the accelerometers relative to the centre of gravity, body axes, m.
    aircraft_name
        Name of the aircraft to take from a recording of several aircraft.
    window_s
        Start and end of the part of `recording` that is used, s; None: all. `validate` is used entirely.
    frequency_max_hz
        Highest frequency that the method `frequency` uses, Hz.
    align
        True: constant delays between the channels are removed, and wrong units are refused.

    Raises
    ------
    ValueError
        If an argument is not valid, a recording lacks a channel or excitation, a unit is wrong, or the estimation
        fails.
    """
    for option, value, known in (("model", model, MODELS), ("method", method, METHODS)):
        if value not in known:
            raise ValueError(f"{option}: arrived {value!r}; expected one of {', '.join(known)}")
    enable_compilation_cache()
    columns = read_columns(columns) if isinstance(columns, str | os.PathLike) else columns
    record = flight_record(recording, columns, aircraft_name=aircraft_name)
    record = record if window_s is None else record.window(*window_s)
    vehicle = _resolve(aircraft, record, aircraft_name)
    if model == "derivatives" and vehicle is None:
        raise ValueError(
            "aircraft: arrived none, and the recording names none; expected an aircraft with known mass, inertia and "
            "reference lengths, such as the path of an aircraft file"
        )
    airframe = None if vehicle is None else vehicle.airframe
    gusts = method in METHODS[:2]

    def arranged(record: FlightRecord) -> ModelData:
        aligned = align_record(record, accelerometer_m=accelerometer_m) if align else record
        return arrange(model, aligned, airframe, accelerometer_m, gusts=gusts)

    data = arranged(record)
    estimates = estimate(data, method, frequency_max_hz)
    parameters = {name: value for solution in estimates for name, value in solution.parameters.items()}
    if model == "derivatives" and airframe is not None:
        parameters |= _assumed(data, airframe, parameters)
    validation = None
    if validate is not None:
        other = arranged(flight_record(validate, columns, aircraft_name=aircraft_name))
        estimated = {equation.response for equation in data.equations}
        common = tuple(equation for equation in other.equations if equation.response in estimated)
        if not common:
            raise ValueError(
                f"validate: arrived a manoeuvre that excites none of {', '.join(sorted(estimated))}; expected one that "
                "excites an estimated response"
            )
        validation = fit_model(other._replace(equations=common), parameters)
    return Identification(model, method, estimates, fit_model(data, parameters), validation, data, vehicle)


def _assumed(data: ModelData, airframe: AbstractAirframe, parameters: Mapping[str, float]) -> dict[str, float]:
    """Return the known aircraft's derivatives, by name, for derivatives that are not estimated.

    Constants and flow and rate derivatives that are zero in a symmetric aircraft, such as `CY0` and `CL_beta`, are
    omitted; also constants of estimated coefficients.
    """
    own, surfaces = airframe_derivatives(airframe, data.record), airframe.actuators.names
    estimated = {equation.response for equation in data.equations}
    keys = [
        f"{row}{end}" for row in LONGITUDINAL for end in ("0", "_alpha", "_q") if row not in estimated or end != "0"
    ]
    keys += [f"{row}_{flow}" for row in LATERAL for flow in ("beta", "p", "r")]
    keys += [f"{row}_{name}" for row in COEFFICIENTS for name in surfaces]
    return {key: own[key] for key in keys if key not in parameters}


def _resolve(aircraft: Any, record: FlightRecord, aircraft_name: str | None) -> AircraftModel | None:
    """Return the aircraft given by `aircraft` or by the attributes of the record; None if neither names an aircraft."""
    if isinstance(aircraft, AircraftModel):
        return aircraft
    if aircraft is not None:
        return load_aircraft(aircraft)
    attributes = dict(record.attributes)
    aircraft_name = attributes.get("aircraft_name", aircraft_name)
    if "scenario" in attributes:
        tables = json.loads(str(attributes["scenario"]))["aircraft"]
        table = next((entry for entry in tables if aircraft_name in (None, entry["name"])), None)
        if table is None or table.get("airframe") is not None:
            return None
        attributes = {key: table.get(key) for key in ("variant", "x_cg_over_c")} | {"aircraft": table["type"]}
    name = str(attributes.get("aircraft", "custom"))
    if name == "custom" or (is_aircraft_path(name) and not Path(name).is_file()):
        return None
    x_cg_over_c = attributes.get("x_cg_over_c")
    variant = str(attributes.get("variant") or "textbook")
    return load_aircraft(name, variant, x_cg_over_c=None if x_cg_over_c is None else float(x_cg_over_c))


def _file_of(name: str) -> AirframeFile | None:
    """Return the aircraft file of a library name or a path; None for an aircraft without a file of derivatives."""
    file = library_file(name) if name in LIBRARY_FILES else read_airframe(name) if is_aircraft_path(name) else None
    return file if isinstance(file, AirframeFile) else None
