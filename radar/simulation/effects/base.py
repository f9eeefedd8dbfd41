"""The interface of an effect: its needs, the estimate of its size and cost in a scene, and its application."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from radar.simulation.scene import EchoScene

if TYPE_CHECKING:
    from radar.simulation.state import EchoState


@dataclass(frozen=True)
class Estimate:
    """Size of an effect in a scene: depth_mm, the mean change of the target's depth map at the scene's depth step;
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
        """The needs of the effect that the scene lacks, as a phrase ("[noise] in the scene file"); "" if it has all."""
        return ""

    @abstractmethod
    def estimate(self, scene: EchoScene) -> Estimate:
        """A cheap bound: it casts no ray and draws no random number. Only asked where nothing is missing."""

    @abstractmethod
    def apply(self, state: EchoState) -> None:
        """Change the state of the simulation."""
