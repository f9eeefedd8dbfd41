"""Imaging on the processor's cores, by compiled code."""
