"""The package in thirty lines: poses in, calibration with its errors, contact wrench out."""

from pathlib import Path

import numpy as np

import contactwrench as cw

PANDA = Path(cw.__file__).parent / "data" / "panda_mini45.csv"

samples = cw.read(PANDA)
calibration = cw.calibrate(samples, model="mount")
print(calibration)

low, high = calibration.interval("weight", 0.95)
print(f"weight between {low:.2f} and {high:.2f} N (95 %)")

contact = calibration.compensate(samples.wrench, samples.R_base_flange)
print("left in free air, N:", np.round(np.linalg.norm(contact[:, :3], axis=1), 2))

step = calibration.stepper()
print("one sample:", step(-0.050, -0.047, -0.044, -0.002, 0.001, 0.001, -0.377834, 0.925873, 0.000804, 0.000177))
