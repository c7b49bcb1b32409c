"""The closed loop of one aircraft and of a fleet, with its recorders and running summaries.

======================  ===============================================================================================
``flight``              a fleet's flight: definition, state between two steps, `fly`, `step_fleet`
``start``               trimmed fleet, first reports, and the state at time 0
``closed_loop``         one step of one aircraft: `perceive`, `guide`, `control`, `move`; status codes
``vehicle``             one aircraft: parts, mission, faults, state, and integration of the motion
``stand_off``           check of the least distance from the goal
``recorders``           samples, recorders, and the loop that records rows
``fleet_summary``       running summary of a flight, in place of a history
``open_loop``           one aircraft without mission, under prescribed controls or commands
``response``            step responses of the autopilot's loops, and their metrics
``survey_flight``       metrics of step responses, without time histories
======================  ===============================================================================================
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
