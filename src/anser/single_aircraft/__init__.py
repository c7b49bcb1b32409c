"""Single aircraft: model with trim and linear model, performance sheet, simulated flight, and a simulator by steps.

=====================  =================================================================================================
``model``              `AircraftModel`: description, trim, linear model, performance, equations of motion
``flight``             `simulate`: a flight under controls, or in the closed loop under commands
``simulator``          `Simulator`: open-loop motion step by step
``starts``             start of a flight from a trim or from named variables
``controls``           controls and commands as samples; ``excitation``: test inputs of the closed loop
``air``                Earth, atmosphere, wind and gusts; ``changes``: faults, ice, shifted load
``linear_feedback``    linear state feedback as a controller
``performance``        performance sheet
``frozen_adaptation``  history of an adaptive autopilot's estimates, and margins with frozen estimates
=====================  =================================================================================================
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
