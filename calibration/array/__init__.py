"""Calibration of an array: the gain, phase and delay of each antenna, from the echoes of the
calibration target."""
