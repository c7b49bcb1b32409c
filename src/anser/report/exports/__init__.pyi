from .czml import to_czml
from .formats import FORMATS
from .kml import to_kml
from .tables import to_csv, to_mat, to_parquet

__all__ = [
    "FORMATS",
    "to_csv",
    "to_czml",
    "to_kml",
    "to_mat",
    "to_parquet",
]
