"""The scene of a simulation: bodies with their materials in front of an array, and the causes of
effects; and the row of an effect in the table of a simulation."""

import zlib
from collections.abc import Callable, Hashable
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from pydantic import Field

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, AntennaArray
from handbench.radar.simulation.causes import Motion, Noise, Roughness, SensorFaults
from handbench.support.config import Config

CENTRE_M = np.zeros(3)  # of the aperture, in the radar frame


class Material(Config):
    """The material of a body.

    kind: metal, a perfect mirror; skin, layered, with palm_thickness_m of horny layer on the palm,
    and moist if `wet`; plastic, a dielectric with `permittivity` and `loss_tangent`.
    """

    kind: Literal["metal", "skin", "plastic"] = "metal"
    permittivity: float = Field(default=2.7, ge=1, le=20)  # printed PLA, solid
    loss_tangent: float = Field(default=0.0, ge=0, le=10)
    palm_thickness_m: float = Field(default=140e-6, ge=0, le=2e-3)
    wet: bool = False


METAL = Material()


@dataclass(frozen=True, eq=False)
class Body:
    """A body as a closed triangle mesh in the radar frame.

    vertices_m [n, 3], faces [m, 3]: the mesh, with faces counter-clockwise as seen from outside.
    palm: mask [m] of the faces with the palm's thick horny layer (None: no face). reflectivity_db:
    echo amplitude of a body of the room relative to metal in dB.
    """

    vertices_m: np.ndarray
    faces: np.ndarray
    material: Material = field(default_factory=Material)
    palm: np.ndarray | None = None
    reflectivity_db: float = 0.0


@dataclass(frozen=True)
class Ball:
    """A steel ball; if foam_radius_m is not 0, it is at the centre of a sphere of foam with this
    radius."""

    centre_m: np.ndarray
    radius_m: float
    foam_radius_m: float = 0.0
    foam_permittivity: float = 1.0

    @property
    def foam_delay_m(self) -> float:
        """The extra one-way path of the ball's echo through its foam, metres: (n − 1)·(R_foam −
        r_ball), where n is the foam's refractive index.

        The foam is centred on the ball, so that a ray to the ball's specular point runs along a
        radius and is not refracted.
        """
        foam_m = max(self.foam_radius_m - self.radius_m, 0.0)
        return (float(np.sqrt(self.foam_permittivity)) - 1) * foam_m


@dataclass(frozen=True, eq=False)
class EchoScene:
    """A scene as the radar measures it. frequencies_hz [f]: the radar's tones, in any order, some
    perhaps repeatedly; time_s [f]: when each tone is measured, from the start of a frame.
    frame_period_s: time from one frame's start to the next (None: the target starts at the same
    place in every frame).

    target: the measured body (None for a scene with balls only); room: the bodies around it, which
    stay when the target is removed; sensor, noise, motion, roughness: the causes of effects; seed:
    seed of all random draws. origin_m [3]: the target's origin, to which motion.pivot_m is
    relative; bent: the target's vertices [n, 3] as a function of time in seconds, with the motion
    of a hand's fingers alone (None: the target moves as a whole or not at all).
    polarisation_deg: direction of the antennas' electric field, from x towards y (used for echoes
    over two or more places).

    Accuracy: `coarser` multiplies the longest edge of the facets into which surfaces are divided.
    """

    array: AntennaArray
    frequencies_hz: np.ndarray
    time_s: np.ndarray
    target: Body | None = None
    balls: tuple[Ball, ...] = ()
    room: tuple[Body, ...] = ()
    sensor: SensorFaults = field(default_factory=SensorFaults)
    noise: Noise = field(default_factory=Noise)
    motion: Motion = field(default_factory=Motion)
    roughness: Roughness = field(default_factory=Roughness)
    seed: int = 0
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
    def points_m(self) -> np.ndarray:
        """The vertices of the target and the centres of the balls [n, 3], metres."""
        surface = [] if self.target is None else [self.target.vertices_m]
        return np.concatenate([*surface, *(ball.centre_m[None] for ball in self.balls)])

    def seeds(self, effect: str, *keys: int) -> tuple[int, ...]:
        """Return the seed of an effect's random numbers. It depends only on the scene's seed, the
        effect's name and further `keys`, so that the numbers do not change when other effects are
        switched on or off."""
        return (self.seed, zlib.crc32(effect.encode()), *keys)

    def cached(self, key: Hashable, make: Any) -> Any:
        """Return the value stored in this scene under `key`. The first time, it is computed by
        make() and stored, so that all effects of the scene share it."""
        if key not in self._cache:
            self._cache[key] = make()
        return self._cache[key]


def generator(seed: tuple[int, ...]) -> np.random.Generator:
    """Return the random number generator for a seed from `EchoScene.seeds`."""
    return np.random.default_rng(np.random.SeedSequence(seed))


class Choice(Config):
    """The row of one effect in the table of a simulation: whether it is on, and why.

    depth_mm, level_db: what leaving the effect out changes (`--explain`; None: not measured).
    seconds: the time it took (None: the effect is off, or nothing was simulated).
    """

    effect: str
    on: bool
    why: str
    depth_mm: float | None = None
    level_db: float | None = None
    seconds: float | None = None
