"""The effects of simulated echoes: how each changes the echoes."""
