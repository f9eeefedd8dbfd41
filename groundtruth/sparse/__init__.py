"""Sparse reconstruction: cameras and points by structure from motion and bundle adjustment, with
their covariance."""
