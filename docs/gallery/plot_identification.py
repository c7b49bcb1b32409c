"""
Derivatives from a flight
=========================

Derivatives of forces and moments of the F-16, identified from a record with noise, with 95 % intervals; the
crosses are the derivatives of the aircraft itself.
"""

import matplotlib.pyplot as plt
import numpy as np

import anser
from anser.identification import flight_record
from anser.identification.coefficients import airframe_derivatives
from anser.identification.kinematics import with_specific_force

f16 = anser.aircraft("f16")
trim = f16.trim(speed_m_s=150, altitude_m=1000)
controls = {
    name: anser.multisine(amplitude, (0.1, 1.5), 20.0, channel=k, channels=3)
    for k, (name, amplitude) in enumerate({"elevator": 0.8, "aileron": 1.5, "rudder": 1.5}.items())
}
flight = anser.simulate(f16, trim, controls, duration_s=22, record_period_s=0.02)
angles = ("alpha_deg", "beta_deg", "roll_deg", "pitch_deg", "yaw_deg")
rates = ("roll_rate_deg_s", "pitch_rate_deg_s", "yaw_rate_deg_s")
forces = ("specific_force_x_m_s2", "specific_force_y_m_s2", "specific_force_z_m_s2")
noise = {**dict.fromkeys((*angles, *rates), 0.05), **dict.fromkeys(forces, 0.03), "airspeed_m_s": 0.1}
record = with_specific_force(flight_record(flight)).with_noise(noise, seed=1)
estimate = anser.identify(record, "derivatives", aircraft=f16)
truth = airframe_derivatives(f16.airframe, record)

parameters = [row for row in estimate.rows() if row["name"] in truth and not row["name"].startswith("CD")]
parameters = [row for row in parameters if not row["name"].endswith("0")]
scale = np.array([abs(truth[row["name"]]) for row in parameters])
values = np.array([row["estimate"] for row in parameters]) / scale
errors = 1.96 * np.array([row["standard_error"] for row in parameters]) / scale
figure, axis = plt.subplots(figsize=(7, 6), layout="constrained")
places = np.arange(len(parameters))
axis.errorbar(values, places, xerr=errors, fmt="o", capsize=3, label="estimate, 95 % interval")
axis.plot([np.sign(truth[row["name"]]) for row in parameters], places, "kx", label="aircraft")
axis.set(yticks=places, yticklabels=[row["name"] for row in parameters], xlim=(-2.5, 2.5))
axis.set_xlabel("over the size of the aircraft's own")
axis.legend()
plt.show()
