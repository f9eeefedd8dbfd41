"""The interface of an effect: its needs, the estimate of its size and cost in a scene, and its application."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from radar.simulation.pilot import change_db, change_mm
from radar.simulation.scene import EchoScene
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

    @classmethod
    def of(cls, scene: EchoScene, samples: np.ndarray, why: str, cost_s: float = 0.0) -> Estimate:
        """The estimate of an effect that makes these of the pilot's samples [2, t, r]."""
        return cls(change_mm(scene, samples), change_db(scene, samples), why, cost_s)


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
