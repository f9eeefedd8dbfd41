"""Embedded benchmarks and their scenes."""
