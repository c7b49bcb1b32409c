"""Record values of all variables of DAVE-ML files at random inputs, by Janus: `python record_janus.py COUNT OUT FILE ...`.

Janus is the DAVE-ML interpreter of the Australian Defence Science and Technology Group. Its Python package python-janus
0.3.0 supports Python 3.8 to 3.10 only, so the tests use the recorded values in `janus.json`.
"""

import json
import random
import re
import sys
import tempfile
from pathlib import Path

import pyJanus

RANGES = {
    "deg": 40.0,
    "rad_s": 2.0,
    "ft": 30_000.0,
    "ft_s": 900.0,
    "nmi_h": 400.0,
    "pct": 100.0,
    "frac": 1.2,
    "nd": 2.6,
}
SIGNED = {"deg", "rad_s", "frac", "nd"}


VARIABLE = re.compile(r"<variableDef [^>]*(?:/>|(?<!/)>.*?</variableDef>)", re.DOTALL)
FUNCTION = re.compile(r"<function .*?</function>", re.DOTALL)


def palatable(text):
    """Adapt NASA's files to Janus: variables after their sources, no check data (which mixes names and varIDs), and no
    modification records without a date.
    """
    text = re.sub(
        r"<!--.*?-->|<checkData>.*?</checkData>|<modificationRecord.*?</modificationRecord>", "", text, flags=re.DOTALL
    )
    pending, sorted_, defined = VARIABLE.findall(text), [], set()
    while pending:
        for definition in pending:
            if set(re.findall(r"<ci>(.*?)</ci>", definition)) <= defined:
                defined.add(re.search(r'varID="(.*?)"', definition)[1])
                sorted_.append(definition)
                pending.remove(definition)
                break
        else:
            raise ValueError("a cycle")
    start, end = text.index("<variableDef "), text.rindex("</variableDef>") + len("</variableDef>")
    return text[:start] + "\n".join(sorted_) + text[end:]


def main(count, out, paths):
    recorded = json.loads(Path(out).read_text()) if Path(out).exists() else {}
    for path in paths:
        text = palatable(Path(path).read_text())
        copy = Path(tempfile.mkdtemp()) / Path(path).name
        while True:
            copy.write_text(text)
            try:
                model = pyJanus.Janus(str(copy))
                break
            except ValueError as error:  # leave out a variable with an operation that Janus does not know
                kind, name = re.search(r'(ID|in function)\s+"(.*?)"', str(error)).groups()
                sys.stderr.write(f"left out: {name} {str(error).splitlines()[-1]}\n")
                definitions = VARIABLE.findall(text) if kind == "ID" else FUNCTION.findall(text)
                text = text.replace(next(d for d in definitions if f'="{name}"' in d.partition(">")[0]), "")
        units = {str(v.var_id): str(v.units) for v in model.get_variabledef()}
        variables = {name: model.get_variabledef(pyJanus.aString(name)) for name in units}
        marked = {re.search(r'varID="(.*?)"', d)[1] for d in VARIABLE.findall(text) if "<isInput/>" in d}
        inputs = [name for name in units if name in marked]
        draw = random.Random(Path(path).name)
        values_by_draw = []
        for _ in range(count if inputs else 1):
            for name in inputs:
                size = RANGES.get(units[name], 1.0)
                variables[name].set_value(round(draw.uniform(-size if units[name] in SIGNED else 0.0, size), 4))
            values_by_draw.append([variables[name].get_value() for name in units])
        recorded[Path(path).name] = {
            "inputs": inputs,
            "values": dict(zip(units, map(list, zip(*values_by_draw, strict=True)), strict=True)),
        }
    Path(out).write_text(json.dumps(recorded))


if __name__ == "__main__":
    main(int(sys.argv[1]), sys.argv[2], sys.argv[3:])
