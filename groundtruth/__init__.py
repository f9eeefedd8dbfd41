"""Ground truth: reconstruct a metric mesh from photographs, and compute its depth on the radar's
pixel grid."""
