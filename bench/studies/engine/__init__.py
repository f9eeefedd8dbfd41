"""Benchmark of the imaging engine and of the simulation: time, error and memory."""
