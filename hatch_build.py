"""Build hook: adds the commit of the clone, and to wheels the scenarios and studies, to the package's files."""

import json
import runpy
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

SHIPPED = ("scenarios", "studies")


class PackageFiles(BuildHookInterface):
    """Files of the built package that stand elsewhere in a clone, or only in git."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Add the files to a build; an editable install has none, because it reads the clone."""
        if version == "editable":
            return
        root = Path(self.root)
        source = runpy.run_path(str(root / "src" / "anser" / "version.py"))
        name = source["BUILD_INFO"]
        if not (root / "src" / "anser" / name).exists():  # a source distribution has the file of its clone
            cloned = source["read_clone"](root)
            commit = source["UNKNOWN"] if cloned is None else cloned.commit
            written = Path(self.directory) / name
            written.parent.mkdir(parents=True, exist_ok=True)
            written.write_text(json.dumps({"commit": commit}) + "\n", encoding="utf-8")
            package = "anser" if self.target_name == "wheel" else "src/anser"
            build_data["force_include"][str(written)] = f"{package}/{name}"
        if self.target_name == "wheel":
            for folder in SHIPPED:
                build_data["force_include"][str(root / folder)] = f"anser/shipped/{folder}"

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Remove the file of the commit, which is part of the built package now."""
        (Path(self.directory) / "build_info.json").unlink(missing_ok=True)
