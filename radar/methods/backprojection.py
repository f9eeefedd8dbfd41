"""Backprojection of a volume at all tones, and its maximum intensity projection to a surface: the
established methods that FSK is compared with."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from handbench.radar.data.capture import RadarCapture, scaled_to_one
from handbench.radar.data.depthmap import DepthMap, amplitude_db
from handbench.radar.data.grid import Axis, VoxelGrid
from handbench.radar.methods.settings import MethodSettings


class Backprojection(MethodSettings):
    """Settings of broadband backprojection; voxels and tones are the paper's."""

    z: Axis = Field(default=Axis(start_m=0.245, stop_m=0.325, step_m=0.001), description="depths")
    threshold_db: float = Field(
        default=-13.0, lt=0, description="pixels weaker than this are off target"
    )
    subvoxel: bool = Field(default=False, description="depth between voxels, by a parabola")
    tolerance: float | None = Field(
        default=1e-4, gt=0, lt=1, description="relative error of the image; null: exact"
    )

    @property
    def voxels(self) -> VoxelGrid:
        """The voxels of the volume."""
        return VoxelGrid(self.x.values_m(), self.y.values_m(), self.z.values_m())


def volume(capture: RadarCapture, config: Backprojection, frame: int = 0) -> np.ndarray:
    """Image the voxels p at all tones f: complex64 [nz, ny, nx],

    O(p) = Σ_f Σ_t Σ_r S_f[t, r] exp(+j2πf(|p − t| + |p − r|)/c)."""
    from handbench.radar.imaging.api import image_volume  # numba, which settings do not need

    samples, frequencies_hz = capture.tones(config.frequencies_hz, frame)
    return image_volume(samples, frequencies_hz, capture.aperture, config.voxels, config.tolerance)


def backprojection(capture: RadarCapture, config: Backprojection, frame: int = 0) -> DepthMap:
    """Compute the depth map of a frame by maximum intensity projection, without storing the volume:
    z(x, y) = z_k, k = arg max_k |O(x, y, z_k)|, where within threshold_db of the maximum.

    Pixels are flagged if their strongest voxel is the first or the last along z, since the echo may
    be outside the volume.
    """
    from handbench.radar.imaging.api import project_volume

    samples, frequencies_hz = capture.tones(config.frequencies_hz, frame)
    grid, samples = config.voxels, scaled_to_one(samples)
    index, magnitude = project_volume(
        samples, frequencies_hz, capture.aperture, grid, config.tolerance
    )
    db, z_m = amplitude_db(magnitude[1]), grid.z_m[index]
    if config.subvoxel:
        z_m = z_m + config.z.step_m * peak_offset(magnitude)
    seen = db >= config.threshold_db
    at_end = seen & np.isin(index, (0, len(grid.z_m) - 1))
    z_m, settings = np.where(seen, z_m, np.nan), config.model_dump(mode="json")
    return DepthMap(grid.x_m, grid.y_m, z_m, db, "broadband", settings, wrapped=at_end)


def peak_offset(magnitude: np.ndarray) -> np.ndarray:
    """Compute the position of the maximum between three neighbouring voxels from their magnitudes m
    [3, ...], relative to the middle one, in voxels: within ±½ if the middle one is the strongest.
    It is 0 where a magnitude is NaN, since the maximum may be outside the volume.

    It is the vertex ½(a₀ − a₂)/(a₀ − 2a₁ + a₂) of the parabola through a = log m, since the
    logarithm of a band-limited main lobe is closer to a parabola than the lobe itself (the quartic
    term of sinc x over the quadratic is π²/20, that of its logarithm π²/30).
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        a = np.log(magnitude.astype(np.float64))
        offset = 0.5 * (a[0] - a[2]) / (a[0] - 2 * a[1] + a[2])
    return np.where(np.isfinite(offset), offset, 0.0)  # three equal voxels have no vertex
