"""The estimators, one file each, and `calibrate`, which chooses among them."""
