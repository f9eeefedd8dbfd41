"""One file an effect: what it needs, its estimate, its application."""
