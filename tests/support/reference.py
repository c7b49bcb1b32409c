"""Published check figures, as files beside the tests of the aircraft; each says what it is under `about`."""

import functools
import json
import pathlib
from typing import Any

_FOLDER = pathlib.Path(__file__).parent.parent / "aircraft" / "data"


@functools.cache
def reference(name: str) -> dict[str, Any]:
    """Read one of `textbook_checks`, `daveml_aero_checks`, `daveml_engine_checks`."""
    return json.loads((_FOLDER / f"{name}.json").read_text(encoding="utf-8"))
