"""Drawings of boards and calibration targets, to print at true scale."""
