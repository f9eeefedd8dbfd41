"""The effects of simulated echoes by name, as known_effects.toml declares them, and the row that
says which of them a capture shows: what is read without their code."""

import tomllib
from pathlib import Path

from handbench.support.config import Config, suggest
from handbench.support.errors import HandbenchError

DECLARED: dict[str, dict[str, str]] = tomllib.loads(
    Path(__file__).with_suffix(".toml").read_text("utf-8")
)
IDS = tuple(DECLARED)  # in the order in which they are applied


class Choice(Config):
    """One effect's row: whether it is on and why; its estimate (None: not asked for, or the scene
    has no cause): depth_mm, of 3-FSK's map, worst_mm, of that of the method that it changes most,
    pixels_percent, lost and gained, and level_db; cost_s, what it was expected to take; seconds,
    what it took (None: off or not simulated)."""

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
    """Refuse names that no effect has, and repeated ones."""
    for name in names:
        if name not in IDS:
            raise HandbenchError(f"effects: '{name}' is not an effect; {suggest(name, list(IDS))}")
        if names.count(name) > 1:
            raise HandbenchError(f"effects: '{name}' is listed twice; list it once")
