"""Aircraft models: airframes, actuators, engines, and the six-degree-of-freedom equations of motion.

========================  ==============================================================================================
``airframe``              interface of an airframe, state, controls and mass properties
``air_data``              air data, force and moment (`Wrench`), gusts and thrust loss, valid ranges
``motion``                air data and forces of a state, equations of motion over a flat and a round Earth
``actuators``             actuators of the surfaces: first and second order, without lag
``engines``               interface of an engine; first-order lag, jet, no engine
``propellers``            electric motor or piston engine with a propeller
``f16``                   F-16 of Stevens & Lewis, its engine, and the base class of all F-16 models
``tp1538``                F-16 with the complete tables of NASA TP-1538 and the scheduled leading-edge flap
``global_model``          F-16 with the polynomials of Grauer and Morelli
``derivative_aircraft``   any aircraft from stability and control derivatives
``dave_ml_aircraft``      any aircraft from DAVE-ML files
``simple_body``           unpowered bodies of the NESC check-cases
``dispersions``           copies of an aircraft with deviating data
``changes``               changes of an aircraft during a flight: faults, ice, shifted load
``corrected_airframe``    onboard model of the adaptive autopilot: an airframe with coefficients corrected in flight
``table_checks``          search for suspect entries of coefficient tables
========================  ==============================================================================================
"""

import sys

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

sys.modules[__name__].__class__ = sys.modules["anser"].AircraftRoom
