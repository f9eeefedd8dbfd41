"""The scene of a simulation: bodies with their materials in front of an array, and the causes of
effects."""

from collections.abc import Callable, Hashable
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from pydantic import Field

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, AntennaArray
from handbench.radar.simulation.causes import Causes
from handbench.support.config import Config

DEPTH_STEP_HZ = 2.5e9  # f1 − f3 of the paper's 3-FSK: the step that its depths come from
# coarse step between tones relative to depth_step_hz, as 200 MHz to 2.5 GHz
COARSE = 0.08
CENTRE_M = np.zeros(3)  # of the aperture, in the radar frame


class Material(Config):
    """The material of a body.

    kind: metal, a perfect mirror; skin, layered, with palm_thickness_m of horny layer on the palm,
    and moist if `wet`; plastic, a dielectric with `permittivity` and `loss_tangent`. A body of the
    room may have a measured reflectivity instead (`Body`).
    """

    kind: Literal["metal", "skin", "plastic"] = "metal"
    permittivity: float = Field(default=2.7, ge=1, le=20)  # printed PLA, solid
    loss_tangent: float = Field(default=0.0, ge=0, le=10)
    palm_thickness_m: float = Field(default=140e-6, ge=0, le=2e-3)
    wet: bool = False


@dataclass(frozen=True, eq=False)
class Body:
    """A body as a closed triangle mesh in the radar frame.

    vertices_m [n, 3], faces [m, 3]: the mesh, with faces counter-clockwise as seen from outside.
    palm: mask [m] of the faces with the palm's thick horny layer (None: no face). reflectivity_db:
    echo amplitude relative to metal in dB; if given, it replaces the material.
    """

    vertices_m: np.ndarray
    faces: np.ndarray
    material: Material = field(default_factory=Material)
    palm: np.ndarray | None = None
    reflectivity_db: float | None = None


@dataclass(frozen=True)
class Ball:
    """A steel ball; if foam_radius_m is not 0, it is at the centre of a sphere of foam with this
    radius."""

    centre_m: np.ndarray
    radius_m: float
    foam_radius_m: float = 0.0
    foam_permittivity: float = 1.0


@dataclass(frozen=True, eq=False)
class EchoScene:
    """A scene as the radar measures it. frequencies_hz [f]: the radar's tones, in any order, some
    perhaps repeatedly; time_s [f]: when each tone is measured, from the start of a frame.
    frame_period_s: time from one frame's start to the next (None: the target starts at the same
    place in every frame).

    target: the measured body (None for a scene with balls only); room: the bodies around it, which
    stay when the target is removed; causes: causes of the effects, such as noise or motion; seed:
    seed of all random draws. origin_m [3]: the target's origin, to which causes.motion.pivot_m is
    relative; bent: the target's vertices [n, 3] as a function of time in seconds, with the motion
    of a hand's fingers alone (None: the target moves as a whole or not at all). depth_step_hz:
    difference of the two tones for which an ablation determines depths.
    polarisation_deg: direction of the antennas' electric field, from x towards y (used for balls
    and for echoes over two or more places).

    Accuracy: `coarser` multiplies the longest edge of the facets into which surfaces are divided.
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
    polarisation_deg: float = 90.0
    coarser: float = 1.0
    frame_period_s: float | None = None
    origin_m: np.ndarray = field(default_factory=lambda: np.zeros(3))
    bent: Callable[[float], np.ndarray] | None = None
    _cache: dict[Hashable, Any] = field(default_factory=dict, init=False, repr=False)

    @property
    def body(self) -> Body:
        """The target body. Raises ValueError for a scene without one."""
        if self.target is None:
            raise ValueError(
                "target: the scene has only balls, but this effect needs a target; add a [target]"
            )
        return self.target

    @property
    def dipole(self) -> np.ndarray:
        """The direction [3] of the antennas' electric field, a unit vector."""
        angle = np.radians(self.polarisation_deg)
        return np.array([np.cos(angle), np.sin(angle), 0.0])

    @property
    def wavelength_m(self) -> float:
        """The length, metres, that sets how finely surfaces are divided: the shortest wavelength
        times `coarser`."""
        return self.coarser * SPEED_OF_LIGHT_M_S / float(self.frequencies_hz.max())

    @property
    def pair_hz(self) -> tuple[float, float]:
        """The two tones (high, low) in Hz whose phase difference determines depth: the highest
        tone, and the tone nearest to depth_step_hz below it. If there is only one tone, the second
        value is exactly depth_step_hz lower, although it is not measured."""
        high_hz = float(self.frequencies_hz.max())
        wanted_hz = high_hz - self.depth_step_hz
        below_hz = np.unique(self.frequencies_hz)[:-1][::-1]  # of two as near, the higher
        return high_hz, float(below_hz[np.abs(below_hz - wanted_hz).argmin()]) if len(
            below_hz
        ) else wanted_hz

    @property
    def coarse_hz(self) -> float | None:
        """The second tone of two-tone FSK in Hz, close to the highest tone: the measured tone that
        is nearest to COARSE · depth_step_hz (200 MHz for 2.5 GHz) below the highest. None if it
        differs from that by half of this distance or more."""
        usual_hz, below_hz = (
            COARSE * self.depth_step_hz,
            self.frequencies_hz.max() - self.frequencies_hz,
        )
        nearest = int(np.abs(below_hz - usual_hz).argmin())
        return (
            float(self.frequencies_hz[nearest])
            if abs(below_hz[nearest] - usual_hz) < usual_hz / 2
            else None
        )

    @property
    def middle_m(self) -> np.ndarray:
        """The mean [3] of the centres of the target and of its balls, metres."""
        middles = [ball.centre_m for ball in self.balls]
        middles += [] if self.target is None else [self.target.vertices_m.mean(axis=0)]
        return np.mean(middles, axis=0)

    def cached(self, key: Hashable, make: Any) -> Any:
        """Return the value stored in this scene under `key`. The first time, it is computed by
        make() and stored, so that all effects of the scene share it."""
        if key not in self._cache:
            self._cache[key] = make()
        return self._cache[key]
