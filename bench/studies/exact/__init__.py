"""Simulated echoes against exact solutions of Maxwell's equations."""
