"""Checks of inputs, which find problems before hours of computation."""
