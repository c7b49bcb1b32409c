"""Verification: checks that compare results of anser with published values.

====================  ==============================================================================
``suite``             selection and run of the checks
``checks``            common parts: comparisons, tolerances, outcomes, published data
``standards``         atmosphere and Earth
``textbook``          the F-16 of Stevens & Lewis (``linear_models``: linear models and modes)
``f16_data``          the F-16's tables; ``aerosonde``: the Aerosonde's published forces and moments
``nesc``              NASA's check-cases (``nesc_cases``: definitions, ``nesc_flight``: flights)
``integrator``        order of convergence and conserved quantities
``polynomial_paths``  paths of the published planner; ``missions``: whole flights
====================  ==============================================================================
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
