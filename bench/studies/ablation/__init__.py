"""Ablation: what each effect does to each method on simulated hands, and what it costs in time."""
