"""The calibration of p_gross."""
