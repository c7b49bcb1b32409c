"""Identification of an aircraft from recorded flights: parameters with confidence intervals, and planned manoeuvres.

========================  ============================================================================================
``identify``              `anser.identify`: from a recording to parameters, fit, validation and files
``records``               flight records: time series in SI units, from a flight of the package or from a recording
``alignment``             removal of delays between channels, detection of wrong units
``kinematics``            specific force, and rates of airspeed, flow angles and attitude from inertial data
``compatibility``         biases and scale factors of sensors, estimated from flight kinematics
``coefficients``          aerodynamic coefficients at the samples of a record
``models``                model structures: short period, lateral motion, aerodynamic coefficients
``estimation``            estimation of the parameters of a model structure by a chosen method
``regression``            least squares in time: ordinary, total, stepwise, with prior values
``frequency_regression``  least squares on Fourier transforms
``dynamic_models``        models x' = f(x, u, theta), recorded manoeuvres, predicted outputs and sensitivities
``aircraft_models``       dynamic models of an aircraft: short period, linear motion, nonlinear motion
``output_error``          maximum likelihood without process noise
``filter_error``          maximum likelihood with process noise, by a Kalman filter
``likelihood``            maximization of the likelihood
``estimates``             estimated parameters with covariance and intervals
``fits``                  fit of a model to measured responses
``smoothing``             smoothed time histories, derivatives and noise levels
``input_design``          predicted standard errors of a planned manoeuvre
``aircraft_file``         aircraft file with estimated derivatives
========================  ============================================================================================
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
