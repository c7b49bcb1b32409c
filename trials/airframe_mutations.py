"""Aircraft files with wrong units, signs and matrices of inertia: each is refused with its place, or read rightly.

Every standard variable of the trainer's DAVE-ML file gets every unit of a list; masses, lengths and inertias of that
file and of the starter's aircraft file get other numbers, drawn at random. What is right is computed here, with
factors, dimensions and eigenvalues of its own::

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
"""Units with their factor to SI and what they measure; written down here, not taken from the package."""
_MEASURES = {
    "angle": ("ALPHA", "BETA", "DE", "DA", "DR"), "rate": ("PB", "QB", "RB"), "speed": ("VT",), "density": ("RHO",),
    "share": ("PLA",), "area": ("S",), "length": ("B", "C", "DXCG", "DYCG", "DZCG"), "mass": ("MASS",),
    "inertia": ("IXX", "IYY", "IZZ", "IXY", "IYZ", "IZX"), "number": ("CX", "CY", "CZ", "CLL", "CM", "CN", "CL", "CD"),
    "force": ("TX", "TY", "TZ"), "moment": ("TMR", "TMP", "TMY"),
}  # fmt: skip
MEASURE_OF = {name: measure for measure, names in _MEASURES.items() for name in names}
"""What each standard variable of the trainer measures."""
_AIR = {"VT": 55.0, "ALPHA": 0.05, "BETA": 0.03, "RHO": 1.1, "PB": 0.1, "QB": 0.05, "RB": -0.08}
_SURFACES = {"DE": -0.04, "DA": 0.03, "DR": 0.05}
_POWER = 0.6
_AXES = ("ALPHA", "VT")
"""Variables of tables: their breakpoints state their units, too, and contradict any others."""
_JS = ("IXX", "IYY", "IZZ", "IXY", "IYZ", "IZX")
_TOML_RANGES = {
    "mass.mass_kg": (0.0, 1e6), "geometry.span_m": (0.0, 200.0), "geometry.wing_area_m2": (0.0, 5000.0),
    "geometry.mean_chord_m": (0.0, 100.0), **{f"mass.{key}_kg_m2": (0.0, 1e9) for key in ("Jxx", "Jyy", "Jzz")},
    **{f"mass.{key}_kg_m2": (-1e9, 1e9) for key in ("Jxy", "Jyz", "Jxz")},
}  # fmt: skip
_MARGIN = 1e-6
"""Part of the greatest moment within which rounding may decide; such cases are drawn anew."""


@dataclasses.dataclass(frozen=True)
class Outcome:
    """One mutated file: what was changed, and "refused", "right", or how it went wrong."""

    file: str
    place: str
    change: str
    answer: str
    message: str = ""

    @property
    def good(self) -> bool:
        """Whether it was refused or read rightly, as it should be."""
        return self.answer in ("refused", "right")


def _text() -> str:
    text = (_FOLDER / "trainer.dml").read_text(encoding="utf-8")
    return text[: text.index("<checkData>")] + "</DAVEfunc>"  # whose units would betray those of the variables


def _variables(text: str) -> dict[str, tuple[str, float | None]]:
    """Units and constant value of each variable, as the file has them."""
    found: dict[str, tuple[str, float | None]] = {}
    for tag in re.findall(r"<variableDef[^>]*>", text):
        attributes = dict(re.findall(r'(\w+)="([^"]*)"', tag))
        value = attributes.get("initialValue")
        found[attributes["varID"]] = attributes["units"], None if value is None else float(value)
    return found


def _with(text: str, name: str, attribute: str, value: str) -> str:
    """A text with another attribute of the definition of a variable."""
    return re.sub(rf'(<variableDef[^>]*varID="{name}"[^>]*{attribute}=")[^"]*', rf"\g<1>{value}", text)


def principal_margin(J: np.ndarray) -> float:
    """Least of the principal moments and of what their sums exceed them by, part of the greatest; negative: no body."""
    least, middle, greatest = np.linalg.eigvalsh(J)
    return float(min(least, least + middle - greatest) / max(abs(greatest), abs(least)))


def _matrix(values: Mapping[str, float]) -> np.ndarray:
    x, y, z, xy, yz, zx = (values[name] for name in _JS)
    return np.array([[x, -xy, -zx], [-xy, y, -yz], [-zx, -yz, z]])


def _si(variables: Mapping[str, tuple[str, float | None]]) -> dict[str, float]:
    """Constants of standard variables, SI units."""
    return {
        name: UNITS[units][0] * value
        for name, (units, value) in variables.items()
        if name in MEASURE_OF and value is not None
    }


def unit_cases() -> Iterator[tuple[str, str, str, str]]:
    """Every standard variable in every unit: place, change, text of the file, what refuses it (empty: nothing)."""
    text = _text()
    for name, measure in MEASURE_OF.items():
        for units, (_, of) in UNITS.items():
            right = of == measure and (name not in _AXES or f'varID="{name}" units="{units}"' in text)
            changed = _with(text, name, "units", units)
            refusal = "" if right else f'"{name}"'
            if right and principal_margin(_matrix(_si(_variables(changed)))) < 0.0:
                refusal = "Jxx"  # one moment in other units than the others: no body
            yield name, f'units="{units}"', changed, refusal


def body_cases(draw: np.random.Generator, count: int) -> Iterator[tuple[str, str, str, str]]:
    """Other numbers of mass, lengths and inertia in the DAVE-ML file; as `unit_cases`."""
    text = _text()
    variables = _variables(text)
    while count:
        values = {name: value for name, (_, value) in variables.items() if value is not None}
        names = list(_JS) if draw.random() < 0.5 else [str(draw.choice(["MASS", "S", "B", "C", *_JS]))]
        spread = 0.5 if len(names) == 1 else draw.choice([0.03, 0.1, 0.5])
        for name in names:
            typical = values[name] or 0.3 * values["IXX"]
            sign = draw.choice([-1.0, 1.0, 1.0, 1.0, 0.0]) if len(names) == 1 else draw.choice([-1.0, *[1.0] * 8])
            values[name] = float(sign * typical * 10.0 ** draw.uniform(-spread, spread))
        margin = principal_margin(_matrix(values))
        if abs(margin) < _MARGIN:
            continue
        count -= 1
        wrong = margin < 0.0 or min(values[name] for name in ("MASS", "S", "B", "C")) <= 0.0
        changed = text
        for name in names:
            changed = _with(changed, name, "initialValue", repr(values[name]))
        yield "+".join(names), "numbers", changed, "positive|Jxx|inertia" if wrong else ""


def try_dave_ml(place: str, change: str, text: str, refusal: str, folder: Path, base: Model) -> Outcome:
    """Read an aircraft by a mutated DAVE-ML file, and compare what comes of it with what its numbers mean."""
    (folder / "trainer.dml").write_text(text, encoding="utf-8")
    path = folder / "trainer.toml"
    path.write_text((_FOLDER / "trainer.toml").read_text(encoding="utf-8"), encoding="utf-8")

    def read() -> list[str]:
        airframe = build_airframe(read_airframe(path))
        if not isinstance(airframe, DaveMlAircraft):
            raise TypeError(type(airframe).__name__)
        return _differences(airframe, _variables(text), base)

    return _outcome("DAVE-ML", place, change, refusal, read, r"line \d+, column \d+")


def _outcome(file: str, place: str, change: str, refusal: str, read: Callable[[], list[str]], where: str) -> Outcome:
    try:
        differences = read()
    except ScenarioError as error:
        message = str(error)
        if not refusal:
            return Outcome(file, place, change, "refused though right", message)
        told = re.search(refusal, message) and re.search(where, message)
        return Outcome(file, place, change, "refused" if told else "refused without its place", message)
    except Exception as error:  # noqa: BLE001 - what the trial looks for
        return Outcome(file, place, change, "fault", f"{type(error).__name__}: {error}")
    if refusal:
        return Outcome(file, place, change, "accepted though wrong")
    return Outcome(file, place, change, "other numbers" if differences else "right", "; ".join(differences))


def _differences(airframe: DaveMlAircraft, variables: Mapping[str, tuple[str, float | None]], base: Model) -> list[str]:
    """Names of quantities of an airframe that are not what the file's numbers mean in its units."""
    factor = {name: UNITS[variables[name][0]][0] for name in MEASURE_OF}
    si = _si(variables)
    own = {name: value / factor[name] for name, value in {**_AIR, **_SURFACES, "PLA": _POWER}.items()}
    constants = {name: si[name] / factor[name] for name in ("S", "B", "C")}
    values = _evaluated(base, own, constants)
    found: dict[str, tuple[Any, Any]] = {"mass": (airframe.mass_properties.mass, si["MASS"])}
    found["inertia"] = airframe.mass_properties.inertia_b, _matrix(si)
    found |= {"area": (airframe.wing_area, si["S"]), "span": (airframe.span, si["B"])}
    found |= {"chord": (airframe.mean_chord, si["C"])}
    found["centre"] = airframe.centre_b, [si[name] for name in ("DXCG", "DYCG", "DZCG")]
    air_data = _air_data()
    rates, surfaces = jnp.asarray([_AIR[name] for name in ("PB", "QB", "RB")]), jnp.asarray(list(_SURFACES.values()))
    names = ("CX", "CY", "CZ", "CLL", "CM", "CN")
    expected = [values[output] * factor[name] for output, name in zip(AERO_OUTPUTS, names, strict=True)]
    found["coefficients"] = airframe.coefficients(air_data, rates, surfaces), expected
    if isinstance(airframe.engine, DaveMlEngine):
        wrench = airframe.engine.propulsion(100.0 * _POWER, air_data)
        names = ("TX", "TY", "TZ", "TMR", "TMP", "TMY")
        expected = [values[output] * factor[name] for output, name in zip(ENGINE_OUTPUTS, names, strict=True)]
        found["thrust"] = jnp.concatenate([wrench.force_b, wrench.moment_b]), expected
    return [name for name, (value, right) in found.items() if not np.allclose(value, right, rtol=1e-9, atol=1e-12)]


