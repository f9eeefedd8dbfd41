"""The bench: scenes, data sets, methods, metrics, the runner and the command line."""
