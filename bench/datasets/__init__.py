"""Adapters to data sets: each reads one form of captures and can write it as a capture folder."""