def _air_data() -> AirData:
    V, rho = _AIR["VT"], _AIR["RHO"]
    numbers = (V, _AIR["ALPHA"], _AIR["BETA"], rho, 0.5 * rho * V * V, V / 340.0, 0.0)
    return AirData(*(jnp.asarray(number) for number in numbers))


@jax.jit
def _compute(evaluator: Any, inputs: dict[str, jax.Array]) -> dict[str, jax.Array]:
    return evaluator.evaluate(inputs, (*AERO_OUTPUTS, *ENGINE_OUTPUTS))


def _evaluated(base: Model, inputs: Mapping[str, float], constants: Mapping[str, float]) -> dict[str, float]:
    """Outputs of the file as it was, in its units, of numbers of inputs and constants."""
    evaluator = base.evaluator.with_constants(constants)
    limited = {name: jnp.asarray(value) for name, value in inputs.items()}
    return {name: float(value) for name, value in _compute(evaluator, limited).items()}


def toml_cases(draw: np.random.Generator, count: int) -> Iterator[tuple[str, str, dict[str, Any], str]]:
    """Other values in the starter's aircraft file: place, change, values, what refuses them (empty: nothing)."""
    starter = tomllib.loads(airframe_starter())
    kinds = ("scaled", "negative", "zero", "infinite", "text with its unit", "key in another unit", "matrix")
    while count:
        values, kind = copy.deepcopy(starter), str(draw.choice(kinds))
        key = str(draw.choice(list(_TOML_RANGES)))
        keys = [one for one in _TOML_RANGES if one.startswith("mass.J")] if kind == "matrix" else [key]
        spread = draw.choice([0.03, 0.1, 0.5])
        for one in keys:
            table, _, name = one.partition(".")
            usual = values[table].get(name) or 0.2 * values["mass"]["Jxx_kg_m2"]
            scaled = float(usual * 10.0 ** draw.uniform(-spread, spread) * draw.choice([-1.0, *[1.0] * 9]))
            new = {"negative": -usual, "zero": 0.0, "infinite": draw.choice([np.nan, np.inf, -np.inf])}.get(
                kind, scaled
            )
            values[table][name] = float(new)
        wrong = _toml_refusal(values)
        if wrong is None:
            continue
        table, _, name = key.partition(".")
        if kind == "text with its unit":
            values[table][name], wrong = f"{values[table][name]} lb", name
        elif kind == "key in another unit":
            other = name.rpartition("_kg" if "_kg" in name else "_m")[0] + "_ft"
            values[table][other], wrong = values[table].pop(name), other
        count -= 1
        yield "mass.J*" if kind == "matrix" else key, kind, values, wrong


