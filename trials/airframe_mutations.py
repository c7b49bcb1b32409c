"""Aircraft files with wrong units, signs and inertias: each is refused with the key at fault, or read correctly.

Every standard variable of the trainer's DAVE-ML file gets every unit of a list; masses, lengths and inertias of the
trainer and of the starter's aircraft file get random numbers. The correct answers are computed here, with independent
factors, dimensions and eigenvalues::

    python -m trials.airframe_mutations --bodies 500 --seed 0 --out mutations.json
"""

import argparse
import copy
import dataclasses
import json
import re
import sys
import tempfile
import tomllib
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from anser.aircraft import AirData, DaveMlAircraft
from anser.aircraft.dave_ml_aircraft import AERO_OUTPUTS, ENGINE_OUTPUTS, DaveMlEngine
from anser.aircraft_files import build_airframe, read_airframe
from anser.aircraft_files.sources import airframe_starter, validate_airframe
from anser.config import ScenarioError
from anser.dave_ml import Model, read_dave_ml

_FOLDER = Path(__file__).parents[1] / "scenarios" / "own-aircraft"
_FT, _SLUG, _LBM, _DEG, _KT = 0.3048, 14.593902937206364, 0.45359237, np.pi / 180.0, 1852.0 / 3600.0
_LBF = _SLUG * _FT
UNITS: Mapping[str, tuple[float, str]] = {
    "": (1.0, "number"), "nd": (1.0, "number"), "non-dimensional": (1.0, "number"), "pct": (0.01, "share"),
    "frac": (1.0, "share"), "rad": (1.0, "angle"), "deg": (_DEG, "angle"), "_deg": (1.0 / _DEG, "per angle"),
    "rad_s": (1.0, "rate"), "deg_s": (_DEG, "rate"), "m": (1.0, "length"), "ft": (_FT, "length"),
    "m2": (1.0, "area"), "ft2": (_FT**2, "area"), "m_s": (1.0, "speed"), "ft_s": (_FT, "speed"), "kt": (_KT, "speed"),
    "kg": (1.0, "mass"), "slug": (_SLUG, "mass"), "lbm": (_LBM, "mass"), "kgm2": (1.0, "inertia"),
    "slugft2": (_SLUG * _FT**2, "inertia"), "N": (1.0, "force"), "lbf": (_LBF, "force"), "lb": (1.0, "unknown"),
    "Nm": (1.0, "moment"), "ftlbf": (_FT * _LBF, "moment"), "kg_m3": (1.0, "density"),
    "slug_ft3": (_SLUG / _FT**3, "density"), "degrees": (1.0, "unknown"),
}  # fmt: skip
"""Units with their factor to SI and their quantity; written down here, independent of the package."""
_MEASURES = {
    "angle": ("ALPHA", "BETA", "DE", "DA", "DR"), "rate": ("PB", "QB", "RB"), "speed": ("VT",), "density": ("RHO",),
    "share": ("PLA",), "area": ("S",), "length": ("B", "C", "DXCG", "DYCG", "DZCG"), "mass": ("MASS",),
    "inertia": ("IXX", "IYY", "IZZ", "IXY", "IYZ", "IZX"), "number": ("CX", "CY", "CZ", "CLL", "CM", "CN", "CL", "CD"),
    "force": ("TX", "TY", "TZ"), "moment": ("TMR", "TMP", "TMY"),
}  # fmt: skip
MEASURE_OF = {name: measure for measure, names in _MEASURES.items() for name in names}
"""Quantity of each standard variable of the trainer."""
_AIR = {"VT": 55.0, "ALPHA": 0.05, "BETA": 0.03, "RHO": 1.1, "PB": 0.1, "QB": 0.05, "RB": -0.08}
_SURFACES = {"DE": -0.04, "DA": 0.03, "DR": 0.05}
_POWER = 0.6
_AXES = ("ALPHA", "VT")
"""Variables of tables: their breakpoints state units too and contradict other units."""
_JS = ("IXX", "IYY", "IZZ", "IXY", "IYZ", "IZX")
_TOML_RANGES = {
    "mass.mass_kg": (0.0, 1e6), "geometry.span_m": (0.0, 200.0), "geometry.wing_area_m2": (0.0, 5000.0),
    "geometry.mean_chord_m": (0.0, 100.0), **{f"mass.{key}_kg_m2": (0.0, 1e9) for key in ("Jxx", "Jyy", "Jzz")},
    **{f"mass.{key}_kg_m2": (-1e9, 1e9) for key in ("Jxy", "Jyz", "Jxz")},
}  # fmt: skip
_MARGIN = 1e-6
"""Relative margin, in parts of the greatest moment, within which rounding may decide; such cases are redrawn."""


