"""Reports (HTML pages), figures and exports of flights, plans, studies and campaigns, from their datasets.

==========================  ========================================================================================
``flight_page``             report page of a flight, or of two flights side by side
``flight_data``             data of the page (``derived_variables``: variables, events; ``flight_margins``: margins)
``flight_figures``          figures of a flight by name; ``flight_sheet``: their common layout
``flight_tracks``           the figure of the map; ``flight_histories``: the figures over time
``aircraft_flight``         figures and page of one aircraft's flight (``adaptation_figures``: its estimates)
``aircraft_figures``        airframe, deep stall, steps, tracking; ``envelope_figures``: flight envelope
``campaign_page``           report page of a campaign (``campaign_data``: content); ``campaign_figures``: for print
``plan_figures``            figures of a plan; ``robustness_figures``: of a robustness study
``identification_figures``  figures and page of an identification
``exports``                 files for other programs: KML, CZML, CSV, Parquet, MATLAB
``style``                   colours, line styles and figure files; ``labels``: texts in figures
``page_templates``          HTML from templates; ``svg_charts``: charts in pages
``estimates``               estimates of adaptive autopilots: names and true values
==========================  ========================================================================================
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
