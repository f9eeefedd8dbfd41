"""Radar: arrays, captures, backprojection, FSK depth maps and the forward model."""
