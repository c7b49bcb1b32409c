"""Reports (HTML pages), figures and exports of flights, plans, studies and campaigns, from their datasets.

==========================  ========================================================================================
``flight_page``             report page of a flight, or of two flights side by side
``campaign_page``           report page of a campaign
``identification_figures``  figures and report page of an identification
``aircraft_flight``         figures and report page of one aircraft's flight
``..._figures``             other modules with this ending: figures for print of the subject in the name
``..._data``                content of the report page of the subject in the name
``derived_variables``       variables, limits and events of a flight's page
``flight_margins``          margins of a flight to requirements and limits
``flight_sheet``            common layout of a flight's figures
``flight_tracks``           figure of a flight as a map
``flight_histories``        figures of a flight over time
``exports``                 files for other programs: KML, CZML, CSV, Parquet, MATLAB
``style``                   colours, line styles and figure files
``labels``                  texts in figures
``page_templates``          HTML of pages from templates
``svg_charts``              charts in pages
``estimates``               estimates of adaptive autopilots: names and true values
==========================  ========================================================================================
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
