"""Photographs: files, EXIF, masks, and checks before the work."""
