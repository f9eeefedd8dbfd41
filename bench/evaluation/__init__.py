"""Depth maps against references: error maps, metrics, scoring protocols."""
