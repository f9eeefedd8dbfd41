"""Ground truth: photographs to a metric mesh, and the mesh's depth on the radar's grid."""
