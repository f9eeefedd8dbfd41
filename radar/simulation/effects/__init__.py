"""The effects of simulated echoes: how each changes the echoes, its cost, and a quick estimate of
its size."""
