"""Echoes of a scene with the effects that it calls for."""
