"""Checks of input files, which find problems before hours of computation."""
