"""The surface mesh: its files, reconstruction, uncertainty, and depth on the radar's pixel grid."""
