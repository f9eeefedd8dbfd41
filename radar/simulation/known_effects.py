"""The names of the effects of simulated echoes, from known_effects.toml, and the row of a capture's
table that records whether an effect is on.

This module does not import the code of the effects.
"""

import tomllib
from pathlib import Path

from handbench.support.config import Config, suggest
from handbench.support.errors import HandbenchError

DECLARED: dict[str, dict[str, str]] = tomllib.loads(
    Path(__file__).with_suffix(".toml").read_text("utf-8")
)
IDS = tuple(DECLARED)  # in the order in which they are applied


class Choice(Config):
    """The row of one effect in a capture's table: whether it is on, and why.

    Sizes in coarse simulations (`--explain`), None if they were not asked for or there is no cause:
    depth_mm: change of the depths by 3-FSK; worst_mm: of those by the method that it changes most;
    pixels_percent: lost and gained pixels; level_db: power of its change to the echoes, relative to
    the echoes.

    seconds: measured time (None: the effect is off, or nothing was simulated).
    """

    effect: str
    on: bool
    why: str
    depth_mm: float | None = None
    worst_mm: float | None = None
    pixels_percent: float | None = None
    level_db: float | None = None
    seconds: float | None = None


def check_names(names: tuple[str, ...]) -> None:
    """Raise HandbenchError for a name that is no effect, and for a name that is listed twice."""
    for name in names:
        if name not in IDS:
            raise HandbenchError(f"effects: '{name}' is not an effect; {suggest(name, list(IDS))}")
        if names.count(name) > 1:
            raise HandbenchError(f"effects: '{name}' is listed twice; list it once")
