"""The certified planner: paths that keep limits, distances and keep-outs, with bounds that prove it.

Where a plan comes from, roughly top-down; what is indented is part of the line above it. Its callers are
`anser.planning.certified.planner`, which flies plans, and `anser.missions.refusal`, which says why there is none.

============================  =========================================================================================
``search``                    `search`: attempts, stage by stage, until a certificate keeps everything
``arrival_proposals``         the stages: which arrival times to try, with which candidates
.. ``earliest``               times to try before one that works
.. ``arrivals``               arrival times that are open to an aircraft by itself
.. ``necessary_conditions``   arrival times that no path can keep
``certified_plan``            one attempt, `plan_at`: candidates for given times, placed and certified
``candidate_sets``            how many candidates of which kind
``candidates``                the candidates themselves, of three generators in one type
.. ``timed_profile``          altitude and airspeed by time (``profile``), with the shortest direct paths
.. ``detours``                generator 1: the direct path of two turns, and detours from it that take the time
.. ``turn_leg_paths``         generator 2: any four turns and three legs, by damped least squares
.. ``spline_trajectories``    generator 3: splines in time (``spline``), from guesses (``spline_guesses``), by damped
                              least squares on what they violate (``spline_equations``)
.. ``route``                  turns (``smooth_turn``) and legs as a path by its length
.. ``arrival_motion``         the motion that a rendezvous prescribes
``placement``                 one candidate for each aircraft, so that all keep the separation
.. ``tracking``               a candidate or a path at the instants of a fleet's clock
.. ``clearance``              distances between tracks and from keep-outs; ``broad_phase``: in large fleets
``delivery``                  profile and route as the path that is flown
``path_bounds``               bounds of a path between its knots, of which the certificate is made
============================  =========================================================================================

Two stand apart: ``task``, what is asked (aircraft, airspace, keep-outs, arrival rule), which all of them read; and
``renewal``, a plan bent or made anew on the way, by `plan_fleet_at` of ``certified_plan``.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
