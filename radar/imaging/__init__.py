"""Images from echoes: plans of the geometry, executed on the processor or on a GPU."""
