"""Autopilot by nonlinear dynamic inversion (gains, loops, control allocation), guidance, and DAVE-ML control laws.

``rate_control`` (``autopilot``) and ``allocate`` (``allocation``) invert the dynamics of the fast loop. Control
effectiveness is the derivative of the moment with respect to the surface deflections.

=======================  ===============================================================================================
``inversion_autopilot``  the autopilot as a controller of the closed loop, commanded at one of its three loops
``autopilot``            the three loops as functions: body rates, attitude (mu, alpha, beta), velocity
``allocation``           control effectiveness, surface deflections for a moment, control authority
``velocity_loop``        velocity loop: throttle, bank and angle of attack for commanded rates of V, gamma and chi
``onboard_model``        what the loops invert: forces, control effectiveness and motion along the path
``feedback``             linear part of the loops: virtual control, differentiating filter, braking limit
``autopilot_state``      integrals, filters and measured residual of the onboard model between samples
``gains``                gains of the loops: published, from bandwidths, or derived from the aircraft
``loop_separations``     ratios of bandwidths between nested loops
``limits``               flight envelope to which commands are limited
``guidance``             velocity commands from the plan, or for the hold around the goal
``ground_clearance``     height needed to level off, and the pull-up near the ground
``probing``              multisines on the surfaces while an adaptive estimator needs them
``dave_ml_laws``         control laws from DAVE-ML files, and guidance that commands their inputs
=======================  ===============================================================================================
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
