"""Calibration: transforms between named frames, the target in both sensors, registration, the
array's own errors."""
