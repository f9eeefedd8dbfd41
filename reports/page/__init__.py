"""The HTML report of results."""
