"""What was identified: the calibration, its uncertainty, its file and its words."""
