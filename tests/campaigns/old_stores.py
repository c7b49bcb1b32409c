"""Stores of the first format: as those of today, with zero as the fill value, marks of chunks, and no checksums."""

import json
import shutil

import numpy as np
import zarr


def as_first_format(folder):
    """Turn the store of a complete campaign into what the first format would have held."""
    root = folder / "flights.zarr"
    shutil.rmtree(folder / "checksums")
    (root / ".zmetadata").unlink()
    shutil.rmtree(root / "flown")
    group = zarr.open_group(root, mode="r+")
    group.attrs["format_version"] = 1
    for path in root.rglob(".zarray"):
        about = json.loads(path.read_text())
        if about["fill_value"] is None:
            kind = np.dtype(about["dtype"]).kind
            about["fill_value"] = {"b": False, "i": -1 if "series" in path.parts else 0}.get(
                kind, "" if kind == "U" else 0
            )
        path.write_text(json.dumps(about))
    chunk = int(group.attrs["chunk"])
    count = -(-group["flight"].shape[0] // chunk)
    labels = {"long_name": "Whether the flights of a chunk are complete", "_ARRAY_DIMENSIONS": ["chunk"]}
    group.create_array("chunk_done", shape=(count,), chunks=(1,), dtype="int8", fill_value=0, attributes=labels)
    zarr.open_group(root, mode="r+")["chunk_done"][:] = 1
