"""Values of all variables of DAVE-ML files at random inputs, by Janus: `python record_janus.py COUNT OUT FILE ...`.

Janus is the DAVE-ML interpreter of the Australian Defence Science and Technology Group; its Python package is
python-janus 0.3.0 (wheels for Python 3.8 to 3.10), which is why this is not run with the tests. What it wrote is
`janus.json`.
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
    """What Janus refuses of NASA's files put right: variables after those they are calculated from, no check data, which
    mixes names and varIDs, no record of a modification without a date."""
    text = re.sub(
        r"<!--.*?-->|<checkData>.*?</checkData>|<modificationRecord.*?</modificationRecord>", "", text, flags=re.DOTALL
    )
    left, sorted_, known = VARIABLE.findall(text), [], set()
    while left:
        for definition in left:
            if set(re.findall(r"<ci>(.*?)</ci>", definition)) <= known:
                known.add(re.search(r'varID="(.*?)"', definition)[1])
                sorted_.append(definition)
                left.remove(definition)
                break
        else:
            raise ValueError("a cycle")
    first, last = text.index("<variableDef "), text.rindex("</variableDef>") + len("</variableDef>")
    return text[:first] + "\n".join(sorted_) + text[last:]


def main(count, out, paths):
    found = json.loads(Path(out).read_text()) if Path(out).exists() else {}
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
                known = VARIABLE.findall(text) if kind == "ID" else FUNCTION.findall(text)
                text = text.replace(next(d for d in known if f'="{name}"' in d.partition(">")[0]), "")
        units = {str(v.var_id): str(v.units) for v in model.get_variabledef()}
        one = {name: model.get_variabledef(pyJanus.aString(name)) for name in units}
        marked = {re.search(r'varID="(.*?)"', d)[1] for d in VARIABLE.findall(text) if "<isInput/>" in d}
        inputs = [name for name in units if name in marked]
        draw = random.Random(Path(path).name)
        rows = []
        for _ in range(count if inputs else 1):
            for name in inputs:
                size = RANGES.get(units[name], 1.0)
                one[name].set_value(round(draw.uniform(-size if units[name] in SIGNED else 0.0, size), 4))
            rows.append([one[name].get_value() for name in units])
        found[Path(path).name] = {
            "inputs": inputs,
            "values": dict(zip(units, map(list, zip(*rows, strict=True)), strict=True)),
        }
    Path(out).write_text(json.dumps(found))


if __name__ == "__main__":
    main(int(sys.argv[1]), sys.argv[2], sys.argv[3:])