@dataclasses.dataclass(frozen=True)
class Outcome:
    """Result for one mutated file: the change, and "refused", "right" or the kind of error."""

    file: str
    place: str
    change: str
    answer: str
    message: str = ""

    @property
    def good(self) -> bool:
        """Whether the file was refused or read correctly, as required."""
        return self.answer in ("refused", "right")


def _text() -> str:
    text = (_FOLDER / "trainer.dml").read_text(encoding="utf-8")
    return (
        text[: text.index("<checkData>")] + "</DAVEfunc>"
    )  # the check data's units would reveal those of the variables


def _variables(text: str) -> dict[str, tuple[str, float | None]]:
    """Units and constant value of each variable in the file."""
    variables: dict[str, tuple[str, float | None]] = {}
    for tag in re.findall(r"<variableDef[^>]*>", text):
        attributes = dict(re.findall(r'(\w+)="([^"]*)"', tag))
        value = attributes.get("initialValue")
        variables[attributes["varID"]] = attributes["units"], None if value is None else float(value)
    return variables


def _with(text: str, name: str, attribute: str, value: str) -> str:
    """The text with a different attribute in the definition of a variable."""
    return re.sub(rf'(<variableDef[^>]*varID="{name}"[^>]*{attribute}=")[^"]*', rf"\g<1>{value}", text)


def principal_margin(J: np.ndarray) -> float:
    """Margin of positive moments and of the triangle inequality, relative to the greatest moment; negative: no body."""
    smallest, middle, greatest = np.linalg.eigvalsh(J)
    return float(min(smallest, smallest + middle - greatest) / max(abs(greatest), abs(smallest)))


def _matrix(values: Mapping[str, float]) -> np.ndarray:
    x, y, z, xy, yz, zx = (values[name] for name in _JS)
    return np.array([[x, -xy, -zx], [-xy, y, -yz], [-zx, -yz, z]])


def _si(variables: Mapping[str, tuple[str, float | None]]) -> dict[str, float]:
    """Constants of standard variables in SI units."""
    return {
        name: UNITS[units][0] * value
        for name, (units, value) in variables.items()
        if name in MEASURE_OF and value is not None
    }


def unit_cases() -> Iterator[tuple[str, str, str, str]]:
    """Every standard variable in every unit: key, change, file's text, pattern of the refusal (empty: accepted)."""
    text = _text()
    for name, measure in MEASURE_OF.items():
        for units, (_, quantity) in UNITS.items():
            right = quantity == measure and (name not in _AXES or f'varID="{name}" units="{units}"' in text)
            changed = _with(text, name, "units", units)
            refusal = "" if right else f'"{name}"'
            if right and principal_margin(_matrix(_si(_variables(changed)))) < 0.0:
                refusal = "Jxx"  # one moment of inertia in different units: not a rigid body
            yield name, f'units="{units}"', changed, refusal


