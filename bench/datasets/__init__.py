"""Data sets: each module reads captures of one format, or converts them to capture folders."""
