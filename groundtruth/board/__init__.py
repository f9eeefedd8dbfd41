"""Printed boards of markers, which give photographs their metric scale and world frame."""
