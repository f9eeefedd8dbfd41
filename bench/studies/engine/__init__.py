"""The engine's benchmark: what imaging and simulation cost, measured in one run."""
