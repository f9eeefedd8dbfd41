"""Depth maps from images: the methods, their presets and their registry."""
