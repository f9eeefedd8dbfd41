"""The echoes of a scene in the making, which effects change one after another, from the array to
recorded samples."""

import zlib
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from handbench.radar.data.arrays import AntennaArray
from handbench.radar.imaging.cpu.adjoint import Sight
from handbench.radar.imaging.tree import Box
from handbench.radar.simulation.forward import Scatterers, simulate
from handbench.radar.simulation.physics.facets import Facets, face_vectors, facets_of
from handbench.radar.simulation.physics.spheres import ball_echoes
from handbench.radar.simulation.scene import Body, EchoScene
from handbench.support.errors import HandbenchError

SIGHT_TOLERANCE = 1e-3  # of echoes that diffract: a fifth of what interpolating their sight leaves
TARGET = "echoes"  # the target's own echoes, among the effects that times are counted for


@dataclass(frozen=True, eq=False)
class ScatteringSurface:
    """A body's facets that scatter. oblique: by physical optics, else evenly; reflection: complex
    amplitude [f] per layer; layer [p] of each facet; seen: which antennas see it, (bool [t, p],
    bool [r, p]), None: all; sight: how much of it each sees, None: all of it; delay_m [p]: extra
    one-way path."""

    body: Body
    facets: Facets
    oblique: bool = False
    reflection: np.ndarray | None = None  # [layers, f]
    layer: np.ndarray | None = None
    seen: tuple[np.ndarray, np.ndarray] | None = None
    sight: Sight | None = None
    delay_m: np.ndarray | None = None

    def where(self, chosen: np.ndarray) -> "ScatteringSurface":
        """Only the facets that the mask [p] chooses."""
        return replace(
            self,
            facets=self.facets.where(chosen),
            layer=None if self.layer is None else self.layer[chosen],
            delay_m=None if self.delay_m is None else self.delay_m[chosen],
            seen=None if self.seen is None else (self.seen[0][:, chosen], self.seen[1][:, chosen]),
            sight=None if self.sight is None else self.sight.where(chosen),
        )


