"""The equal treatments: every method gets the same smoothing. They are in a module of their own,
because an image depends on them and on no metric."""

WINDOW_PX = 5  # of the averaging filter that all are given
SMOOTHING = {"none": 1, "window": WINDOW_PX}  # treatment → width of every averaging filter, pixels
