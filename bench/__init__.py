"""The bench: scenes, data sets, methods, metrics, and the runner of benchmarks."""
