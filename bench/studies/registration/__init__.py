"""Registrations of photographs and radar whose truth is known."""
