"""The interface of an effect: its needs, its size at a glance and its cost in a scene, and its application."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from handbench.radar.simulation.pilot import coarse_surface
from handbench.radar.simulation.scene import EchoScene
from handbench.radar.simulation.state import EchoState

TURN = 0.15  # rad between two tones per relative amplitude, mean over the pixels: 0.10 to 0.22 measured on four hands

CLEAR = 10.0  # a glance may be wrong by this factor,
CLOSED = 3.0  # and one in closed form by this: 1.9 at most in 25 cases on 23 random scenes
FACET_S, TONE_S = 2e-6, 3e-8  # of a coarse facet's echo, and of each tone in it


def echo_s(scene: EchoScene) -> float:
    """Seconds that the target's echoes take without any effect, on one core."""
    count = 0 if scene.target is None else 4 * len(coarse_surface(scene, scene.body))
    return 0.05 + count * (FACET_S + TONE_S * len(scene.frequencies_hz))


@dataclass(frozen=True)
class Glance:
    """The size of an effect by geometry or a closed form, within milliseconds: worst_mm, the change of the depths of
    the method that it changes most; why; factor: by which that may be wrong."""

    worst_mm: float
    why: str
    factor: float = CLEAR

    @classmethod
    def of_level(cls, scene: EchoScene, ratio: float, why: str, factor: float = CLEAR) -> Glance:
        """Of echoes with that amplitude over the target's own."""
        turned_rad = min(TURN * ratio, np.pi / 2)
        return cls(1e3 * scene.depth_m_per_rad * scene.strictness * turned_rad, why, factor)


class Effect(ABC):
    """One effect. id: its name in scene files and in known_effects.toml."""

    id: ClassVar[str]

    def missing(self, scene: EchoScene) -> str:
        """The needs of the effect that the scene lacks, as a phrase ("[noise] in the scene file"); "" if it has all."""
        return ""

    def cost_s(self, scene: EchoScene) -> float:
        """Seconds that it will take, on one core, as "auto" sees them: what takes none is on."""
        return 0.0

    def glance(self, scene: EchoScene) -> Glance | None:
        """The size at a glance, without a ray or a random number; None: nothing is told so quickly."""
        return None

    @abstractmethod
    def apply(self, state: EchoState) -> None:
        """Change the state of the simulation."""
