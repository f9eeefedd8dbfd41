"""What effects are asked about: bodies with their materials before an array, and the causes that a scene names."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from radar.arrays import SPEED_OF_LIGHT_M_S, AntennaArray
from radar.effects.causes import Causes
from radar.effects.material import Material

DEPTH_STEP_HZ = 2.5e9  # f1 − f3 of the paper's 3-FSK: the step that its depths come from


@dataclass(frozen=True, eq=False)
class Body:
    """Closed triangle mesh in the radar frame, counter-clockwise seen from outside: vertices_m [n, 3], faces [m, 3].
    palm [m]: which faces carry the palm's thick horny layer (None: none does)."""

    vertices_m: np.ndarray
    faces: np.ndarray
    material: Material = field(default_factory=Material)
    palm: np.ndarray | None = None

    @property
    def transparent(self) -> bool:
        """Whether waves pass through: it hides nothing and casts no shadow."""
        return self.material.kind == "foam"


@dataclass(frozen=True)
class Ball:
    """A steel ball, perhaps at the centre of a sphere of foam (foam_radius_m 0: none)."""

    centre_m: np.ndarray
    radius_m: float
    foam_radius_m: float = 0.0
    foam_permittivity: float = 1.0


@dataclass(frozen=True, eq=False)
class EchoScene:
    """A scene as the radar meets it. frequencies_hz [f] ascending, time_s [f]: when each tone of a frame is measured.

    target: what is measured (it may be None where there are balls alone); room: what stands around it and stays when
    it is taken away; depth_step_hz: the step between tones by which an effect's phase is told in millimetres.
    """

    array: AntennaArray
    frequencies_hz: np.ndarray
    time_s: np.ndarray
    target: Body | None = None
    balls: tuple[Ball, ...] = ()
    room: tuple[Body, ...] = ()
    causes: Causes = field(default_factory=Causes)
    seed: int = 0
    depth_step_hz: float = DEPTH_STEP_HZ
    _kept: dict[Hashable, Any] = field(default_factory=dict, repr=False)

    @property
    def wavelength_m(self) -> float:
        """The shortest wavelength."""
        return SPEED_OF_LIGHT_M_S / float(self.frequencies_hz.max())

    @property
    def pair(self) -> tuple[int, int]:
        """The tones between which depths are told, by index: the highest, and the one nearest to a depth step below."""
        top = int(self.frequencies_hz.argmax())
        below_hz = self.frequencies_hz[top] - self.depth_step_hz
        return top, int(np.abs(self.frequencies_hz - below_hz).argmin())

    @property
    def depth_m_per_rad(self) -> float:
        """Depth per phase between the tones of the pair: c / (4πΔf); at the depth step where there is one tone only."""
        high_hz, low_hz = self.frequencies_hz[list(self.pair)]
        return SPEED_OF_LIGHT_M_S / (4 * np.pi * (high_hz - low_hz or self.depth_step_hz))

    @property
    def lacks_surface(self) -> str:
        """What effects of opaque surfaces miss here, as a phrase; "" if nothing."""
        return "" if self.target is not None and not self.target.transparent else "a target with an opaque surface"

    def kept(self, key: Hashable, make: Any) -> Any:
        """make(), computed once per scene: estimates share what they look at."""
        if key not in self._kept:
            self._kept[key] = make()
        return self._kept[key]
