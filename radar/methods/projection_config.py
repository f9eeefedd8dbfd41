"""Parameters of maximum intensity projections; the defaults are the paper's."""

from __future__ import annotations

import numpy as np
from pydantic import Field, model_validator

from handbench.radar.data.grid import Axis, GridConfig, VoxelGrid
from handbench.radar.methods.fsk_config import PAPER_LATERAL, AgreementConfig, Lateral
from handbench.support.config import Tone

FEWEST = 3  # tones that can be aligned with an estimate of their error


class _VolumeConfig(GridConfig):
    x: Lateral = PAPER_LATERAL
    y: Lateral = PAPER_LATERAL
    z: Axis = Field(default=Axis(start_m=0.245, stop_m=0.325, step_m=0.001), description="depths")
    threshold_db: float = Field(
        default=-13.0, lt=0, description="pixels weaker than this are off target"
    )
    subvoxel: bool = Field(default=False, description="depth between voxels, by a parabola")
    tolerance: float | None = Field(
        default=1e-5, gt=0, lt=1, description="relative error of the image; null: exact"
    )

    def grid(self) -> VoxelGrid:
        """Return the configured voxels as a grid."""
        return VoxelGrid(self.x.values_m(), self.y.values_m(), self.z.values_m())


class BroadbandConfig(_VolumeConfig):
    """Parameters of broadband backprojection with evenly spaced tones; by default, its tones and
    voxels are the paper's."""

    tolerance: float | None = Field(
        default=1e-3, gt=0, lt=1, description="relative error of the image; null: exact"
    )
    start_hz: Tone = Field(default=72e9, description="first tone")
    stop_hz: Tone = Field(default=82e9, description="last tone")
    count: int = Field(
        default=128, ge=2, le=100_000, description="stepped tones from start to stop, both included"
    )

    def tones_hz(self) -> np.ndarray:
        """Return the evenly spaced tones [count], hertz."""
        return np.linspace(self.start_hz, self.stop_hz, self.count)


class AlignedConfig(AgreementConfig, BroadbandConfig):
    """Parameters of broadband backprojection with refined depths: each pixel's depth is that at
    which the phases of some tones agree."""

    @model_validator(mode="after")
    def _alignable(self) -> AlignedConfig:
        if self.count < FEWEST:
            raise ValueError(
                f"count is {self.count}, but alignment needs {FEWEST} or more tones; raise count"
            )
        if self.subvoxel:
            raise ValueError(
                "subvoxel has no effect on aligned depths, which are between voxels already; "
                "leave it out"
            )
        return self


class NarrowbandConfig(_VolumeConfig):
    """Parameters of narrowband backprojection: a volume is imaged at only three tones, those of
    3-FSK, and its strongest voxels give the depths."""

    f1_hz: Tone = Field(default=82.0e9, description="first tone")
    f2_hz: Tone = Field(default=81.8e9, description="second tone")
    f3_hz: Tone = Field(default=79.5e9, description="third tone")

    def tones_hz(self) -> np.ndarray:
        """Return the three tones, hertz."""
        return np.array([self.f1_hz, self.f2_hz, self.f3_hz])


ProjectionConfig = BroadbandConfig | NarrowbandConfig
