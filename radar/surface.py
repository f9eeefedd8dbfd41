"""Surfaces from volumes: the state of the art that FSK is compared with."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from radar.capture import RadarCapture
from radar.config import Config
from radar.depthmap import DepthMap, amplitude_db
from radar.fsk import PAPER_LATERAL
from radar.grid import Axis, VoxelGrid
from radar.volume import image_volume


class _VolumeConfig(Config):
    x: Axis = PAPER_LATERAL
    y: Axis = PAPER_LATERAL
    z: Axis = Axis(start_m=0.245, stop_m=0.325, step_m=0.001)
    threshold_db: float = Field(default=-13.0, lt=0, description="pixels weaker than this are off target")
    tolerance: float | None = Field(default=1e-6, gt=0, lt=1, description="of the tone skeleton; null sums all tones")

    def grid(self) -> VoxelGrid:
        """The voxels."""
        return VoxelGrid(self.x.values_m(), self.y.values_m(), self.z.values_m())


class BroadbandConfig(_VolumeConfig):
    """Broadband backprojection with the paper's parameters."""

    start_hz: float = Field(default=72e9, gt=0)
    stop_hz: float = Field(default=82e9, gt=0)
    count: int = Field(default=128, ge=2, description="stepped tones from start to stop, both included")

    def tones_hz(self) -> np.ndarray:
        """The stepped tones."""
        return np.linspace(self.start_hz, self.stop_hz, self.count)


class NarrowbandConfig(_VolumeConfig):
    """The same projection with the three tones of 3-FSK only."""

    f1_hz: float = Field(default=82.0e9, gt=0)
    f2_hz: float = Field(default=81.8e9, gt=0)
    f3_hz: float = Field(default=79.5e9, gt=0)

    def tones_hz(self) -> np.ndarray:
        """The three tones."""
        return np.array([self.f1_hz, self.f2_hz, self.f3_hz])


def volume(capture: RadarCapture, config: BroadbandConfig | NarrowbandConfig, frame: int = 0) -> np.ndarray:
    """Complex image of the configured voxels: complex64 [nz, ny, nx]."""
    samples, frequencies_hz = capture.tones(config.tones_hz(), frame)
    return image_volume(samples, frequencies_hz, capture.aperture, config.grid(), config.tolerance)


def maximum_projection(
    image: np.ndarray, config: BroadbandConfig | NarrowbandConfig, method: str
) -> DepthMap:
    """Maximum intensity projection along z: each pixel takes the depth of its strongest voxel, whole voxels as in the
    paper; pixels below the threshold are NaN."""
    grid = config.grid()
    magnitude = np.abs(image)
    strongest = magnitude.argmax(axis=0)
    db = amplitude_db(magnitude.max(axis=0))
    z_m = np.where(db >= config.threshold_db, grid.z_m[strongest], np.nan)
    return DepthMap(grid.x_m, grid.y_m, z_m, db, method, config.model_dump())
