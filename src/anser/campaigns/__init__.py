"""Monte Carlo campaigns and rare-event analyses: study files, stored results, estimates and reports.

===================  =================================================================================================
``campaign_folder``  entry points: fly, resume or read the campaign of a study file
``study``            tables and keys of the study file; ``distributions``: keys and values of the tables [[vary]]
``sampling``         values of the varied parameters and seed of each flight
``flights``          scenario of each flight, checks before the first flight, flights in groups (chunks)
``processes``        worker processes on this machine; ``machine``: free memory; ``cluster``: workers elsewhere (dask)
``store``            stored results and the stopping rule; ``store_integrity``: lock and checksums of the folder
``estimates``        success probability, quantiles, causes of failure; ``sensitivity``: influence of each parameter
``comparison``       comparison of two campaigns with equal seeds, flight by flight
``replay``           repeated flights compared with the stored results; archive of the worst flights
``campaign_report``  report page, figures and tables of a campaign
``rare_events``      entry points of rare-event analyses; ``rare_flights``: flights, store; ``subset``: the algorithm
===================  =================================================================================================
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
