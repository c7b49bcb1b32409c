"""Environments for reinforcement learning: flight tasks with observation, action, reward and automatic reset.

===========================  ==========================================================================================
``registry``                 ``make``: an environment from a task, an aircraft, air, sensors and cases
``environment``              environment of one aircraft, and the functions that a fleet's environment shares with it
``fleet``                    environment of several cooperating aircraft, also with dictionaries by agent
``tasks``                    interface of tasks; commanded velocity, altitude, attitude, and recovery from upsets
``planned_tasks``            tasks with a plan: path tracking and arrival
``actions``                  levels of action: surfaces and throttle, body rates, velocity commands
``spaces``                   spaces of observations and actions; names, units and scales of the entries
``cases``                    start, air and task of each episode, made before the first step
``episodes``                 flights under a policy: scores and records; the scripted expert
``gymnasium_environments``   environments for Gymnasium
``pettingzoo_environments``  environments of fleets for PettingZoo
``minari_datasets``          episodes as datasets of Minari
===========================  ==========================================================================================
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
