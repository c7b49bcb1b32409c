"""Folder of a rare event: what was asked, and what came of every batch of flights, each in a file written whole."""

import json
from pathlib import Path

import numpy as np

from anser.campaigns.store import StoreError
from anser.campaigns.study import Study, validate_study
from anser.output_files import new_file, new_folder
from anser.results import version_attributes, write_json
from anser.scenario import Scenario
from anser.scenario.schema import validate

FORMAT = 1
_ASKED = "rare-asked.json"
_FLOWN = "flown"


class RareStore:
    """What a rare event's folder holds; open one with `create` or `open`.

    Attributes
    ----------
    folder
        Its folder.
    study, scenario
        What is flown.
    """

    def __init__(self, folder: Path, study: Study, scenario: Scenario) -> None:
        self.folder, self.study, self.scenario = folder, study, scenario

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
            write_json(asked, beside / _ASKED)
        return cls(folder, study, scenario)

    @classmethod
    def open(cls, folder: Path) -> "RareStore":
        """Open that of a folder; StoreError where there is none, or one of another format."""
        try:
            asked = json.loads((folder / _ASKED).read_text(encoding="utf-8"))
        except (OSError, ValueError):
            words = f"arrived a folder without {_ASKED}; expected that of a rare event"
            raise StoreError(f"{folder}: {words}") from None
        if asked.get("format_version") != FORMAT:
            words = f"arrived format {asked.get('format_version')}; expected {FORMAT}"
            raise StoreError(f"{folder}: {words}")
        study = validate_study(json.loads(asked["study"]), f"{folder}, study")
        return cls(folder, study, validate(json.loads(asked["scenario"]), f"{folder}, scenario"))

    def refuse_unless_same(self, study: Study, scenario: Scenario) -> None:
        """Refuse to go on with another study, scenario or version of what numbers depend on (StoreError)."""
        asked = json.loads((self.folder / _ASKED).read_text(encoding="utf-8"))
        for key, wanted in provenance(study, scenario).items():
            if asked.get(key) != wanted:
                words = f"arrived a rare event with the {key.replace('_', ' ')} {asked.get(key)}"
                raise StoreError(f"{self.folder}: {words}; expected {wanted}, to go on with it")

    def values(self, first: int, count: int) -> np.ndarray | None:
        """What came of the batch whose first flight has a number; None where it was not flown."""
        path = self._path(first)
        if not path.exists():
            return None
        found = np.load(path)
        if found.shape != (count,):
            raise StoreError(f"{path}: arrived {found.shape[0]} flights; expected {count}")
        return found

    def write(self, first: int, values: np.ndarray) -> None:
        """Keep what came of a batch."""
        with new_file(self._path(first), overwrite=True) as partial:
            np.save(partial, values)

    @property
    def flown(self) -> int:
        """Flights that were flown so far."""
        return sum(np.load(path, mmap_mode="r").shape[0] for path in (self.folder / _FLOWN).glob("*.npy"))

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
