"""What is asked of a calibration: is it still right, what does the tool hold, which poses come next."""
