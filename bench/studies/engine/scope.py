"""Scope and inputs of the engine's benchmark: the paper's volume, tones and array, the echoes of a
hand, and how many voxels, repeats and sizes are measured."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from handbench.bench.scenes.build import build
from handbench.bench.scenes.echoes import echo_scene
from handbench.bench.scenes.scene_file import SceneFile
from handbench.radar.data.arrays import AntennaArray, qar50
from handbench.radar.data.capture import RadarCapture
from handbench.radar.data.grid import Axis, VoxelGrid
from handbench.radar.methods.fsk_config import PAPER_LATERAL, ThreeToneConfig
from handbench.radar.methods.projection_config import BroadbandConfig
from handbench.radar.simulation.effects.target_surface import shadow_centre
from handbench.radar.simulation.forward import Scatterers, simulate
from handbench.radar.simulation.scene_echoes import bare_echoes

PAPER_DEPTH = Axis(start_m=0.245, stop_m=0.325, step_m=0.001)


@dataclass(frozen=True)
class Scope:
    """Scope of the benchmark: volume, tolerances, and how much is measured. The defaults are the
    paper's volume and a measurement of some minutes."""

    lateral: Axis = PAPER_LATERAL
    depth: Axis = PAPER_DEPTH
    edge_m: float = 1e-3  # of the hand's mesh before it is split to a quarter of the wavelength
    tolerances: tuple[float, ...] = (1e-2, 1e-3, 1e-4, 1e-5)
    repeats: int = 5
    gemm_size: int = 4096
    numpy_voxels: int = 24
    numba_voxels: int = 256
    checked_voxels: int = 4000
    checked_pixels: int = 400
    growth: tuple[int, ...] = (1, 2, 4, 8, 16)
    channels: tuple[int, ...] = (24, 47, 94, 188)  # transmitters, and as many receivers
    tones: tuple[int, ...] = (16, 32, 64, 128, 256)

    @property
    def config(self) -> BroadbandConfig:
        """Configuration of the method "broadband" for this volume, with the method's default tones
        and threshold."""
        return BroadbandConfig(x=self.lateral, y=self.lateral, z=self.depth)

    @property
    def frame(self) -> ThreeToneConfig:
        """Configuration of 3-FSK on the pixels of this volume."""
        return ThreeToneConfig(x=self.lateral, y=self.lateral)


QUICK = Scope(
    lateral=Axis(start_m=-0.05, stop_m=0.05, step_m=0.001),
    depth=Axis(start_m=0.27, stop_m=0.31, step_m=0.001),
    edge_m=5e-3,
    tolerances=(1e-2, 1e-4),
    repeats=1,
    gemm_size=2048,
    numpy_voxels=4,
    numba_voxels=32,
    checked_voxels=500,
    checked_pixels=50,
    growth=(1, 2, 4),
    channels=(47, 94),
    tones=(64, 128),
)


@dataclass(frozen=True)
class Inputs:
    """Inputs of the benchmark: the antenna array, and the simulated echoes of a hand that shows the
    ASL letter F."""

    scope: Scope
    array: AntennaArray = field(default_factory=qar50)

    @cached_property
    def scatterers(self) -> Scatterers:
        """The facets of the hand that the array sees, as input of the simulation of echoes."""
        target = {"kind": "hand", "pose": "F", "edge_m": self.scope.edge_m}
        scene = build(SceneFile(version=1, name="F", target=target))
        seen = shadow_centre(bare_echoes(echo_scene(scene))).surface
        assert seen is not None  # a hand has one
        return seen.facets.optics

    @property
    def grid(self) -> VoxelGrid:
        """The voxels of the volume."""
        return self.scope.config.grid()

    @property
    def tones_hz(self) -> np.ndarray:
        """Frequencies [f] of the broadband sweep, Hz."""
        return self.scope.config.tones_hz()

    @cached_property
    def samples(self) -> dict[str, np.ndarray]:
        """Samples [f, t, r], complex64, by their source: "hand" for the hand's echoes, "noise" for
        white noise."""
        hand = simulate(self.scatterers, self.tones_hz, self.array)
        return {"hand": hand, "noise": white_noise(hand.shape)}

    @cached_property
    def frame(self) -> RadarCapture:
        """One frame of the hand's echoes at the tones of 3-FSK."""
        tones_hz = np.array(self.scope.frame.ladder_hz)
        return RadarCapture(
            simulate(self.scatterers, tones_hz, self.array)[None], tones_hz, self.array
        )


def white_noise(shape: tuple[int, ...]) -> np.ndarray:
    """Return circular Gaussian noise of unit power, complex64 of this shape."""
    parts = np.random.default_rng(0).standard_normal((*shape, 2), dtype=np.float32)
    return (parts * np.float32(np.sqrt(0.5))).view(np.complex64)[..., 0]
