"""Sensors and estimators: implementations of the interfaces of `anser.parts.perception`.

======================  ==============================================================================================
``ideal_sensors``       sets of sensors without error: `IdealSensors`, and `DelayedSensors` with a constant delay
``noisy_sensors``       set of sensors with errors: `NoisySensors`, made of vehicle sensors and a goal sensor
``vehicle_sensors``     satellite navigation, inertial sensors and air data; dropouts and correlated errors
``goal_sensors``        sensor of a goal, with latency, field of view and dropouts
``estimators``          estimator of one aircraft, with the optional filters below
``navigation``          filters of the aircraft's motion, of wind and of gusts
``goal_filters``        Kalman filters of a goal's motion, and their transfer to another aircraft
``motion_models``       motion models of a goal: steady motion, coordinated turn
``kalman``              extended and unscented Kalman updates
``adaptation``          estimator that corrects the aerodynamic coefficients of the onboard model in flight
``fault_detection``     detection of a fault from the differences between aircraft and onboard model
``fourier_regression``  regression in the frequency domain, in real time
======================  ==============================================================================================

`anser.scenario.build_sensing` builds sensors and estimators from a scenario.

The complete set of an aircraft's sensors implements `AbstractSensors`; a single sensor is a part of a set, such as
`NoisySensors`. A new sensor needs:

- methods `init` and `read` and a state, as in `VehicleSensors`
- a field of `Reading`, and a field of `Belief` if guidance or controller use a new quantity (`anser.parts.perception`)
- a part number for its random numbers (`anser.numerics.randomness`)
- an estimator that uses the field of `Reading`
- scenario keys (`anser.scenario.schema_sensing`, `build_sensing`, `unused_keys`)
- recorded variables (`anser.simulation.recorders`, `anser.variables`)

The state of a new goal filter must be handled in `hand_over_goal` (goal_filters).
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
