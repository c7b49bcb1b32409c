"""Scenario files: their tables (schema_*), checks, and the construction of a flight from a scenario (build_*).

==========================  ============================================================================================
``schema``                  the validated `Scenario`; ``schema_tables``: all tables without the checks between tables
``schema_settings``         tables for time, fleet, limits, guidance, hold, requirements, network, user-defined parts
``schema_aircraft``         tables for goals, aircraft, starts, rendezvous, gains, adaptation
``schema_airspace``         tables for arrival, separation, keep-outs, events
``schema_environment``      tables for Earth, atmosphere, wind, turbulence, gusts
``schema_sensing``          tables for sensors and estimators; ``schema_excitation``: test inputs
``schema_checks``           checks between tables; also: ``schema_airspace_checks``, ``schema_reach``, ``schema_chart``
``files``                   loading, format conversion, starter file
``sounding_file``           reading of soundings; ``wind_field_file``: reading of wind fields
``unused_keys``             keys without effect; ``cautions``: settings that probably do not work as intended
``flight_checks``           checks that need the built flight
``build``                   construction of the flight, with ``build_aircraft``, ``build_environment``,
                            ``build_wind_field``, ``build_sensing``, ``build_planner``, ``build_excitation``
``user_parts``              user-defined parts of the closed loop
==========================  ============================================================================================
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
