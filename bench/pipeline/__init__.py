"""The steps of the main job, one file each, so that an edit of one recomputes only its own results.
The command line, the Python interface, the runner and the trade-off call them."""
