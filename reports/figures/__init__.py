"""Figures of results, depth maps, meshes and recordings."""
