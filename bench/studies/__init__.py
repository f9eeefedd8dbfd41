"""Studies: scripts that measure handbench itself."""
