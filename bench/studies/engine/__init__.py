"""The engine's benchmark: time, error and memory of imaging and simulation."""
