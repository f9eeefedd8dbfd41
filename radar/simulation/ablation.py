"""Ablation of effects: a coarse simulation of a scene, with few tones and coarse surfaces, and its
depth maps with and without some of the effects.

Effects are applied as in a full simulation, each together with all others that are on. So indirect
changes are included (obliquity and skin, for example, also change echoes that bounce over two
places), and an effect needs no code of its own for ablation.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from handbench.radar.data.capture import RadarCapture
from handbench.radar.data.grid import Axis
from handbench.radar.methods.fsk import fsk
from handbench.radar.methods.fsk_config import (
    PAPER_LATERAL,
    AnyConfig,
    ThreeToneConfig,
    TwoToneConfig,
)
from handbench.radar.methods.projection import project
from handbench.radar.methods.projection_config import NarrowbandConfig
from handbench.radar.simulation.catalogue import Effect
from handbench.radar.simulation.physics.line_of_sight import rays_of
from handbench.radar.simulation.scene import COARSE, EchoScene
from handbench.radar.simulation.scene_echoes import Echoes, bare_echoes

TOLERANCE = 1e-3  # of samples and images, well below the error of the coarse surfaces
COARSER = 2.0  # edges of facets and mirrors relative to a full simulation
PIXELS = 8000  # approximate number in the box around the target
MARGIN_M = 5e-3  # of that box
# least and largest of the pixels, and of 3-FSK's averaging filters
STEP_M, FILTER_M = ((1e-3, 2e-3), 5e-3)
# methods whose maps are compared; only FINE if no close tones are measured
METHODS = ("2fsk", FINE := "3fsk", "narrowband")
VOXEL_M = 1e-3  # along z
DEEPEST_M = 0.12  # largest depth of narrowband's box (paper: 0.08)
BOUNCING = "multipath"
REFLECTING = frozenset({"skin", "dielectric"})  # effects that change echoes over two places


@dataclass(frozen=True)
class Change:
    """The change of a depth map when effects are left out.

    depth_mm: mean |Δz| over the pixels that have a depth in both maps; pixels: number of lost and
    gained pixels over the number of pixels with all effects.
    """

    depth_mm: float
    pixels: float

    @classmethod
    def between(cls, whole_m: np.ndarray, without_m: np.ndarray) -> "Change":
        """Compare two depth maps [ny, nx] in metres, NaN off the target: whole_m with all effects,
        without_m with some left out."""
        there, still = np.isfinite(whole_m), np.isfinite(without_m)
        moved_m = np.abs(whole_m - without_m)[there & still]
        count = max(int(there.sum()), 1)
        return cls(
            1e3 * float(moved_m.mean()) if len(moved_m) else 0.0,
            float((there ^ still).sum()) / count,
        )


class Ablation:
    """A coarse simulation of a scene with `effects`, applied in this order, and its depth maps.
    `change` and `level_db` compare it with simulations that leave some effects out.

    contained: effect → the effect that includes it (as a blurred shadow includes a sharp one); an
    effect is not applied while the one that includes it is.
    """

    def __init__(
        self, scene: EchoScene, effects: Sequence[Effect], contained: Mapping[str, str]
    ) -> None:
        self._contained = contained
        self.scene, self.effects, self._close = (
            _coarse(scene),
            tuple(effects),
            scene.coarse_hz is not None,
        )
        self._after: dict[tuple[str, ...], Echoes] = {}  # by the effects that are in them
        # the whole's extra echo over two places
        self._bounced: dict[str, Callable[[], np.ndarray]] | None = None
        self._made: dict[frozenset[str], np.ndarray] = {}
        self.samples = self._simulated(frozenset())
        self._grid = _box(self.scene)
        self.maps = self._imaged(self.samples)

    def change(self, without: Iterable[str]) -> dict[str, Change]:
        """Return how the depth map of each method changes if the effects `without` are left out, by
        method id: "2fsk", "3fsk" and "narrowband", or "3fsk" alone if the scene has no close
        tones."""
        maps = self._imaged(self._left_out(frozenset(without)))
        return {name: Change.between(z_m, maps[name]) for name, z_m in self.maps.items()}

    def level_db(self, without: Iterable[str]) -> float:
        """Return how much the samples change if the effects `without` are left out: the power of
        the difference over the power of the samples with all effects, in dB (−inf if nothing
        changes)."""
        change = float(np.linalg.norm(self._left_out(frozenset(without)) - self.samples))
        return (
            float(20 * np.log10(change / max(float(np.linalg.norm(self.samples)), 1e-30)))
            if change
            else -np.inf
        )

    def _left_out(self, without: frozenset[str]) -> np.ndarray:
        if without not in self._made:
            self._made[without] = self._simulated(without)
        return self._made[without]

    def _simulated(self, without: frozenset[str]) -> np.ndarray:
        """Simulate samples complex64 [f, t, r] with all effects except `without`.

        Echoes over several bounces take long; they are copied from the simulation with all effects,
        unless an effect that changes the surface's reflection is left out.
        """
        names = {effect.id for effect in self.effects} - without
        names = {name for name in names if self._contained.get(name) not in names}
        echoes, applied = bare_echoes(self.scene, 1, TOLERANCE), tuple[str, ...]()
        for effect in self.effects:
            if effect.id in names:
                applied += (effect.id,)
                if applied not in self._after:
                    self._after[applied] = self._applied(effect, echoes, without)
                echoes = self._after[applied]
        return echoes.samples[0]

    def _applied(self, effect: Effect, echoes: Echoes, without: frozenset[str]) -> Echoes:
        if effect.id != BOUNCING or without & REFLECTING:
            return echoes.through(effect.apply)
        if self._bounced is None:
            extra = effect.apply(echoes).extra
            self._bounced = {name: cache(echo) for name, echo in extra.items() if name == BOUNCING}
        bounced = self._bounced
        return echoes.through(lambda to: replace(to, extra={**to.extra, **bounced}))

    def _imaged(self, samples: np.ndarray) -> dict[str, np.ndarray]:
        """Compute the depth map [ny, nx] of each method from samples [f, t, r], by method id:
        metres, NaN off the target."""
        x, y, z, size_px = self._grid
        if not samples.any():
            nothing = np.full((len(y.values_m()), len(x.values_m())), np.nan)
            return dict.fromkeys(METHODS if self._close else (FINE,), nothing)
        capture = RadarCapture(samples[None], self.scene.frequencies_hz, self.scene.array)
        low_hz, near_hz, high_hz = self.scene.frequencies_hz
        given = {"x": x, "y": y, "tolerance": TOLERANCE}
        tones = {"f1_hz": high_hz, "f2_hz": near_hz}
        start = {"first_depth_m": (z.start_m + z.stop_m) / 2, "corrections": 5}
        filters = {"coarse_filter_px": size_px, "fine_filter_px": size_px}
        configs: dict[str, AnyConfig] = {
            "2fsk": TwoToneConfig(**given, **tones, **start),
            FINE: ThreeToneConfig(**given, **tones, **start, **filters, f3_hz=low_hz),
        }
        projection = NarrowbandConfig(**given, **tones, f3_hz=low_hz, z=z)
        maps = {name: fsk(capture, config)[0].z_m for name, config in configs.items()}
        maps["narrowband"] = project(capture, projection, "narrowband").z_m
        return maps if self._close else {FINE: maps[FINE]}


def _coarse(scene: EchoScene) -> EchoScene:
    """Return the scene for a quick, coarse simulation: with three tones (low, close to the highest,
    highest; ascending) and with facets whose edges are twice as long. It uses the same ray caster
    as the full scene."""
    high_hz, low_hz = scene.pair_hz
    tones_hz = np.array(
        [low_hz, scene.coarse_hz or high_hz - COARSE * scene.depth_step_hz, high_hz]
    )
    measured = np.abs(scene.frequencies_hz - tones_hz[:, None]).argmin(axis=1)
    coarse = replace(scene, frequencies_hz=tones_hz, time_s=scene.time_s[measured], coarser=COARSER)
    if scene.target is not None:
        coarse.cached(("rays", id(scene.target)), lambda: rays_of(scene, scene.body))
    return coarse


def _box(scene: EchoScene) -> tuple[Axis, Axis, Axis, int]:
    """Return the box that is imaged around the target's facets and balls: (axes x, y, z, width in
    pixels of the methods' averaging filters, odd).

    If the scene has a room, which may be brighter than the target, the box is as wide in x and y as
    the images of the methods by default.
    """
    points_m = bare_echoes(scene).points_m
    reach_m = max((ball.radius_m for ball in scene.balls), default=0.0) + MARGIN_M
    low_m, high_m = points_m.min(axis=0) - reach_m, points_m.max(axis=0) + reach_m
    if scene.room:
        low_m[:2], high_m[:2] = PAPER_LATERAL.start_m, PAPER_LATERAL.stop_m
    step_m = float(np.clip(np.sqrt(np.prod((high_m - low_m)[:2]) / PIXELS), *STEP_M))
    x, y = (_axis(low_m[i], high_m[i], step_m) for i in (0, 1))
    size_px = 1 + 2 * round((FILTER_M / step_m - 1) / 2)
    return x, y, _axis(low_m[2], min(high_m[2], low_m[2] + DEEPEST_M), VOXEL_M), max(size_px, 1)


def _axis(low_m: float, high_m: float, step_m: float) -> Axis:
    return Axis(
        start_m=low_m, stop_m=low_m + step_m * np.ceil((high_m - low_m) / step_m), step_m=step_m
    )
