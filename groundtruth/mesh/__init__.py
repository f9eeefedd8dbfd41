"""The surface: files, reconstruction, uncertainty, depth on the grid of the radar."""
