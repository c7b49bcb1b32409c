"""Scenarios planned and flown: single flights, batches, sweeps and saved flights.

======================  ===============================================================================================
``plans``               `plan`: the first plan of a scenario by the planner that the scenario names; plan files
``first_plan``          interface of a first plan, and the first plans by the published and the certified planner
``consensus``           first plan of a fleet without a central planner, on which the aircraft agree by messages
``user_plans``          first plan by a user-defined planner
``refusal``             reasons for which the certified planner found no plan
``runs``                `run`: one flight of a scenario, from the plan to the result
``segments``            flight by compiled steps in segments, and new plans between two steps
``events``              events of a flight in order of time (`EventSchedule`), and reassignment of goals
``event_replanning``    effect of one event on the plan: exit path of a departing aircraft, new plan of the others
``flight_batches``      `fly_many`: many flights, computed together in batches
``series``              time series of variables, recorded for many flights
``flight_outputs``      outputs that a study defines, one number per flight
``sweeps``              `sweep`: flights with every combination of values of some scenario keys
``saved_flights``       flights read from run folders
``plan_output``         dataset, summary, figure and table of a plan
``plan_samples``        samples of planned paths, greatest and least values on the paths, and closest approaches
``batches``             default batch size, and the callback for progress
======================  ===============================================================================================
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
