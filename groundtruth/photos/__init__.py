"""Photographs: files, tones, masks of the target, and checks before a reconstruction starts."""
