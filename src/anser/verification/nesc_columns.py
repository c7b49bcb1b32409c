"""Columns of the NESC participants' logs."""

_UNITS = (
    ("_ft_s2", "ft/s^2"),
    ("_ft_s", "ft/s"),
    ("_ft_min", "ft/min"),
    ("_ftlbf", "ft lbf"),
    ("_lbf_ft2", "lbf/ft^2"),
    ("_lbf", "lbf"),
    ("_slug_ft3", "slug/ft^3"),
    ("_deg_s", "deg/s"),
    ("_dgR", "deg R"),
    ("_nmi_h", "nmi/h"),
    ("_deg", "deg"),
    ("_ft", "ft"),
)
"""Units that the names of the published columns carry."""


def column_unit(name: str) -> str:
    """Unit of a published column; 1 for a pure number."""
    return next((unit for suffix, unit in _UNITS if suffix in name), "1")
