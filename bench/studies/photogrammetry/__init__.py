"""The price in time of photogrammetry's accuracy, and the honesty of its error bars, on rendered hands."""
