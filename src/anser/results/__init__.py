"""Results of a flight: a labelled dataset, a file of it, a summary, and the software that computed them."""

from anser.results.airframe_dataset import airframe_dataset
from anser.results.arrival import closest_approach, least_distance
from anser.results.arrival_figure import ArrivalFigure, arrival_figure, duration_words, planned_arrivals
from anser.results.checksums import DamagedFileError
from anser.results.dataset import surfaces_of, to_dataset
from anser.results.envelope_dataset import envelope_dataset
from anser.results.envelope_reasons import OUTCOMES, REASONS, judge
from anser.results.flight_check import flight_problem
from anser.results.intervals import log_interval, order_statistic_interval, quantile, wilson_interval
from anser.results.linear_model import linear_dataset, linear_document, unit_of
from anser.results.margin_dataset import CLOSED_LOOP, margin_dataset, margin_map_dataset, margin_table
from anser.results.mcnemar import mcnemar_exact
from anser.results.netcdf import read_netcdf, write_netcdf
from anser.results.network_summary import summarize_network
from anser.results.notebook_table import notebook_table
from anser.results.plain import finite_or_none, plain_attributes, write_json
from anser.results.plan_dataset import plan_dataset
from anser.results.plan_record import ClosestApproach, PlanDetails, PlanExtremes, PlanSamples
from anser.results.plan_summary import plan_margins, plan_summary
from anser.results.plan_table import TRAJECTORY_COLUMNS, write_trajectories
from anser.results.provenance import version_attributes, versions
from anser.results.rank_correlation import rank_correlation
from anser.results.robustness_dataset import robustness_dataset
from anser.results.robustness_statistics import (
    FailureCorrelation,
    FirstBreak,
    Success,
    failure_correlations,
    first_breaks,
    flights_of,
    success,
)
from anser.results.separated import nearest_other
from anser.results.sobol_indices import SobolIndices, saltelli_shares, sobol_indices
from anser.results.summary import CLEARANCE_MIN_M, read_summary, summarize, write_summary
from anser.results.summary_text import fleet_words, summary_html, summary_text
from anser.results.sweep_dataset import sweep_dataset
from anser.results.trim_map import TrimMap
from anser.simulation.fleet_summary import ARRIVAL_MARGIN_S

__all__ = [
    "ARRIVAL_MARGIN_S",
    "CLEARANCE_MIN_M",
    "CLOSED_LOOP",
    "OUTCOMES",
    "REASONS",
    "TRAJECTORY_COLUMNS",
    "ArrivalFigure",
    "ClosestApproach",
    "DamagedFileError",
    "FailureCorrelation",
    "FirstBreak",
    "PlanDetails",
    "PlanExtremes",
    "PlanSamples",
    "SobolIndices",
    "Success",
    "TrimMap",
    "airframe_dataset",
    "arrival_figure",
    "closest_approach",
    "duration_words",
    "envelope_dataset",
    "failure_correlations",
    "finite_or_none",
    "first_breaks",
    "fleet_words",
    "flight_problem",
    "flights_of",
    "judge",
    "least_distance",
    "linear_dataset",
    "linear_document",
    "log_interval",
    "margin_dataset",
    "margin_map_dataset",
    "margin_table",
    "mcnemar_exact",
    "nearest_other",
    "notebook_table",
    "order_statistic_interval",
    "plain_attributes",
    "plan_dataset",
    "plan_margins",
    "plan_summary",
    "planned_arrivals",
    "quantile",
    "rank_correlation",
    "read_netcdf",
    "read_summary",
    "robustness_dataset",
    "saltelli_shares",
    "sobol_indices",
    "success",
    "summarize",
    "summarize_network",
    "summary_html",
    "summary_text",
    "surfaces_of",
    "sweep_dataset",
    "to_dataset",
    "unit_of",
    "version_attributes",
    "versions",
    "wilson_interval",
    "write_json",
    "write_netcdf",
    "write_summary",
    "write_trajectories",
]
