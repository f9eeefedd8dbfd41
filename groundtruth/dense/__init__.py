"""Dense reconstruction: a depth map for each photograph, and their fusion to a cloud of points."""
