"""Folder of a rare event: what was asked, and what came of every batch of flights, each in a file written whole."""

import io
import json
from pathlib import Path
from typing import Any

import numpy as np

from anser.campaigns.store_integrity import StoreError
from anser.campaigns.study import Study, validate_study
from anser.config.errors import ScenarioError
from anser.files import new_file, new_folder
from anser.results.checksums import DamagedFileError, add_checksum, append_checksum, read_document, verify_checksum
from anser.results.documents import version_attributes, write_json
from anser.scenario.schema import Scenario, validate

FORMAT = 2
_UNCHECKED = 1
"""Format without checksums, which is read, but not gone on with."""
_CONFIG_FILE = "rare-asked.json"
_FLOWN = "flown"


class RareStore:
    """What a rare event's folder holds; open one with `create` or `open`.

    Attributes
    ----------
    folder
        Its folder.
    study, scenario
        What is flown.
    format
        Version of the folder's format.
    """

    def __init__(self, folder: Path, study: Study, scenario: Scenario, version: int = FORMAT) -> None:
        self.folder, self.study, self.scenario, self.format = folder, study, scenario, version

    @classmethod
    def create(cls, folder: Path, study: Study, scenario: Scenario) -> "RareStore":
        """Make a new folder; FileExistsError where there is one."""
        asked = {
            "study": study.model_dump_json(exclude_unset=True),
            "scenario": scenario.model_dump_json(exclude_unset=True),
            **provenance(study, scenario),
        }
        with new_folder(folder) as beside:
            (beside / _FLOWN).mkdir()
            write_json(add_checksum(asked), beside / _CONFIG_FILE)
        return cls(folder, study, scenario)

    @classmethod
    def open(cls, folder: Path) -> "RareStore":
        """Open that of a folder; StoreError where there is none, or one that is damaged or of another format."""
        asked, checked = _read_config(folder)
        version = asked.get("format_version")
        if version not in (FORMAT, _UNCHECKED) or (version == FORMAT and not checked):
            words = f"arrived format {version}{'' if checked else ' without its checksum'}; expected {FORMAT}"
            raise StoreError(f"{folder / _CONFIG_FILE}: {words}")
        try:
            study = validate_study(json.loads(asked["study"]), f"{folder}, study")
            return cls(folder, study, validate(json.loads(asked["scenario"]), f"{folder}, scenario"), version)
        except ScenarioError:
            raise
        except (KeyError, TypeError, ValueError) as error:
            words = f"arrived a file that cannot be read ({error}); expected it as anser wrote it"
            raise StoreError(f"{folder / _CONFIG_FILE}: {words}") from None

    def refuse_unless_same(self, study: Study, scenario: Scenario) -> None:
        """Refuse to go on with another study, scenario or version of what numbers depend on (StoreError)."""
        asked, _ = _read_config(self.folder)
        for key, wanted in provenance(study, scenario).items():
            if asked.get(key) != wanted:
                words = f"arrived a rare event with the {key.replace('_', ' ')} {asked.get(key)}"
                raise StoreError(f"{self.folder}: {words}; expected {wanted}, to go on with it")

    def values(self, first: int, count: int) -> np.ndarray | None:
        """What came of the batch whose first flight has a number; None where it was not flown.

        Raises
        ------
        StoreError
            The file is damaged, or of other flights.
        """
        path = self._path(first)
        if not path.exists():
            return None
        found = self._read(path)
        if found.shape != (count,):
            raise StoreError(f"{path}: arrived {found.size} flights; expected {count}")
        return found

    def write(self, first: int, values: np.ndarray) -> None:
        """Keep what came of a batch: the number of each flight, and its value."""
        content = io.BytesIO()  # written to a file by NumPy itself, a full disk would be an error without its reason
        np.save(content, np.stack([first + np.arange(values.size, dtype=float), values]))
        with new_file(self._path(first), overwrite=True) as partial:
            partial.write_bytes(content.getvalue())
            append_checksum(partial)

    def remove_damaged(self) -> list[str]:
        """Remove the batches that are damaged, which are then to be flown again; a message of each."""
        messages: list[str] = []
        for path in self._batches():
            try:
                self._read(path)
            except StoreError as error:
                path.unlink()
                messages.append(f"{error}: flown again")
        return messages

    @property
    def flown(self) -> int:
        """Flights that were flown so far."""
        return sum(self._read(path).size for path in self._batches())

    def _read(self, path: Path) -> np.ndarray:
        """Values of a batch, verified."""
        try:
            verified = verify_checksum(path)
            if verified != (self.format == FORMAT):
                raise StoreError(f"{path}: arrived a batch without its checksum; expected it as anser wrote it")
            content = np.load(path)
        except DamagedFileError as error:
            raise StoreError(str(error)) from None
        except StoreError:
            raise
        except (OSError, ValueError, EOFError) as error:
            raise StoreError(
                f"{path}: arrived a batch that cannot be read ({error}); expected it as anser wrote it"
            ) from None
        if not verified:
            return content
        numbers = int(path.stem) + np.arange(content.shape[1])
        if not np.array_equal(content[0], numbers):
            raise StoreError(f"{path}: arrived a batch from flight {content[0, 0]:.0f} on; expected {path.stem}")
        return content[1]

    def _batches(self) -> list[Path]:
        return sorted(self.folder.joinpath(_FLOWN).glob("*.npy"))

    def _path(self, first: int) -> Path:
        return self.folder / _FLOWN / f"{first:09d}.npy"


def provenance(study: Study, scenario: Scenario) -> dict[str, object]:
    """What the numbers of a rare event follow from."""
    return {
        "format_version": FORMAT,
        "study_hash": study.hash,
        "scenario_hash": scenario.hash,
        "seed": study.seed,
        **version_attributes(),
    }


def _read_config(folder: Path) -> tuple[dict[str, Any], bool]:
    """What was asked for, and whether it has a checksum."""
    path = folder / _CONFIG_FILE
    if not path.is_file():
        raise StoreError(f"{folder}: arrived a folder without {_CONFIG_FILE}; expected that of a rare event")
    try:
        return read_document(path)
    except DamagedFileError as error:
        raise StoreError(str(error)) from None
