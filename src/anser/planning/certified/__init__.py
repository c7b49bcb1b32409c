"""The certified planner: paths within flight limits, separation and keep-outs, with rigorous bounds as the proof.

Modules roughly top-down, from a fleet's plan to the mathematics below it. From outside, `anser.missions` calls this
package: ``first_plan`` before the flight, ``event_replanning`` after an event, ``segments`` for a plan
between two steps, and ``refusal`` for the reasons of a missing plan. In flight, the closed loop calls ``planner``.

======================  ===============================================================================================
``planner``             the planner in the loop: first plan, corrections in flight, replanning
``replanning``          correction of a plan in flight, or a new plan from the current state
``search``              attempts, stage by stage, until a certificate satisfies every constraint
``arrival_times``       arrival times: necessary conditions, reachable intervals, search for the earliest
``certified_plan``      one attempt at given arrival times: one candidate per aircraft, then the certificate
``candidates``          candidates of three generators, in one type, and their delivery as timed paths
``detours``             generator 1: direct paths of two turns, and detours from them with a target length
``turn_leg_paths``      generator 2: four turns and three legs, by damped least squares
``spline_search``       generator 3: splines in time (``splines``), by damped least squares on the violated constraints
``timed_profiles``      altitude and airspeed over time (``profile``) with the shortest direct paths
``routes``              turns and legs as a path by arc length
``clearance``           distances between tracks and from keep-outs, with a broad phase for large fleets
``path_bounds``         rigorous bounds of a path between its knots, the basis of the certificate
``task``                the planning problem: aircraft, airspace, keep-outs, arrival rule
======================  ===============================================================================================
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
