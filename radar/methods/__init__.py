"""Methods that compute depth maps from echoes: their algorithms, settings and table."""
