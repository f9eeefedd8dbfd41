"""The state of a simulation, which is changed by one effect after another, from the ideal array to
the recorded samples."""

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

SIGHT_TOLERANCE = 1e-3  # of diffracted echoes: a fifth of the error of interpolating their sight
TARGET = "echoes"  # row of the target's own echoes in the table of effects and times
Tones = slice | list[int]


@dataclass(frozen=True, eq=False)
class ScatteringSurface:
    """The facets of a body that scatter, and how they do.

    oblique: True for the obliquity of physical optics, False to scatter evenly in all directions;
    layer [p]: index of the surface layer of each facet (thin skin or palm);
    reflection [layers, f]: complex echo amplitude of each layer relative to metal. seen: masks
    (bool [t, p], bool [r, p]) of the antennas that see each facet (None: all); sight: complex
    factors of the antennas' fields behind diffracting edges (None: 1).
    """

    body: Body
    facets: Facets
    oblique: bool = False
    reflection: np.ndarray | None = None  # [layers, f]
    layer: np.ndarray | None = None
    seen: tuple[np.ndarray, np.ndarray] | None = None
    sight: Sight | None = None

    def where(self, chosen: np.ndarray) -> "ScatteringSurface":
        """Return the surface with only the facets that a mask [p] or indices select."""
        return replace(
            self,
            facets=self.facets.where(chosen),
            layer=None if self.layer is None else self.layer[chosen],
            seen=None if self.seen is None else (self.seen[0][:, chosen], self.seen[1][:, chosen]),
            sight=None if self.sight is None else self.sight.where(chosen),
        )


