"""Sensitivity: what would have to be true for the paper's table, over all that its set-up leaves open."""
