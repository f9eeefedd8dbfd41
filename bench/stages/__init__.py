"""The stages of a benchmark: functions from paths and values to a folder, which is kept."""