def body_cases(draw: np.random.Generator, count: int) -> Iterator[tuple[str, str, str, str]]:
    """Random mass, lengths and inertia in the DAVE-ML file; tuples as in `unit_cases`."""
    text = _text()
    variables = _variables(text)
    while count:
        values = {name: value for name, (_, value) in variables.items() if value is not None}
        changed_names = list(_JS) if draw.random() < 0.5 else [str(draw.choice(["MASS", "S", "B", "C", *_JS]))]
        spread = 0.5 if len(changed_names) == 1 else draw.choice([0.03, 0.1, 0.5])
        for name in changed_names:
            typical = values[name] or 0.3 * values["IXX"]
            sign = (
                draw.choice([-1.0, 1.0, 1.0, 1.0, 0.0]) if len(changed_names) == 1 else draw.choice([-1.0, *[1.0] * 8])
            )
            values[name] = float(sign * typical * 10.0 ** draw.uniform(-spread, spread))
        margin = principal_margin(_matrix(values))
        if abs(margin) < _MARGIN:
            continue
        count -= 1
        wrong = margin < 0.0 or min(values[name] for name in ("MASS", "S", "B", "C")) <= 0.0
        changed = text
        for name in changed_names:
            changed = _with(changed, name, "initialValue", repr(values[name]))
        yield "+".join(changed_names), "numbers", changed, "positive|Jxx|inertia" if wrong else ""


def try_dave_ml(key_path: str, change: str, text: str, refusal: str, folder: Path, base: Model) -> Outcome:
    """Read an aircraft from a mutated DAVE-ML file, and compare its quantities with the file's numbers."""
    (folder / "trainer.dml").write_text(text, encoding="utf-8")
    path = folder / "trainer.toml"
    path.write_text((_FOLDER / "trainer.toml").read_text(encoding="utf-8"), encoding="utf-8")

    def read() -> list[str]:
        airframe = build_airframe(read_airframe(path))
        if not isinstance(airframe, DaveMlAircraft):
            raise TypeError(type(airframe).__name__)
        return _differences(airframe, _variables(text), base)

    return _outcome("DAVE-ML", key_path, change, refusal, read, r"line \d+, column \d+")


def _outcome(
    file: str, key_path: str, change: str, refusal: str, read: Callable[[], list[str]], position_pattern: str
) -> Outcome:
    try:
        differences = read()
    except ScenarioError as error:
        message = str(error)
        if not refusal:
            return Outcome(file, key_path, change, "refused though right", message)
        names_position = re.search(refusal, message) and re.search(position_pattern, message)
        return Outcome(file, key_path, change, "refused" if names_position else "refused without its place", message)
    except Exception as error:  # noqa: BLE001 - what the trial looks for
        return Outcome(file, key_path, change, "fault", f"{type(error).__name__}: {error}")
    if refusal:
        return Outcome(file, key_path, change, "accepted though wrong")
    return Outcome(file, key_path, change, "other numbers" if differences else "right", "; ".join(differences))


def _differences(airframe: DaveMlAircraft, variables: Mapping[str, tuple[str, float | None]], base: Model) -> list[str]:
    """Names of airframe quantities that differ from the file's numbers in the file's units."""
    factor = {name: UNITS[variables[name][0]][0] for name in MEASURE_OF}
    si = _si(variables)
    inputs = {name: value / factor[name] for name, value in {**_AIR, **_SURFACES, "PLA": _POWER}.items()}
    constants = {name: si[name] / factor[name] for name in ("S", "B", "C")}
    values = _evaluated(base, inputs, constants)
    comparisons: dict[str, tuple[Any, Any]] = {"mass": (airframe.mass_properties.mass, si["MASS"])}
    comparisons["inertia"] = airframe.mass_properties.inertia_b, _matrix(si)
    comparisons |= {"area": (airframe.wing_area, si["S"]), "span": (airframe.span, si["B"])}
    comparisons |= {"chord": (airframe.mean_chord, si["C"])}
    comparisons["centre"] = airframe.centre_b, [si[name] for name in ("DXCG", "DYCG", "DZCG")]
    air_data = _air_data()
    rates, surfaces = jnp.asarray([_AIR[name] for name in ("PB", "QB", "RB")]), jnp.asarray(list(_SURFACES.values()))
    names = ("CX", "CY", "CZ", "CLL", "CM", "CN")
    expected = [values[output] * factor[name] for output, name in zip(AERO_OUTPUTS, names, strict=True)]
    comparisons["coefficients"] = airframe.coefficients(air_data, rates, surfaces), expected
    if isinstance(airframe.engine, DaveMlEngine):
        wrench = airframe.engine.propulsion(100.0 * _POWER, air_data)
        names = ("TX", "TY", "TZ", "TMR", "TMP", "TMY")
        expected = [values[output] * factor[name] for output, name in zip(ENGINE_OUTPUTS, names, strict=True)]
        comparisons["thrust"] = jnp.concatenate([wrench.force_b, wrench.moment_b]), expected
    return [
        name
        for name, (value, expected_value) in comparisons.items()
        if not np.allclose(value, expected_value, rtol=1e-9, atol=1e-12)
    ]


