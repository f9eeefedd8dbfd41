"""Imaging on a GPU, as array code."""
