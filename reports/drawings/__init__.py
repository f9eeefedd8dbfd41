"""Drawings at true scale, to print."""
