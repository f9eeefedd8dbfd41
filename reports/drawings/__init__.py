"""Drawings to print at true scale."""
