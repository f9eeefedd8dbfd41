"""The stages of a benchmark: functions from paths and values to a folder, which is kept; and the
step from echoes to a depth map (`image`), which all commands share."""
