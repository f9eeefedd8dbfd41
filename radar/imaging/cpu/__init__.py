"""Execution on the processor."""
