"""Benchmark files: their format, and those that are installed with handbench."""
