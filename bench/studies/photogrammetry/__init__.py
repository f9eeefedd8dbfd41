"""What photogrammetry's accuracy costs in time, and whether its error bars are honest, on rendered hands."""
