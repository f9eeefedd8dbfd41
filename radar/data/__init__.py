"""The data of a radar: antenna arrays, captures (recorded echoes), pixel and voxel grids, depth
maps."""
