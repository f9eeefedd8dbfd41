"""The data of a radar: arrays, captures, grids, depth maps."""
