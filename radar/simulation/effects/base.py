"""What an effect is: it says what it needs, how much it matters in a scene and what it costs; and it can be applied."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from radar.simulation.scene import EchoScene

if TYPE_CHECKING:
    from radar.simulation.state import Shot


@dataclass(frozen=True)
class Estimate:
    """How much an effect matters: depth_mm, the mean change of the target's depth map at the scene's depth step;
    level_db, what it adds to or takes from the echoes against the target's echo; why: the bound, with its numbers;
    cost_s: the seconds that it would take."""

    depth_mm: float
    level_db: float
    why: str
    cost_s: float = 0.0


NOTHING = -np.inf  # decibels


class Effect(ABC):
    """One effect. id: its name in scene files; does: one line for people; source: where bound and model come from."""

    id: ClassVar[str]
    does: ClassVar[str]
    source: ClassVar[str]

    def missing(self, scene: EchoScene) -> str:
        """What the effect needs and the scene lacks, as a phrase ("[noise] in the scene file"); "" if it has all."""
        return ""

    @abstractmethod
    def estimate(self, scene: EchoScene) -> Estimate:
        """A cheap bound: it casts no ray and draws no random number. Only asked where nothing is missing."""

    @abstractmethod
    def apply(self, shot: Shot) -> None:
        """Change the shot."""
