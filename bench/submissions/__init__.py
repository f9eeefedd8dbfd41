"""Benchmark sets that others can enter: what is handed out, what is handed in, and how a foreign method is run."""
