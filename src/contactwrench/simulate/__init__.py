"""The virtual rig: a KUKA iiwa 7 R800 with a six-axis sensor at its flange, in MuJoCo's physics.

It is the judge of the estimators, so nothing here imports the measurement model, an estimator or a calibration: forces
come from MuJoCo alone. `settings` says what can be set, `arm` and `rig` build the machine, `sensor` what is measured on
it, `kinematics` and `trajectory` where it goes, `recording` puts a whole recording together.
"""
