"""Scenes of all kinds: the effects that "auto" chooses."""
