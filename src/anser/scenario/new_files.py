"""New files of text, and the schema for editors beside them; what is there already is left alone."""

import json
import os
from pathlib import Path

from anser.output_files import write_file
from anser.scenario.errors import reason_of, refused
from anser.scenario.file_schema import json_schema
from anser.scenario.schema_base import Table


def write_schema_beside(path: Path, name: str, model: type[Table], title: str) -> None:
    """Write the JSON Schema of a kind of file into the folder of one, unless it is there; raises as `write_new`."""
    target = path.with_name(name)
    if not target.exists():
        write_new(target, schema_text(model, title))


def schema_text(model: type[Table], title: str) -> str:
    """The JSON Schema of the files that a model validates, as a file holds it."""
    return json.dumps(json_schema(model, title), indent=1) + "\n"


def write_new(path: str | os.PathLike[str], text: str) -> Path:
    """Write text to a new file.

    Raises
    ------
    ScenarioError
        If something of this name is there already (it is left alone), or the file cannot be written.
    """
    target = Path(path)
    try:
        write_file(target, text)
    except FileExistsError:
        raise refused(str(target), "a name that is taken", "the name of a new file; nothing was written") from None
    except FileNotFoundError:
        raise refused(str(target), "a folder that does not exist", "the name of a file in a folder that does") from None
    except (OSError, ValueError) as error:
        arrived = f"a path that cannot be written ({reason_of(error)})"
        raise refused(str(target), arrived, "the name of a file that can be written") from None
    return target