@dataclass(frozen=True, eq=False)
class Echoes:
    """The echoes of a scene in the making, of which each effect returns changed ones.

    Effects come in the order of the catalogue: first those that change the array or the antennas'
    pattern (the exponent of cos θ), then those that change the target's surface or add an extra
    echo of it, samples [f, t, r] by effect; the first that reads `samples` has them computed, and
    the rest record others.

    ball_delay_m [n]: extra one-way path of each ball's echo; levels: by effect, measured with the
    target and kept for the room without it (with_target False); timed: the context in which each
    effect's own part is computed.
    """

    scene: EchoScene
    array: AntennaArray
    surface: ScatteringSurface | None
    ball_delay_m: np.ndarray
    frames: int = 1
    tolerance: float | None = 1e-5
    with_target: bool = True
    pattern: float = 0.0
    extra: Mapping[str, Callable[[], np.ndarray]] = field(default_factory=dict)
    levels: Mapping[str, float] = field(default_factory=dict)
    recorded: np.ndarray | None = None
    timed: Callable[[str], AbstractContextManager[Any]] = nullcontext

    def seed(self, effect: str, *keys: int) -> tuple[int, ...]:
        """Seed of one effect alone, so that no other's draws depend on whether it is on."""
        return (self.scene.seed, zlib.crc32(effect.encode()), *keys)

    def frame_seeds(self, effect: str) -> list[tuple[int, ...]]:
        """The same for each frame; the empty room has its own."""
        return [
            self.seed(effect, 0 if self.with_target else 1, frame) for frame in range(self.frames)
        ]

    def level(self, name: str, measure: Callable[[], float]) -> float:
        """A level that is measured with the target; the room without it has the same."""
        return measure() if self.with_target else self.levels[name]

    def record(self, samples: np.ndarray, **levels: float) -> "Echoes":
        """The echoes with other samples [frame, f, t, r], and levels that were measured for
        them."""
        return replace(self, recorded=samples, levels={**self.levels, **levels})

    def add(self, effect: str, echo: Callable[[], np.ndarray]) -> "Echoes":
        """The echoes with an extra one of the target."""
        return replace(self, extra={**self.extra, effect: echo})

    @property
    def points_m(self) -> np.ndarray:
        """The target's facets and balls: [n, 3]."""
        facets = [] if self.surface is None else [require_facets(self.surface.facets).position_m]
        return np.concatenate([*facets, *(ball.centre_m[None] for ball in self.scene.balls)])

    def echo(self, array: AntennaArray) -> np.ndarray:
        """The target's samples complex64 [f, t, r] at antennas that are where `array` says, without
        extra echoes."""
        samples = np.zeros((len(self.scene.frequencies_hz), *array.channels), np.complex64)
        with self.timed(TARGET):
            if self.surface is not None:
                samples += self._surface_echo(self.surface, array)
            if self.with_target:
                samples += ball_echoes(
                    self.scene, self.scene.frequencies_hz, array, self.ball_delay_m, self.pattern
                )
        return samples

    def _surface_echo(self, surface: ScatteringSurface, array: AntennaArray) -> np.ndarray:
        """Samples complex64 [f, t, r] of a surface: each layer's echoes times its reflection."""
        facets, layer = require_facets(surface.facets), surface.layer
        normal = facets.normal if surface.oblique else None
        every = Scatterers(
            facets.position_m, facets.area_m2, normal, surface.delay_m, surface.seen, surface.sight
        )
        layers = (
            [every]
            if layer is None
            else [every.where(layer == n) for n in range(layer.max(initial=0) + 1)]
        )
        samples = np.zeros((len(self.scene.frequencies_hz), *array.channels), np.complex64)
        for n, part in enumerate(layers):
            echoes = simulate(
                part,
                self.scene.frequencies_hz,
                array,
                tolerance=self.tolerance,
                pattern=self.pattern,
                sight_tolerance=SIGHT_TOLERANCE,
            )
            samples += (
                echoes
                if surface.reflection is None
                else echoes * surface.reflection[n][:, None, None]
            )
        return samples

    def extra_echoes(self) -> np.ndarray | int:
        """The sum of the extra echoes, complex64 [f, t, r]; 0 where there are none."""
        total: np.ndarray | int = 0
        for effect, echo in self.extra.items():
            with self.timed(effect):
                total = total + echo()
        return total

    @cached_property
    def samples(self) -> np.ndarray:
        """Samples complex64 [frame, f, t, r]; the target's echoes, the same in every frame, until
        an effect differs."""
        if self.recorded is not None:
            return self.recorded
        return np.repeat((self.echo(self.array) + self.extra_echoes())[None], self.frames, axis=0)


def bare_echoes(
    scene: EchoScene,
    frames: int = 1,
    tolerance: float | None = 1e-5,
    levels: Mapping[str, float] | None = None,
) -> Echoes:
    """The echoes of a scene before any effect. levels: as those with the target have them; these
    are then of the room without it."""
    body = scene.target if levels is None else None
    surface = None if body is None else ScatteringSurface(body, front_facets(scene, body))
    still = np.zeros(len(scene.balls))
    return Echoes(
        scene, scene.array, surface, still, frames, tolerance, levels is None, levels=levels or {}
    )


def generator(seed: tuple[int, ...]) -> np.random.Generator:
    """Random numbers from such a seed as `Echoes.seed` gives."""
    return np.random.default_rng(np.random.SeedSequence(seed))


def require_facets(facets: Facets) -> Facets:
    """The facets, if there are any."""
    if len(facets) == 0:
        raise HandbenchError(
            "target: no facet faces the array; check the mesh's orientation (normals point "
            "outwards) and place"
        )
    return facets


def front_facets(scene: EchoScene, body: Body, longest: float = 0.25) -> Facets:
    """The body's facets, with edges of `longest` wavelengths at most, whose face turns its front to
    some antenna. Made once."""
    return scene.cached(("facing", id(body), longest), lambda: _front_facets(scene, body, longest))


def _front_facets(scene: EchoScene, body: Body, longest: float) -> Facets:
    vectors = face_vectors(body.vertices_m, body.faces)
    centres = body.vertices_m[body.faces].mean(axis=1)
    antennas = np.concatenate([scene.array.tx_m, scene.array.rx_m])
    corners = Box(antennas.min(axis=0), antennas.max(axis=0)).corners_m
    front = (vectors @ corners.T > (vectors * centres).sum(axis=1)[:, None]).any(axis=1)
    return facets_of(body, longest * scene.wavelength_m, np.flatnonzero(front))
