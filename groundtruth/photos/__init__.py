"""Photographs: files, EXIF data, masks of the target, and checks before a reconstruction starts."""