def _toml_refusal(values: Mapping[str, Any]) -> str | None:
    """Pattern of the keys that a message has to name; empty for possible bodies, None where rounding may decide."""
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


def try_toml(place: str, change: str, values: dict[str, Any], refusal: str) -> Outcome:
    """Validate and build a mutated aircraft file, and compare its numbers."""

    def read() -> list[str]:
        airframe = build_airframe(validate_airframe(values, "starter.toml"))
        mass, geometry = values["mass"], values["geometry"]
        J = [[airframe.mass_properties.inertia_b[k, j] for j in range(3)] for k in range(3)]
        right = {"Jxx": J[0][0], "Jyy": J[1][1], "Jzz": J[2][2], "Jxy": -J[0][1], "Jxz": -J[0][2], "Jyz": -J[1][2]}
        found = {f"{name}_kg_m2": float(value) for name, value in right.items()}
        found["mass_kg"] = float(airframe.mass_properties.mass)
        found |= {"span_m": float(airframe.span), "wing_area_m2": float(airframe.wing_area)}
        found["mean_chord_m"] = float(airframe.mean_chord)
        given = {**mass, **geometry}
        return [name for name, value in found.items() if not np.isclose(value, given.get(name, 0.0), rtol=1e-12)]

    return _outcome("aircraft file", place, change, refusal, read, r"(mass|geometry)\.")


