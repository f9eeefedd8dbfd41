"""The effects: what each needs, its estimate, its application."""
