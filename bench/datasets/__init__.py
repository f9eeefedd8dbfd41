"""Data sets: one adapter each, all of which end in capture folders."""