def outcomes(bodies: int, seed: int, every_unit: int = 1) -> Iterator[Outcome]:
    """All unit cases (or each so-manyeth), and so many mutated bodies of both kinds of file."""
    draw = np.random.default_rng(seed)
    base = read_dave_ml(_text(), "trainer.dml")
    with tempfile.TemporaryDirectory() as folder:
        cases = list(unit_cases())[draw.integers(every_unit) :: every_unit]
        for case in (*cases, *body_cases(draw, bodies // 2)):
            yield try_dave_ml(*case, Path(folder), base)
    for case in toml_cases(draw, bodies - bodies // 2):
        yield try_toml(*case)


def table(found: list[Outcome]) -> str:
    """Markdown: each variable or key with its answers, and the changes that led to each."""
    rows: dict[tuple[str, str], dict[str, Counter[str]]] = {}
    for one in found:
        rows.setdefault((one.file, one.place), {}).setdefault(one.answer, Counter())[one.change] += 1
    lines = ["| file | variable or key | answer | number | changes |", "|---|---|---|---|---|"]
    for (file, place), answers in rows.items():
        for answer, changes in sorted(answers.items()):
            words = ", ".join(f"{change} ({n})" if n > 1 else change for change, n in changes.items())
            lines.append(f"| {file} | {place} | {answer} | {changes.total()} | {words} |")
    return "\n".join(lines)


def main() -> None:
    """Read the mutated files and write the table of answers; exit code 1 if one is neither refused nor right."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--bodies", type=int, default=500, help="mutated bodies, of both kinds of file")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--every-unit", type=int, default=1, help="of the unit cases each so-manyeth")
    parser.add_argument("--out", type=Path, help="file for all outcomes, JSON")
    options = parser.parse_args()
    found = []
    for one in outcomes(options.bodies, options.seed, options.every_unit):
        found.append(one)
        if not one.good:
            sys.stdout.write(f"{one}\n")
    if options.out is not None:
        options.out.write_text(json.dumps([dataclasses.asdict(one) for one in found], indent=1), encoding="utf-8")
    counts = Counter(one.answer for one in found)
    answers = ", ".join(f"{n} {answer}" for answer, n in counts.most_common())
    sys.stdout.write(f"{table(found)}\n{len(found)} files: {answers}\n")
    raise SystemExit(not all(one.good for one in found))


if __name__ == "__main__":
    main()
