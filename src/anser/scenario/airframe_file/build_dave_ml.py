"""From an aircraft file that names DAVE-ML files to its airframe."""

import functools
from collections.abc import Mapping, Sequence

import jax

from anser.aircraft import (
    AERO_LENGTHS,
    AERO_OUTPUTS,
    ENGINE_OUTPUTS,
    ENGINE_POWER,
    INERTIA_OUTPUTS,
    KNOWN_INPUTS,
    DaveMlAircraft,
    air_data,
    body_faults_of,
    dave_ml_airframe,
)
from anser.dave_ml import ANGLE, DaveMlError, Model, adapted, read_dave_ml, refuse_other_units
from anser.environment import StandardAtmosphere
from anser.numerics import as_array
from anser.scenario.airframe_file.build_parts import build_actuators, build_engine, build_mass, build_validity
from anser.scenario.airframe_file.schema_dave_ml import PARTS, DaveMlFile
from anser.scenario.errors import Problem, show
from anser.units import DEG_RAD

_WANTED: Mapping[str, Sequence[str]] = {
    "aerodynamics": (*AERO_OUTPUTS, *AERO_LENGTHS),
    "inertia": INERTIA_OUTPUTS,
    "propulsion": ENGINE_OUTPUTS,
}


def file_models(file: DaveMlFile) -> dict[str, Model]:
    """The DAVE-ML files of an aircraft as they are, by what they are of."""
    return {part: _read(text.text, text.file) for part in PARTS if (text := getattr(file.dave_ml, part)) is not None}


@functools.lru_cache(maxsize=32)
def _read(text: str, name: str) -> Model:
    return read_dave_ml(text, name)


def build_dave_ml(file: DaveMlFile) -> DaveMlAircraft:
    """Build the airframe of a file that was validated."""
    models = {part: _adapted(file, model) for part, model in file_models(file).items()}
    offset = file.dave_ml.cg_offset_m or (0.0, 0.0, 0.0)
    low, high = file.validity.alpha_deg
    left, right = file.validity.beta_deg
    return dave_ml_airframe(
        models["aerodynamics"],
        models["inertia"] if file.mass is None else (build_mass(file.mass), as_array(offset)),
        models.get("propulsion") or build_engine(file.engine),
        build_actuators(file.surface),
        [one.moves for one in file.surface],
        alpha_range=(low * DEG_RAD, high * DEG_RAD),
        beta_range=(left * DEG_RAD, right * DEG_RAD),
        engine_lag=file.dave_ml.propulsion_lag_s or 0.0,
        validity=build_validity(file.validity),
    )


def _has(model: Model, name: str) -> bool:
    structure = model.evaluator.structure
    return name in structure.by_id or any(one.name == name for one in structure.quantities)


def _adapted(file: DaveMlFile, model: Model) -> Model:
    """A model by its standard names, with what is given."""
    names = {name: own for name, own in file.dave_ml.names.items() if _has(model, own)}
    return adapted(model, names, {name: value for name, value in file.dave_ml.given.items() if _has(model, name)})


def model_problems(file: DaveMlFile) -> list[Problem]:
    """What of the DAVE-ML files of a valid aircraft file cannot be read, is not there, or does not fit together."""
    try:
        raw = file_models(file)
    except DaveMlError as error:
        part = next(part for part in PARTS if (text := getattr(file.dave_ml, part)) and text.file == error.name)
        return [_problem_of(f"dave_ml.{part}", error)]
    found = []
    for key in ("names", "given"):
        for name, value in getattr(file.dave_ml, key).items():
            own = value if key == "names" else name
            if not any(_has(model, own) for model in raw.values()):
                words = "the varID or the name of a variable of one of the files"
                found.append(Problem(f"dave_ml.{key}.{name}", show(own), words))
    if found:
        return found
    try:
        models = {}
        for part, model in raw.items():
            try:
                models[part] = _adapted(file, model)
            except DaveMlError as error:
                return [_problem_of(f"dave_ml.{part}", error)]
        found = [
            *(problem for part, model in models.items() for problem in _missing(file, part, model)),
            *_of_inputs(file, models),
        ]
        if not found:
            faults = body_faults_of(models["aerodynamics"], models.get("inertia"), {})
            found = [_problem_of(f"dave_ml.{part}", fault) for part, fault in faults]
        if not found:
            jax.eval_shape(_everything, build_dave_ml(file))
    except ValueError as error:
        return [Problem("dave_ml", str(error), "files that make an aircraft together")]
    return found


def _problem_of(key: str, error: DaveMlError) -> Problem:
    where = error.name if error.line is None else f"{error.name}, line {error.line}, column {error.column}"
    return Problem(f"{key} ({where})", error.arrived, error.expected)


def _missing(file: DaveMlFile, part: str, model: Model) -> list[Problem]:
    missing = [name for name in _WANTED[part] if not _has(model, name)]
    if part == "propulsion" and not _has(model, ENGINE_POWER):
        missing.append(ENGINE_POWER)
    if not missing:
        return []
    words = "variables of these standard names, or what stands for them in [dave_ml.names]"
    arrived = f"{show(getattr(file.dave_ml, part).file)}, which has no {', '.join(missing)}"
    return [Problem(f"dave_ml.{part}", arrived, words)]


def _of_inputs(file: DaveMlFile, models: Mapping[str, Model]) -> list[Problem]:
    """Surfaces that move no input, and inputs that nothing gives."""
    found = []
    moved = [one.moves for one in file.surface]
    for part, model in models.items():
        structure, constants = model.evaluator.structure, model.evaluator.constants
        named = {structure.by_id[one].name: one for one in structure.inputs}
        known = [] if part == "inertia" else [*KNOWN_INPUTS, *([ENGINE_POWER] if part == "propulsion" else ())]
        wanted = {structure.find(name) for name in _WANTED[part] if _has(model, name)}
        needed = structure.needed_for(wanted, constants.keys())
        own = {name for one in moved for name in (one, *(n for n, i in named.items() if i == one))}
        if part == "aerodynamics":
            for k, one in enumerate(moved):
                if one not in named and one not in structure.inputs:
                    words = f"an input of {show(file.dave_ml.aerodynamics.file)}: {', '.join(sorted(named))}"
                    found.append(Problem(f"surface[{k}].input", show(one), words))
                    continue
                try:
                    refuse_other_units(model.definition.variables[structure.find(one)], ANGLE)
                except DaveMlError as error:
                    found.append(_problem_of(f"surface[{k}].input", error))
            known += own
        lacking = [n for n, one in named.items() if n not in known and one in needed - constants.keys()]
        for name in lacking:
            unit = structure.by_id[named[name]].units
            text = f"nothing for {name} ({unit}), an input of {show(getattr(file.dave_ml, part).file)}"
            words = "a value, a surface that moves it, or the standard name that it stands for in [dave_ml.names]"
            found.append(Problem("dave_ml.given", text, words))
    return found


def _everything(airframe: DaveMlAircraft) -> object:
    """What is asked of an airframe in flight: a unit that is not known shows here."""
    data = air_data(as_array([50.0, 0.0, 1.0]), as_array(0.0), StandardAtmosphere().at(as_array(0.0)))
    neutral = as_array([0.0] * len(airframe.inputs))
    return airframe.aerodynamics(data, as_array([0.0] * 3), neutral), airframe.engine.propulsion(as_array(50.0), data)
