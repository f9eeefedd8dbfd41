"""The steps of the main job, a file each, so that an edit of one makes only its own results again.
The command line, the Python interface, the runner and the trade-off call these."""
