"""The echoes of a scene while they are simulated: what effects shape before the samples are summed,
and the sums."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from handbench.radar.data.arrays import AntennaArray
from handbench.radar.imaging.cpu.adjoint import Sight
from handbench.radar.imaging.tree import Box
from handbench.radar.simulation.forward import Scatterers, simulate
from handbench.radar.simulation.physics.facets import Facets, face_vectors, facets_of
from handbench.radar.simulation.physics.reflection import echo_reflections
from handbench.radar.simulation.physics.spheres import ball_echoes
from handbench.radar.simulation.scene import METAL, Body, EchoScene, Material
from handbench.support.errors import HandbenchError

SIGHT_TOLERANCE = 1e-3  # of diffracted echoes: a fifth of the error of interpolating their sight
Tones = slice | list[int]


@dataclass(frozen=True, eq=False)
class ScatteringSurface:
    """The facets of a body that scatter, and how they do.

    layer [p]: index of the material's layer at each facet (thin skin or palm); oblique: True for
    the obliquity of physical optics, False to scatter evenly in all directions; sight: complex
    factors of the antennas' fields behind diffracting edges (None: 1).
    """

    body: Body
    facets: Facets
    layer: np.ndarray
    material: Material = METAL
    oblique: bool = False
    sight: Sight | None = None

    def where(self, chosen: np.ndarray) -> "ScatteringSurface":
        """Return the surface with only the facets that a mask [p] or indices select."""
        return replace(
            self,
            facets=self.facets.where(chosen),
            layer=self.layer[chosen],
            sight=None if self.sight is None else self.sight.where(chosen),
        )


@dataclass(eq=False)
class Echoes:
    """The echoes of a scene's target and balls while effects shape them.

    frames: number of frames; empty: whether one more frame follows, of the room without the target.
    tolerance: relative error of the fast summation (None: exact sum).

    Effects change the following. array: the true positions of the antennas; pattern: exponent q of
    their amplitude pattern cosᵠθ; surface: the target's facets (None for balls only), which scatter
    evenly and without shadows before any effect; ball_delay_m [n]: extra one-way path of each
    ball's echo; bounced [f, t, r]: echoes over several places of the target; moving: whether each
    tone sees the target at its own time. `shaping` has the functions that did so, in their order.
    """

    scene: EchoScene
    frames: int
    tolerance: float | None
    empty: bool
    array: AntennaArray
    surface: ScatteringSurface | None
    ball_delay_m: np.ndarray
    pattern: float = 0.0
    bounced: np.ndarray | None = None
    moving: bool = False
    shaping: tuple["Shape", ...] = ()

    def shape(self, effect: "Shape") -> None:
        """Let an effect shape the echoes."""
        effect(self)
        self.shaping += (effect,)

    def of(self, scene: EchoScene) -> "Echoes":
        """Return the echoes of another scene, shaped by the same effects."""
        echoes = bare_echoes(scene, tolerance=self.tolerance)
        for effect in self.shaping:
            echoes.shape(effect)
        return echoes

    def frame_seeds(self, effect: str) -> list[tuple[int, ...]]:
        """Return the seed of an effect's random numbers in each frame."""
        keys = [(0, frame) for frame in range(self.frames)] + [(1, 0)] * self.empty
        return [self.scene.seeds(effect, *key) for key in keys]

    @property
    def points_m(self) -> np.ndarray:
        """Positions [n, 3] of the target's facets and of its balls' centres, metres."""
        facets = [] if self.surface is None else [require_facets(self.surface.facets).position_m]
        return np.concatenate([*facets, *(ball.centre_m[None] for ball in self.scene.balls)])

    def sums(self, tones: Tones = slice(None)) -> np.ndarray:
        """Sum the echoes of the target's surface and of the balls, without bounces: complex64
        [f, t, r]. tones: indices of the tones f."""
        frequencies_hz = self.scene.frequencies_hz[tones]
        samples = np.zeros((len(frequencies_hz), *self.array.channels), np.complex64)
        if self.surface is not None:
            samples += self._surface_echo(self.surface, tones)
        return samples + ball_echoes(
            self.scene, frequencies_hz, self.array, self.ball_delay_m, self.pattern
        )

    def samples(self) -> np.ndarray:
        """Sum all echoes of the target and its balls at rest: complex64 [f, t, r]."""
        return self.sums() if self.bounced is None else self.sums() + self.bounced

    def _surface_echo(self, surface: ScatteringSurface, tones: Tones) -> np.ndarray:
        """Sum the echoes of a surface: complex64 [f, t, r]. They are the sum over the surface's
        layers of the echoes of each layer's facets times the layer's reflection."""
        frequencies_hz = self.scene.frequencies_hz[tones]
        facets = require_facets(surface.facets)
        normal = facets.normal if surface.oblique else None
        every = Scatterers(facets.position_m, facets.area_m2, normal, sight=surface.sight)
        samples = np.zeros((len(frequencies_hz), *self.array.channels), np.complex64)
        for n, reflection in enumerate(echo_reflections(surface.material, frequencies_hz)):
            echoes = simulate(
                every.where(surface.layer == n),
                frequencies_hz,
                self.array,
                tolerance=self.tolerance,
                pattern=self.pattern,
                sight_tolerance=SIGHT_TOLERANCE,
            )
            samples += echoes * reflection[:, None, None]
        return samples


Shape = Callable[[Echoes], None]


def bare_echoes(
    scene: EchoScene, frames: int = 1, tolerance: float | None = 1e-5, empty: bool = False
) -> Echoes:
    """Return the echoes of a scene before any effect."""
    surface, delay_m = None, np.zeros(len(scene.balls))
    if scene.target is not None:
        facets = front_facets(scene, scene.target)
        surface = ScatteringSurface(scene.target, facets, np.zeros(len(facets), int))
    return Echoes(scene, frames, tolerance, empty, scene.array, surface, delay_m)


def require_facets(facets: Facets) -> Facets:
    """Return the facets. Raises HandbenchError if there are none."""
    if len(facets) == 0:
        raise HandbenchError(
            "target: no facet of its mesh faces the array; check its position, and that its "
            "normals point outwards"
        )
    return facets


def front_facets(scene: EchoScene, body: Body, longest: float = 0.25) -> Facets:
    """Return those facets of the body that face at least one corner of the box around the antennas,
    with edges of at most `longest` wavelengths. They are computed once per scene."""
    return scene.cached(("facing", id(body), longest), lambda: _front_facets(scene, body, longest))


def _front_facets(scene: EchoScene, body: Body, longest: float) -> Facets:
    vectors = face_vectors(body.vertices_m, body.faces)
    centres = body.vertices_m[body.faces].mean(axis=1)
    antennas = np.concatenate([scene.array.tx_m, scene.array.rx_m])
    corners = Box(antennas.min(axis=0), antennas.max(axis=0)).corners_m
    front = (vectors @ corners.T > (vectors * centres).sum(axis=1)[:, None]).any(axis=1)
    return facets_of(body, longest * scene.wavelength_m, np.flatnonzero(front))
