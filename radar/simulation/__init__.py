"""Simulation of echoes: scenes → samples, with the physical effects that a scene has."""
