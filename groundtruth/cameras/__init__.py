"""Cameras, and the readers of camera files from handbench, COLMAP and Metashape."""
