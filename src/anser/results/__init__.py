"""Datasets, summaries, plan records and statistics of flights.

=======================  ========================================================================================
``dataset``              a flight's recorded variables as a dataset (``variable_labels``: labels and units)
``netcdf``               the dataset as a file (``checksums``: detection of damaged files)
``summary``              the summary `summary.json` of a flight; ``summary_format``: the summary as text
``arrival``              whether and when an aircraft arrives, and how accurately a fleet does
``requirements``         the scenario's requirements and their evaluation; ``separation``: distances in the fleet
``faults``               faults that adaptive autopilots detected
``network_summary``      communication of a decentralised fleet
``plan_record``          the dataset of a plan; ``plan_outputs``: its files
``flight_rows``          results of many flights, one row per flight
``sampling_statistics``  intervals, tests and sensitivity indices; ``robustness_statistics``: success rates
``documents``            JSON files, software versions, tables in notebooks
=======================  ========================================================================================
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
