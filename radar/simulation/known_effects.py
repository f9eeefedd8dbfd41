"""The names of the effects of simulated echoes, from known_effects.toml, and the table row that
records whether a capture has one. This module does not import their code."""

import tomllib
from pathlib import Path

from handbench.support.config import Config, suggest
from handbench.support.errors import HandbenchError

DECLARED: dict[str, dict[str, str]] = tomllib.loads(
    Path(__file__).with_suffix(".toml").read_text("utf-8")
)
IDS = tuple(DECLARED)  # in the order in which they are applied


class Choice(Config):
    """One effect's row in a capture's table: whether it is on, and why. depth_mm: its estimated
    change of 3-FSK's depths; worst_mm: of the depths of the method that it changes most;
    pixels_percent: pixels lost and gained; level_db: power of its change to the echoes, relative to
    them (None: not asked for, or no cause in the scene). cost_s: estimated CPU seconds; seconds:
    measured ones (None: off, or not simulated)."""

    effect: str
    on: bool
    why: str
    depth_mm: float | None = None
    worst_mm: float | None = None
    pixels_percent: float | None = None
    level_db: float | None = None
    cost_s: float | None = None
    seconds: float | None = None


def check_names(names: tuple[str, ...]) -> None:
    """Raise HandbenchError for unknown names of effects and for repeated ones."""
    for name in names:
        if name not in IDS:
            raise HandbenchError(f"effects: '{name}' is not an effect; {suggest(name, list(IDS))}")
        if names.count(name) > 1:
            raise HandbenchError(f"effects: '{name}' is listed twice; list it once")
