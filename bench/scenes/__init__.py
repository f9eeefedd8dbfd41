"""Simulated scenes: parametric hands and other targets, the stand, photographs and echoes."""
