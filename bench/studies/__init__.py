"""Studies: scripts that measure the speed and accuracy of handbench itself."""
