from .geographic import to_czml, to_kml
from .tables import to_csv, to_mat, to_parquet

__all__ = [
    "to_csv",
    "to_czml",
    "to_kml",
    "to_mat",
    "to_parquet",
]
