"""Array calibration: each antenna's gain, phase, delay and place, from the echoes of the
calibration target."""
