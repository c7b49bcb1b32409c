"""Store of a rare-event analysis: the configuration, and the results of each batch of flights, in checksummed files."""

import io
import json
from pathlib import Path
from typing import Any

import numpy as np

from anser.campaigns.store_integrity import (
    FORMAT,
    UNCHECKED_FORMAT,
    AbstractFlightStore,
    StoreError,
    damage_as_store_error,
)
from anser.campaigns.study import Study, validate_study
from anser.config.errors import ScenarioError
from anser.files import new_file, new_folder
from anser.results.checksums import add_checksum, append_checksum, read_document, verify_checksum
from anser.results.documents import version_attributes, write_json
from anser.scenario.schema import Scenario, validate

_CONFIG_FILE = "rare-asked.json"
_FLOWN = "flown"


class RareStore(AbstractFlightStore):
    """Store of a rare-event analysis in a folder; see `create` and `open`.

    It contains the study and scenario, and the values of each batch of flights. Attributes: see `AbstractFlightStore`.
    """

    description = "a rare event"

    @classmethod
    def create(cls, folder: Path, study: Study, scenario: Scenario) -> "RareStore":
        """Create a new folder; raises FileExistsError if the folder exists."""
        configuration = {
            "study": study.model_dump_json(exclude_unset=True),
            "scenario": scenario.model_dump_json(exclude_unset=True),
            **provenance(study, scenario),
        }
        with new_folder(folder) as staging:
            (staging / _FLOWN).mkdir()
            write_json(add_checksum(configuration), staging / _CONFIG_FILE)
        return cls(folder, study, scenario, FORMAT)

    @classmethod
    def open(cls, folder: Path) -> "RareStore":
        """Open an existing folder; raises StoreError if missing, damaged or of another format."""
        configuration, has_checksum = _read_config(folder)
        version = configuration.get("format_version")
        if version not in (FORMAT, UNCHECKED_FORMAT) or (version == FORMAT and not has_checksum):
            detail = f"arrived format {version}{'' if has_checksum else ' without its checksum'}; expected {FORMAT}"
            raise StoreError(f"{folder / _CONFIG_FILE}: {detail}")
        try:
            study = validate_study(json.loads(configuration["study"]), f"{folder}, study")
            return cls(folder, study, validate(json.loads(configuration["scenario"]), f"{folder}, scenario"), version)
        except ScenarioError:
            raise
        except (KeyError, TypeError, ValueError) as error:
            detail = f"arrived a file that cannot be read ({error}); expected it as anser wrote it"
            raise StoreError(f"{folder / _CONFIG_FILE}: {detail}") from None

    def refuse_unless_same(self, study: Study, scenario: Scenario) -> None:
        """Raise StoreError if study, scenario or a software version that affects results differs from the store's."""
        self._refuse_differences(_read_config(self.folder)[0], provenance(study, scenario))

    def values(self, start: int, count: int) -> np.ndarray | None:
        """Return the values of a batch of `count` flights from flight number `start` on; None if not yet flown.

        Raises
        ------
        StoreError
            The file is damaged, or has another number of flights.
        """
        path = self._path(start)
        if not path.exists():
            return None
        values = self._read(path)
        if values.shape != (count,):
            raise StoreError(f"{path}: arrived {values.size} flights; expected {count}")
        return values

    def write(self, start: int, values: np.ndarray) -> None:
        """Store the values of a batch of flights with consecutive numbers from `start` on."""
        content = io.BytesIO()  # written to a file by NumPy itself, a full disk would be an error without its reason
        np.save(content, np.stack([start + np.arange(values.size, dtype=float), values]))
        with new_file(self._path(start), overwrite=True) as partial:
            partial.write_bytes(content.getvalue())
            append_checksum(partial)

    def _remove_damaged(self) -> list[str]:
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
        """Number of completed flights."""
        return sum(self._read(path).size for path in self._batches())

    def _read(self, path: Path) -> np.ndarray:
        """Return the values in the file of a batch, after verification of its checksum."""
        try:
            with damage_as_store_error():
                verified = verify_checksum(path)
            if verified != (self.format == FORMAT):
                raise StoreError(f"{path}: arrived a batch without its checksum; expected it as anser wrote it")
            content = np.load(path)
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

    def _path(self, start: int) -> Path:
        return self.folder / _FLOWN / f"{start:09d}.npy"


def provenance(study: Study, scenario: Scenario) -> dict[str, object]:
    """Return what determines the results: the identification of study, scenario and software."""
    return {
        "format_version": FORMAT,
        "study_hash": study.hash,
        "scenario_hash": scenario.hash,
        "seed": study.seed,
        **version_attributes(),
    }


def _read_config(folder: Path) -> tuple[dict[str, Any], bool]:
    """Return the content of the folder's configuration file, and whether it has a checksum."""
    path = folder / _CONFIG_FILE
    if not path.is_file():
        raise StoreError(f"{folder}: arrived a folder without {_CONFIG_FILE}; expected that of a rare event")
    with damage_as_store_error():
        return read_document(path)
