"""A calibration as the parameters of other programs and controllers: a file a family."""
