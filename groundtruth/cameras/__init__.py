"""Cameras, and the files that others write of them."""
