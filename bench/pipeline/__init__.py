"""The steps that all commands share: from echoes to a depth map (`image`), and from a depth map to
scores (`score`).

Each step is a file of its own, so that an edit of one recomputes only its own results. The command
line, the Python interface, and the runner of benchmarks call them.
"""
