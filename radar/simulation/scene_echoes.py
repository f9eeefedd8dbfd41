"""The echoes of a scene while they are simulated: what effects shape before the samples are summed,
such as the facets of its surfaces, which are small against the wavelength; and the sums."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from handbench.radar.data.arrays import AntennaArray
from handbench.radar.imaging.tree import Box
from handbench.radar.simulation.forward import Scatterers, simulate
from handbench.radar.simulation.meshes import (
    MOST_FACETS,
    face_vectors,
    quarters,
    unit,
    vertex_normals,
)
from handbench.radar.simulation.reflection import echo_reflections
from handbench.radar.simulation.scene import METAL, Body, EchoScene, Material
from handbench.radar.simulation.spheres import pattern_gain, sphere_echo
from handbench.support.errors import HandbenchError

LONGEST = 0.25  # edge of a facet, wavelengths
SIGHT_TOLERANCE = 1e-3  # of diffracted echoes: a fifth of the error of interpolating their sight
Tones = slice | list[int]


@dataclass(eq=False)
class Echoes:
    """The echoes of a scene's target and balls while effects shape them.

    frames: number of frames; empty: whether one more frame follows, of the room without the target.
    tolerance: relative error of the fast summation (None: exact sum).

    Effects change the following. array: the true positions of the antennas; pattern: exponent q of
    their amplitude pattern cosᵠθ; facets: those of the target (None for balls only), without
    shadows before any effect; ball_delay_m [n]: extra one-way path of each ball's echo; oblique:
    True for the obliquity of physical optics, False to scatter evenly in all directions; material:
    as which the target reflects; bounced [f, t, r]: echoes over several places of the target;
    moving: whether each tone sees the target at its own time. `shaping` has the functions that did
    so, in their order.
    """

    scene: EchoScene
    frames: int
    tolerance: float | None
    empty: bool
    array: AntennaArray
    facets: Scatterers | None
    ball_delay_m: np.ndarray
    oblique: bool = False
    material: Material = METAL
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
        facets = [] if self.facets is None else [self.facets.position_m]
        return np.concatenate([*facets, *(ball.centre_m[None] for ball in self.scene.balls)])

    @property
    def layers(self) -> np.ndarray:
        """Index [m] of the material's layer on each face of the target: 1 on the palm of a hand of
        skin, else 0."""
        body = self.scene.body
        if body.palm is None or self.material.kind != "skin":
            return np.zeros(len(body.faces), int)
        return body.palm.astype(int)

    def sums(self, tones: Tones = slice(None)) -> np.ndarray:
        """Sum the echoes of the target's surface and of the balls, without bounces: complex64
        [f, t, r]. tones: indices of the tones f. Raises HandbenchError for a surface without
        facets."""
        frequencies_hz = self.scene.frequencies_hz[tones]
        samples = np.zeros((len(frequencies_hz), *self.array.channels), np.complex64)
        for reflection, facets in self._layered(frequencies_hz):
            echoes = simulate(
                facets,
                frequencies_hz,
                self.array,
                tolerance=self.tolerance,
                pattern=self.pattern,
                sight_tolerance=SIGHT_TOLERANCE,
            )
            samples += echoes * reflection[:, None, None]
        for ball, delay_m in zip(self.scene.balls, self.ball_delay_m, strict=True):
            echo = sphere_echo(ball.centre_m, ball.radius_m, delay_m, frequencies_hz, self.array)
            samples += echo * pattern_gain(ball.centre_m, self.array, self.pattern)
        return samples

    def _layered(self, frequencies_hz: np.ndarray) -> Iterator[tuple[np.ndarray, Scatterers]]:
        """Yield the echo amplitude [f] of each layer of the target's material relative to metal,
        and the facets with that layer."""
        facets = self.facets
        if facets is None:
            return
        if len(facets) == 0:
            raise HandbenchError(
                "target: no facet of its mesh faces the array; check its position, and that its "
                "normals point outwards"
            )
        layer = self.layers[facets.face]
        optics = facets if self.oblique else replace(facets, normal=None)
        for n, reflection in enumerate(echo_reflections(self.material, frequencies_hz)):
            yield reflection, optics.where(layer == n)

    def samples(self) -> np.ndarray:
        """Sum all echoes of the target and its balls at rest: complex64 [f, t, r]."""
        return self.sums() if self.bounced is None else self.sums() + self.bounced


Shape = Callable[[Echoes], None]


def bare_echoes(
    scene: EchoScene, frames: int = 1, tolerance: float | None = 1e-5, empty: bool = False
) -> Echoes:
    """Return the echoes of a scene before any effect."""
    facets = None if scene.target is None else front_facets(scene, scene.target)
    delay_m = np.zeros(len(scene.balls))
    return Echoes(scene, frames, tolerance, empty, scene.array, facets, delay_m)


def front_facets(scene: EchoScene, body: Body, longest: float = LONGEST) -> Scatterers:
    """Return those facets of the body that face at least one corner of the box around the antennas,
    with edges of at most `longest` wavelengths."""
    vectors = face_vectors(body.vertices_m, body.faces)
    centres = body.vertices_m[body.faces].mean(axis=1)
    antennas = np.concatenate([scene.array.tx_m, scene.array.rx_m])
    corners = Box(antennas.min(axis=0), antennas.max(axis=0)).corners_m
    front = (vectors @ corners.T > (vectors * centres).sum(axis=1)[:, None]).any(axis=1)
    return facets_of(body, longest * scene.wavelength_m, np.flatnonzero(front))


def facets_of(body: Body, longest_m: float = np.inf, faces: np.ndarray | None = None) -> Scatterers:
    """Divide faces of a body (those with the indices `faces`, or all) into facets: each face is
    split into four, repeatedly, until no edge is longer than longest_m. Normals are interpolated
    between the mesh's vertices. Raises HandbenchError for more than MOST_FACETS facets."""
    chosen = np.arange(len(body.faces)) if faces is None else faces
    corners = body.vertices_m[body.faces[chosen]]
    edges_m = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1, initial=0)
    splits = np.ceil(np.log2(np.maximum(edges_m / longest_m, 1))).astype(int)
    if (4.0**splits).sum() > MOST_FACETS:
        raise HandbenchError(
            f"target: has a longest edge of {1e3 * edges_m.max():.1f} mm, which must be split "
            f"{splits.max()} times to sample the wavelength (edges of {1e3 * longest_m:.2g} mm) "
            f"and makes more than {MOST_FACETS} facets; remesh it with edges of equal length"
        )
    normals = vertex_normals(body)[body.faces[chosen]]
    area_m2 = np.linalg.norm(face_vectors(body.vertices_m, body.faces[chosen]), axis=1)
    every = np.unique(splits) if len(splits) else [0]
    parts = [_split(corners, normals, area_m2, chosen, splits == n, n) for n in every]
    position_m, weight, normal, face, share = map(np.concatenate, zip(*parts, strict=True))
    return Scatterers(position_m, weight, normal, None, face, share)


def _split(
    corners: np.ndarray,
    normals: np.ndarray,
    area_m2: np.ndarray,
    face: np.ndarray,
    chosen: np.ndarray,
    splits: int,
) -> tuple[np.ndarray, ...]:
    centres = _centres(splits)
    position = np.einsum("kc,mci->mki", centres, corners[chosen]).reshape(-1, 3)
    normal = unit(np.einsum("kc,mci->mki", centres, normals[chosen]).reshape(-1, 3))
    area = np.repeat(area_m2[chosen] / len(centres), len(centres))
    share = np.tile(centres, (len(corners[chosen]), 1))
    return position, area, normal, np.repeat(face[chosen], len(centres)), share


def _centres(splits: int) -> np.ndarray:
    """Return the barycentric coordinates [4ⁿ, 3] of the centres of the parts of a triangle that is
    split into four, n = `splits` times, at its edges' midpoints."""
    triangles = np.eye(3)[None]
    for _ in range(splits):
        triangles = quarters(triangles)
    return triangles.mean(axis=1)
