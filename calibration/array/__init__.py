"""Calibration of an array: the gain, phase, delay and position of each antenna, from the echoes of
the calibration target."""
