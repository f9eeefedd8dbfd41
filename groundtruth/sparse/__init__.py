"""Poses and points: structure from motion, bundle adjustment, covariance."""
