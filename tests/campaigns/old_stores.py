"""Stores of the first format: zero fill values, completion marks of chunks, and no checksums."""

import json
import shutil

import numpy as np
import zarr


def as_first_format(folder):
    """Convert the store of a complete campaign to the first format."""
    root = folder / "flights.zarr"
    shutil.rmtree(folder / "checksums")
    (root / ".zmetadata").unlink()
    shutil.rmtree(root / "flown")
    group = zarr.open_group(root, mode="r+")
    group.attrs["format_version"] = 1
    for path in root.rglob(".zarray"):
        metadata = json.loads(path.read_text())
        if metadata["fill_value"] is None:
            kind = np.dtype(metadata["dtype"]).kind
            metadata["fill_value"] = {"b": False, "i": -1 if "series" in path.parts else 0}.get(
                kind, "" if kind == "U" else 0
            )
        path.write_text(json.dumps(metadata))
    chunk = int(group.attrs["chunk"])
    count = -(-group["flight"].shape[0] // chunk)
    labels = {"long_name": "Whether the flights of a chunk are complete", "_ARRAY_DIMENSIONS": ["chunk"]}
    group.create_array("chunk_done", shape=(count,), chunks=(1,), dtype="int8", fill_value=0, attributes=labels)
    zarr.open_group(root, mode="r+")["chunk_done"][:] = 1
