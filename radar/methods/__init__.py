"""Methods that compute depth maps from echoes: their algorithms, parameters, presets and
registry."""
