"""Accuracy with which the target carries photographs into the radar's frame, in placements whose truth is known."""
