"""Study of p_gross, the predicted probability that a depth is grossly wrong, and its
calibration."""