def _air_data() -> AirData:
    V, rho = _AIR["VT"], _AIR["RHO"]
    numbers = (V, _AIR["ALPHA"], _AIR["BETA"], rho, 0.5 * rho * V * V, V / 340.0, 0.0)
    return AirData(*(jnp.asarray(number) for number in numbers))


@jax.jit
def _compute(evaluator: Any, inputs: dict[str, jax.Array]) -> dict[str, jax.Array]:
    return evaluator.evaluate(inputs, (*AERO_OUTPUTS, *ENGINE_OUTPUTS))


def _evaluated(base: Model, inputs: Mapping[str, float], constants: Mapping[str, float]) -> dict[str, float]:
    """Outputs of the original file, in its units, for given inputs and constants."""
    evaluator = base.evaluator.with_constants(constants)
    limited = {name: jnp.asarray(value) for name, value in inputs.items()}
    return {name: float(value) for name, value in _compute(evaluator, limited).items()}


def toml_cases(draw: np.random.Generator, count: int) -> Iterator[tuple[str, str, dict[str, Any], str]]:
    """Changed values in the starter's aircraft file: key, change, values, pattern of the refusal (empty: accepted)."""
    starter = tomllib.loads(airframe_starter())
    kinds = ("scaled", "negative", "zero", "infinite", "text with its unit", "key in another unit", "matrix")
    while count:
        values, kind = copy.deepcopy(starter), str(draw.choice(kinds))
        key = str(draw.choice(list(_TOML_RANGES)))
        keys = [key_path for key_path in _TOML_RANGES if key_path.startswith("mass.J")] if kind == "matrix" else [key]
        spread = draw.choice([0.03, 0.1, 0.5])
        for key_path in keys:
            table, _, name = key_path.partition(".")
            typical = values[table].get(name) or 0.2 * values["mass"]["Jxx_kg_m2"]
            scaled = float(typical * 10.0 ** draw.uniform(-spread, spread) * draw.choice([-1.0, *[1.0] * 9]))
            replacement = {"negative": -typical, "zero": 0.0, "infinite": draw.choice([np.nan, np.inf, -np.inf])}.get(
                kind, scaled
            )
            values[table][name] = float(replacement)
        wrong = _toml_refusal(values)
        if wrong is None:
            continue
        table, _, name = key.partition(".")
        if kind == "text with its unit":
            values[table][name], wrong = f"{values[table][name]} lb", name
        elif kind == "key in another unit":
            other_name = name.rpartition("_kg" if "_kg" in name else "_m")[0] + "_ft"
            values[table][other_name], wrong = values[table].pop(name), other_name
        count -= 1
        yield "mass.J*" if kind == "matrix" else key, kind, values, wrong


def _toml_refusal(values: Mapping[str, Any]) -> str | None:
    """Pattern of the keys required in the message; empty for a possible body, None if rounding may decide."""
    wrong = []
    for key, (low, high) in _TOML_RANGES.items():
        table, _, name = key.partition(".")
        value = values[table].get(name, 0.0)
        inside = low < value <= high if low == 0.0 else low <= value <= high
        wrong += [] if inside else [name]
    if wrong:
        return "|".join(wrong)
    mass = values["mass"]
    J = _matrix({f"I{key.upper()}": mass.get(f"J{''.join(sorted(key))}_kg_m2", 0.0)
                 for key in ("xx", "yy", "zz", "xy", "yz", "zx")})  # fmt: skip
    margin = principal_margin(J)
    if abs(margin) < _MARGIN:
        return None
    return r"mass\.J" if margin < 0.0 else ""


