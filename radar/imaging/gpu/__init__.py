"""Execution on a GPU, as array code."""
