"""Data sets: each module reads captures of one format, and most can write them as capture
folders."""
