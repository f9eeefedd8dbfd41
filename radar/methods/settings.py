"""Settings that all methods share: pixels, tones, threshold and tolerance."""

from __future__ import annotations

import math
from typing import Annotated, Self

import numpy as np
from pydantic import AfterValidator, Field, model_validator

from handbench.radar.data.grid import MOST_ON_AXIS, Axis, PixelGrid, Sweep
from handbench.support.config import Config, Tone

MOST_VOXELS = 200_000_000  # 200 times the paper's; 1.6 GB
LATERAL = Axis(start_m=-0.15, stop_m=0.15, step_m=0.001)  # the paper's


def _odd(size_px: int) -> int:
    if not 1 <= size_px <= MOST_ON_AXIS or size_px % 2 == 0:
        raise ValueError(
            f"expected an odd number from 1 to {MOST_ON_AXIS}; an even window would shift the map "
            "by half a pixel"
        )
    return size_px


Depth = Annotated[float, Field(gt=0, le=100)]  # metres
OddPixels = Annotated[int, AfterValidator(_odd)]


class MethodSettings(Config):
    """Settings that all methods have. More than MOST_VOXELS voxels of a method with an axis
    z are an error."""

    x: Axis = Field(default=LATERAL, description="pixels")
    y: Axis = Field(default=LATERAL, description="pixels")
    tones_hz: Annotated[tuple[Tone, ...], Field(min_length=1)] | Sweep = Field(
        default=Sweep(), description="a list, or evenly spaced tones from start to stop"
    )
    threshold_db: float = Field(
        default=-10.0, lt=0, description="pixels weaker than this are off target"
    )
    tolerance: float | None = Field(
        default=1e-5, gt=0, lt=1, description="relative error of the images; null: exact"
    )

    @model_validator(mode="after")
    def _bounded(self) -> Self:
        axes = {name: axis for name in "xyz" if isinstance(axis := getattr(self, name, None), Axis)}
        count = math.prod(axis.count for axis in axes.values())
        if count > MOST_VOXELS:
            raise ValueError(
                f"the axes {', '.join(axes)} make {count} points, more than {MOST_VOXELS}; "
                "take larger steps"
            )
        return self

    @property
    def frequencies_hz(self) -> np.ndarray:
        """The tones [f], hertz."""
        if isinstance(sweep := self.tones_hz, Sweep):
            return sweep.frequencies_hz
        return np.array(self.tones_hz)

    @property
    def pixels(self) -> PixelGrid:
        """The pixels of the depth map."""
        return PixelGrid(self.x.values_m(), self.y.values_m())
