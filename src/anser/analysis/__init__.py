"""Analyses of an aircraft with its autopilot: trim, linear models, margins, step tests, envelope, robustness.

====================  ==================================================================================================
``airframes``         list, description and check of airframes; survey of coefficients, thrust and level flight
``trim_points``       trim with a result to print; airframe, airspeed, gains and trim points for all analyses
``linear_models``     linear model with modes as dataset, JSON or python-control system; ``linearization``: computation
``modes``             modes of a linear model: participation, names, comparison with ideal dynamic inversion
``margins``           stability margins at a trim point or over a grid; ``loop_margins``: computation
``envelope``          trims over altitude and Mach number, and step commands flown from each
``robustness``        flights of F-16s that deviate from the onboard model
``surveys``           compiled programs over many trim points or flights, and classification of the flights
``step_tests``        step tests of the autopilot's loops and their results; ``step_flights``: flights of the tests
``deep_stalls``       deep stall of the F-16
``precompilation``    compilation ahead of time for the command line
====================  ==================================================================================================
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
