"""Self-calibration: what a capture does not know about its instrument, estimated from its own
echoes."""
