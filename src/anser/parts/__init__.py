"""Interfaces of the closed loop's parts (sensors, estimators, guidance, controllers, planners), and their signals.

======================  ===============================================================================================
``perception``          sensors and estimator; instant, truth, reading and belief
``controllers``         guidance (from belief to command) and controller (from command to surfaces and throttle)
``planners``            planner of a fleet; reports of the aircraft, performance and plans
``paths``               reference motion over time, and the command of airspeed, path angle and course
``input_signals``       step, doublet, 3-2-1-1, sine sweep and multisine over time
``excitation``          input signals added to controls and commands in the closed loop
``part``                base class of the interfaces
======================  ===============================================================================================

To write a part, subclass `AbstractSensors`, `AbstractEstimator`, `AbstractGuidance`, `AbstractController` or
`AbstractPlanner`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
