"""Analyses of an aircraft with its autopilot: trim, linear models, margins, step tests, envelope, robustness.

====================  ==================================================================================================
``airframes``         list, description and check of airframes; coefficients, thrust and level flight over airspeed
``trim_points``       trim of an aircraft; functions that all analyses share: airframe, airspeed, autopilot gains
``linear_models``     linear model, from ``linearization``, as dataset, JSON or python-control system
``modes``             modes of a linear model: participation, names, comparison with ideal dynamic inversion
``margins``           stability margins, from ``loop_margins``, at a trim point or over a grid
``envelope``          trims over altitude and Mach number, and step commands flown from each
``robustness``        flights of F-16s that deviate from the onboard model
``surveys``           batches of many trim points or flights; classification of flights as reached, limited, failed
``step_tests``        step tests of the autopilot's loops, which ``step_flights`` flies, and their results
``deep_stalls``       deep stall of the F-16
``precompilation``    compilation ahead of time for the command line
====================  ==================================================================================================
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
