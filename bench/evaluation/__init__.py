"""Figures of depth maps against references: error maps, metrics, intervals, tests, scoring
protocols, tables."""
