"""The HTML report of results and trade-offs."""
