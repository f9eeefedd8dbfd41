"""Boards of markers, which give scale and frame."""
