"""The state of a simulation that effects change one after another, from the array to the recorded samples."""

import zlib
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from handbench.radar.data.arrays import AntennaArray
from handbench.radar.imaging.cpu.ascent import Sight
from handbench.radar.imaging.tree import Box
from handbench.radar.simulation.forward import Scatterers, simulate
from handbench.radar.simulation.physics.facets import Facets, face_vectors, facets_of
from handbench.radar.simulation.physics.spheres import ball_echoes
from handbench.radar.simulation.scene import Body, EchoScene
from handbench.support.errors import HandbenchError

SIGHT_TOLERANCE = 1e-3  # of echoes that diffract: a fifth of what interpolating their sight leaves


@dataclass
class Surface:
    """A body's facets that scatter. oblique: by physical optics, else evenly; reflection: complex amplitude [f] per
    layer; layer [p] of each facet; seen: which antennas see it, (bool [t, p], bool [r, p]), None: all; sight: how much
    of it each sees, None: all of it; delay_m [p]: extra one-way path."""

    body: Body
    facets: Facets
    oblique: bool = False
    reflection: np.ndarray | None = None  # [layers, f]
    layer: np.ndarray | None = None
    seen: tuple[np.ndarray, np.ndarray] | None = None
    sight: Sight | None = None
    delay_m: np.ndarray | None = None

    def keep(self, chosen: np.ndarray) -> None:
        """Only the facets that the mask [p] chooses."""
        self.facets = self.facets.where(chosen)
        self.layer = None if self.layer is None else self.layer[chosen]
        self.delay_m = None if self.delay_m is None else self.delay_m[chosen]
        self.seen = None if self.seen is None else (self.seen[0][:, chosen], self.seen[1][:, chosen])
        self.sight = None if self.sight is None else self.sight.where(chosen)


class EchoState:
    """The echoes of a scene in the making.

    Effects come in the order of the catalogue: first those that change the `array` or the antennas' `pattern` (the
    exponent of cos θ), then those that change the target's `surface` or add an `extra` echo of it; the first that asks
    for `samples` has them computed, and the rest change those.
    """

    def __init__(
        self, scene: EchoScene, frames: int, tolerance: float | None = 1e-5, levels: dict[str, float] | None = None
    ) -> None:
        """levels: as another state with the target left them; this one is then of the room without it."""
        self.scene, self.frames, self.tolerance = scene, frames, tolerance
        self.array = scene.array
        self.pattern = 0.0
        self.with_target = with_target = levels is None
        self.levels = {} if levels is None else levels
        body = scene.target if with_target else None
        self.surface = None if body is None else Surface(body, facing(scene, body))
        self.ball_delay_m = np.zeros(len(scene.balls))  # extra one-way path of each ball's echo
        self.extra: list[Callable[[], np.ndarray]] = []  # what else of the target echoes: samples [f, t, r]
        self._samples: np.ndarray | None = None

    def seed(self, effect: str, *keys: int) -> tuple[int, ...]:
        """Seed of one effect alone, so that no other's draws depend on whether it is on."""
        return (self.scene.seed, zlib.crc32(effect.encode()), *keys)

    def frame_seeds(self, effect: str) -> list[tuple[int, ...]]:
        """The same for each frame; the empty room has its own."""
        return [self.seed(effect, 0 if self.with_target else 1, frame) for frame in range(self.frames)]

    @staticmethod
    def random(seed: tuple[int, ...]) -> np.random.Generator:
        """Random numbers from such a seed."""
        return np.random.default_rng(np.random.SeedSequence(seed))

    def level(self, name: str, measure: Callable[[], float]) -> float:
        """A level that is measured with the target and kept for the room without it."""
        if self.with_target:
            self.levels[name] = measure()
        return self.levels[name]

    @property
    def points_m(self) -> np.ndarray:
        """The target's facets and balls: [n, 3]."""
        facets = [] if self.surface is None else [require_facets(self.surface.facets).position_m]
        return np.concatenate([*facets, *(ball.centre_m[None] for ball in self.scene.balls)])

    def moved(self, offset_m: np.ndarray) -> AntennaArray:
        """The array as the target sees it when the target has moved by offset_m [3]."""
        return AntennaArray(self.array.tx_m - offset_m, self.array.rx_m - offset_m)

    def echo(self, array: AntennaArray) -> np.ndarray:
        """The target's samples complex64 [f, t, r] at antennas that are where `array` says, without extra echoes."""
        samples = np.zeros((len(self.scene.frequencies_hz), *array.channels), np.complex64)
        if self.surface is not None:
            samples += self._surface_echo(self.surface, array)
        if self.with_target:
            samples += ball_echoes(self.scene, self.scene.frequencies_hz, array, self.ball_delay_m, self.pattern)
        return samples

    def _surface_echo(self, surface: Surface, array: AntennaArray) -> np.ndarray:
        """Samples complex64 [f, t, r] of a surface: each layer's echoes times its reflection."""
        facets, layer = require_facets(surface.facets), surface.layer
        normal = facets.normal if surface.oblique else None
        every = Scatterers(facets.position_m, facets.area_m2, normal, surface.delay_m, surface.seen, surface.sight)
        layers = [every] if layer is None else [every.where(layer == n) for n in range(layer.max(initial=0) + 1)]
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
            samples += echoes if surface.reflection is None else echoes * surface.reflection[n][:, None, None]
        return samples

    def extra_echoes(self) -> np.ndarray | int:
        """The sum of the extra echoes, complex64 [f, t, r]; 0 where there are none."""
        return sum(extra() for extra in self.extra)

    @property
    def samples(self) -> np.ndarray:
        """Samples complex64 [frame, f, t, r]; the target's echoes, the same in every frame, until an effect differs."""
        if self._samples is None:
            self._samples = np.repeat((self.echo(self.array) + self.extra_echoes())[None], self.frames, axis=0)
        return self._samples

    @samples.setter
    def samples(self, samples: np.ndarray) -> None:
        self._samples = samples


def require_facets(facets: Facets) -> Facets:
    """The facets, if there are any."""
    if len(facets) == 0:
        raise HandbenchError(
            "target: no facet faces the array; check the mesh's orientation (normals point outwards) and place"
        )
    return facets


def facing(scene: EchoScene, body: Body, longest: float = 0.25) -> Facets:
    """The body's facets, with edges of `longest` wavelengths at most, whose face turns its front to some antenna. Made
    once."""
    return scene.kept(("facing", id(body), longest), lambda: _facing(scene, body, longest))


def _facing(scene: EchoScene, body: Body, longest: float) -> Facets:
    vectors = face_vectors(body.vertices_m, body.faces)
    centres = body.vertices_m[body.faces].mean(axis=1)
    antennas = np.concatenate([scene.array.tx_m, scene.array.rx_m])
    corners = Box(antennas.min(axis=0), antennas.max(axis=0)).corners_m
    front = (vectors @ corners.T > (vectors * centres).sum(axis=1)[:, None]).any(axis=1)
    return facets_of(body, longest * scene.wavelength_m, np.flatnonzero(front))
