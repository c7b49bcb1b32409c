from .dataset import to_dataset
from .netcdf import read_netcdf, write_netcdf
from .plan_outputs import plan_summary
from .plan_record import plan_dataset
from .summary import read_summary, summarize, write_summary

__all__ = [
    "plan_dataset",
    "plan_summary",
    "read_netcdf",
    "read_summary",
    "summarize",
    "to_dataset",
    "write_netcdf",
    "write_summary",
]
