"""Study of photogrammetry on rendered photographs of hands."""
