"""Scenes: the parametric hand, the stand, photographs and echoes."""