def try_toml(key_path: str, change: str, values: dict[str, Any], refusal: str) -> Outcome:
    """Validate and build a mutated aircraft file, and compare its numbers."""

    def read() -> list[str]:
        airframe = build_airframe(validate_airframe(values, "starter.toml"))
        mass, geometry = values["mass"], values["geometry"]
        J = [[airframe.mass_properties.inertia_b[k, j] for j in range(3)] for k in range(3)]
        inertia = {"Jxx": J[0][0], "Jyy": J[1][1], "Jzz": J[2][2], "Jxy": -J[0][1], "Jxz": -J[0][2], "Jyz": -J[1][2]}
        values_read = {f"{name}_kg_m2": float(value) for name, value in inertia.items()}
        values_read["mass_kg"] = float(airframe.mass_properties.mass)
        values_read |= {"span_m": float(airframe.span), "wing_area_m2": float(airframe.wing_area)}
        values_read["mean_chord_m"] = float(airframe.mean_chord)
        file_values = {**mass, **geometry}
        return [
            name for name, value in values_read.items() if not np.isclose(value, file_values.get(name, 0.0), rtol=1e-12)
        ]

    return _outcome("aircraft file", key_path, change, refusal, read, r"(mass|geometry)\.")


def outcomes(bodies: int, seed: int, every_unit: int = 1) -> Iterator[Outcome]:
    """Results of the unit cases (or every n-th of them) and of `bodies` mutated bodies of both kinds of file."""
    draw = np.random.default_rng(seed)
    base = read_dave_ml(_text(), "trainer.dml")
    with tempfile.TemporaryDirectory() as folder:
        cases = list(unit_cases())[draw.integers(every_unit) :: every_unit]
        for case in (*cases, *body_cases(draw, bodies // 2)):
            yield try_dave_ml(*case, Path(folder), base)
    for case in toml_cases(draw, bodies - bodies // 2):
        yield try_toml(*case)


def table(results: list[Outcome]) -> str:
    """Markdown table: the answers for each variable or key, with the changes."""
    counts: dict[tuple[str, str], dict[str, Counter[str]]] = {}
    for outcome in results:
        counts.setdefault((outcome.file, outcome.place), {}).setdefault(outcome.answer, Counter())[outcome.change] += 1
    lines = ["| file | variable or key | answer | number | changes |", "|---|---|---|---|---|"]
    for (file, key_path), answers in counts.items():
        for answer, changes in sorted(answers.items()):
            change_list = ", ".join(f"{change} ({n})" if n > 1 else change for change, n in changes.items())
            lines.append(f"| {file} | {key_path} | {answer} | {changes.total()} | {change_list} |")
    return "\n".join(lines)


def main() -> None:
    """Read the mutated files and write the table of answers; exit code 1 for any wrong answer."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--bodies", type=int, default=500, help="mutated bodies, of both kinds of file")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--every-unit", type=int, default=1, help="of the unit cases each so-manyeth")
    parser.add_argument("--out", type=Path, help="file for all outcomes, JSON")
    options = parser.parse_args()
    results = []
    for outcome in outcomes(options.bodies, options.seed, options.every_unit):
        results.append(outcome)
        if not outcome.good:
            sys.stdout.write(f"{outcome}\n")
    if options.out is not None:
        options.out.write_text(
            json.dumps([dataclasses.asdict(outcome) for outcome in results], indent=1), encoding="utf-8"
        )
    counts = Counter(outcome.answer for outcome in results)
    answers = ", ".join(f"{n} {answer}" for answer, n in counts.most_common())
    sys.stdout.write(f"{table(results)}\n{len(results)} files: {answers}\n")
    raise SystemExit(not all(outcome.good for outcome in results))


if __name__ == "__main__":
    main()
