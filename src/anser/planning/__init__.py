"""Planners, and the quantities that every planner shares.

======================  ===============================================================================================
``certified``           planner whose paths are proven to keep limits, separation and keep-outs (package)
``decentralised``       planner of a fleet without a central planner: the aircraft agree by messages (package)
``published``           planner of the publication: equal path lengths for a simultaneous arrival (package)
``holds``               holding patterns after the arrival (package)
``limits``              flight limits of a path, and a catalogue of the limits for checks, refusals and tables
``timed_path``          path over time, piecewise quintic
``demand``              airspeed, bank angle and load factor that a motion requires
``separation``          required separation, and distances from keep-outs
``goals``               motion of a goal between timed waypoints
======================  ===============================================================================================
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
