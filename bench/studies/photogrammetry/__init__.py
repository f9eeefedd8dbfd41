"""Ground truths of rendered hands."""