@dataclass(frozen=True, eq=False)
class Echoes:
    """The state of a simulation between two effects. Each effect takes it and returns a changed
    copy.

    Effects are applied in the order of known_effects.toml. The first ones change the array or
    `pattern` (the exponent q of the antennas' pattern cosᵠθ); the next ones change the target's
    surface or add an extra echo (`extra`: effect → function that returns samples [f, t, r]). The
    samples are computed when an effect first reads `samples`; this effect and later ones store
    changed samples in `recorded` [frame, f, t, r]. `applied` has the effects so far, in this order.

    ball_delay_m [n]: extra one-way path of each ball's echo. tolerance: relative error of the fast
    summation (None: exact sum). with_target: False for the empty room. levels: amplitudes, by
    effect, that are measured with the target and reused for the empty room. timed: function from
    the name of a piece of work to a context manager that measures its time.
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
    applied: tuple["Apply", ...] = ()
    timed: Callable[[str], AbstractContextManager[Any]] = nullcontext

    def seed(self, effect: str, *keys: int) -> tuple[int, ...]:
        """Return the seed of an effect's random numbers. It depends only on the scene's seed, the
        effect's name and further `keys`, so that the numbers do not change when other effects are
        switched on or off."""
        return seed_of(self.scene, effect, *keys)

    def through(self, effect: "Apply") -> "Echoes":
        """Return the state that an effect makes of this one, with the effect in `applied`."""
        return replace(effect(self), applied=(*self.applied, effect))

    def frame_seeds(self, effect: str) -> list[tuple[int, ...]]:
        """Return one seed of the effect's random numbers per frame. The frames of the empty room
        have other seeds than those of the target."""
        return [
            self.seed(effect, 0 if self.with_target else 1, frame) for frame in range(self.frames)
        ]

    def level(self, name: str, measure: Callable[[], float]) -> float:
        """Return a level, such as that of the noise. With the target it is measure(); for the empty
        room it is the value stored under `name` when the target was simulated."""
        return measure() if self.with_target else self.levels[name]

    def record(self, samples: np.ndarray, **levels: float) -> "Echoes":
        """Return the state with changed samples [frame, f, t, r]. `levels` are stored in addition,
        for the simulation of the empty room."""
        return replace(self, recorded=samples, levels={**self.levels, **levels})

    def add(self, effect: str, echo: Callable[[], np.ndarray]) -> "Echoes":
        """Return the state with one more echo of the target. echo: function that is called when the
        echo's samples [f, t, r] are needed."""
        return replace(self, extra={**self.extra, effect: echo})

    @property
    def points_m(self) -> np.ndarray:
        """Positions [n, 3] of the target's facets and of its balls' centres, metres."""
        facets = [] if self.surface is None else [require_facets(self.surface.facets).position_m]
        return np.concatenate([*facets, *(ball.centre_m[None] for ball in self.scene.balls)])

    def echo(self, array: AntennaArray, tones: Tones = slice(None)) -> np.ndarray:
        """Simulate the samples of the target's surface and balls with the antennas of `array`:
        complex64 [f, t, r], without extra echoes such as multiple bounces. tones: indices of the
        tones f."""
        frequencies_hz = self.scene.frequencies_hz[tones]
        samples = np.zeros((len(frequencies_hz), *array.channels), np.complex64)
        with self.timed(TARGET):
            if self.surface is not None:
                samples += self._surface_echo(self.surface, array, tones)
            if self.with_target:
                samples += ball_echoes(
                    self.scene, frequencies_hz, array, self.ball_delay_m, self.pattern
                )
        return samples

    def _surface_echo(
        self, surface: ScatteringSurface, array: AntennaArray, tones: Tones
    ) -> np.ndarray:
        """Simulate the samples of a surface: complex64 [f, t, r]. They are the sum over the
        surface's layers of the echoes of each layer's facets times the layer's reflection."""
        frequencies_hz = self.scene.frequencies_hz[tones]
        facets, layer = require_facets(surface.facets), surface.layer
        normal = facets.normal if surface.oblique else None
        every = Scatterers(facets.position_m, facets.area_m2, normal, surface.seen, surface.sight)
        layers = (
            [every]
            if layer is None
            else [every.where(layer == n) for n in range(layer.max(initial=0) + 1)]
        )
        samples = np.zeros((len(frequencies_hz), *array.channels), np.complex64)
        for n, part in enumerate(layers):
            echoes = simulate(
                part,
                frequencies_hz,
                array,
                tolerance=self.tolerance,
                pattern=self.pattern,
                sight_tolerance=SIGHT_TOLERANCE,
            )
            samples += (
                echoes
                if surface.reflection is None
                else echoes * surface.reflection[n][tones, None, None]
            )
        return samples

    def extra_echoes(self) -> np.ndarray | int:
        """Compute the sum of the extra echoes (of multiple bounces and foam): complex64 [f, t, r],
        or the number 0 if there are none."""
        total: np.ndarray | int = 0
        for effect, echo in self.extra.items():
            with self.timed(effect):
                total = total + echo()
        return total

    @cached_property
    def samples(self) -> np.ndarray:
        """Samples complex64 [frame, f, t, r]: those that effects have recorded, or else the
        target's echoes, which are equal in all frames."""
        if self.recorded is not None:
            return self.recorded
        return np.repeat((self.echo(self.array) + self.extra_echoes())[None], self.frames, axis=0)


def bare_echoes(
    scene: EchoScene,
    frames: int = 1,
    tolerance: float | None = 1e-5,
    levels: Mapping[str, float] | None = None,
) -> Echoes:
    """Return the state of a simulation before any effect: the target's facets scatter evenly,
    without shadows.

    levels: None to simulate the target. To simulate the empty room instead, the levels that effects
    have measured with the target.
    """
    body = scene.target if levels is None else None
    surface = None if body is None else ScatteringSurface(body, front_facets(scene, body))
    still = np.zeros(len(scene.balls))
    return Echoes(
        scene, scene.array, surface, still, frames, tolerance, levels is None, levels=levels or {}
    )


Apply = Callable[[Echoes], Echoes]


def seed_of(scene: EchoScene, effect: str, *keys: int) -> tuple[int, ...]:
    """Return the seed of an effect's random numbers in a scene, and of further `keys`."""
    return (scene.seed, zlib.crc32(effect.encode()), *keys)


def generator(seed: tuple[int, ...]) -> np.random.Generator:
    """Return the random number generator for a seed from `Echoes.seed`."""
    return np.random.default_rng(np.random.SeedSequence(seed))


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
