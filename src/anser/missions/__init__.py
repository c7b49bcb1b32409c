"""Scenarios planned and flown: single flights, batches, sweeps and saved flights.

======================  ===============================================================================================
``plans``               `plan`: the first plan of a scenario by the planner that the scenario names; plan files
``first_plan``          first plan by the published or the certified planner, and the interface of first plans
``consensus``           first plan of a fleet without a central planner, by messages
``user_plans``          first plan by a user-defined planner
``refusal``             reasons for a missing plan of the certified planner
``runs``                `run`: one flight of a scenario, from the plan to the result
``segments``            compiled segments of a flight, and new plans between two steps
``events``              events of a flight in order of time (`EventSchedule`), and reassignment of goals
``event_replanning``    effect of one event on the plan: exit path, new plan, new holds
``flight_batches``      `fly_many`: many flights, computed together in batches
``series``              variables over time, recorded for many flights
``flight_outputs``      outputs of a study, one number per flight
``sweeps``              `sweep`: flights with every combination of values of some scenario keys
``saved_flights``       flights read from run folders
``plan_output``         dataset, summary, figure and table of a plan
``plan_samples``        samples of planned paths, their greatest and least values, and closest approaches
``batches``             default batch size, and the callback for progress
======================  ===============================================================================================
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
