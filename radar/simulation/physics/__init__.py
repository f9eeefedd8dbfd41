"""Models of scattering and propagation that several effects share."""
