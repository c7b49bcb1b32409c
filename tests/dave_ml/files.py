"""DAVE-ML files of the tests: NASA's package, and a file with every feature of DAVE-ML 2."""

import functools
from importlib.resources import files
from pathlib import Path

from anser.dave_ml import Model, read_dave_ml

HERE = Path(__file__).parent
NASA = {path.stem: path.read_bytes() for path in sorted(Path(str(files("anser.dave_ml"))).glob("nasa/*.dml"))}
"""ANSI/AIAA S-119 F-16 package and the check-case bodies (NASA Langley, 2012 to 2013)."""
FEATURES = (HERE / "features.dml").read_bytes()
ALL = {**NASA, "features": FEATURES}

HEAD = '<DAVEfunc><fileHeader/><variableDef name="x" varID="x" units="nd"/><variableDef name="y" varID="y" units="nd"/>'


@functools.cache
def model(name: str) -> Model:
    return read_dave_ml(ALL[name], f"{name}.dml")


def formula_model(mathml: str) -> Model:
    """Model of x and y with the output z."""
    math = mathml if mathml.startswith("<math ") else f"<math>{mathml}</math>"
    return read_dave_ml(
        f'{HEAD}<variableDef name="z" varID="z" units="nd"><calculation>{math}</calculation><isOutput/>'
        "</variableDef></DAVEfunc>",
        "formula",
    )
