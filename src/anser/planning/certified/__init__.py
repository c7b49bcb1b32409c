"""The certified planner: paths within flight limits, separation and keep-outs, with rigorous bounds as the proof.

The modules are listed from a fleet's plan down to its mathematics. Modules of `anser.missions` call this package:
``first_plan`` before the flight, ``event_replanning`` after an event, ``segments`` if the flight stops for a new plan,
``refusal`` to explain a missing plan. In flight, the closed loop calls ``planner``.

======================  ===============================================================================================
``planner``             planner in the closed loop: first plan, corrections in flight, replanning
``replanning``          correction of a plan in flight, or a new plan from the current state
``search``              attempts at a plan, until a certificate satisfies every constraint
``arrival_times``       arrival times: necessary conditions, reachable intervals, search for the earliest time
``certified_plan``      one attempt at given arrival times: one candidate per aircraft, then the certificate
``candidates``          candidate paths from three generators, and their conversion to timed paths
``detours``             generator 1: direct paths of two turns, and detours from them with a target length
``turn_leg_paths``      generator 2: four turns and three legs, by damped least squares
``spline_search``       generator 3: splines in time (``splines``), by damped least squares on violated constraints
``timed_profiles``      altitude and airspeed (``profile``) for a flight time, with the shortest direct paths
``routes``              turns and legs as a path by arc length
``clearance``           distances between tracks and from keep-outs; in large fleets bounded by cylinders first
``path_bounds``         rigorous bounds of a path between its knots, the basis of the certificate
``fitted_wind``         layers of wind fitted to a wind field, with bounds of the difference from the field
``task``                the planning problem: aircraft, airspace, keep-outs, arrival rule
======================  ===============================================================================================
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
