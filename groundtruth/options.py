"""Options of `handbench groundtruth`."""

from __future__ import annotations

from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from pydantic import Field

from radar.support.config import Config
from radar.support.errors import HandbenchError


class Effort(NamedTuple):
    """Depth maps have 1 / shrink of the photographs' resolution; iterations of PatchMatch."""

    shrink: int
    iterations: int


EFFORT = {"draft": Effort(4, 2), "normal": Effort(2, 3), "high": Effort(1, 4)}


class Distance(Config):
    """A measured distance between the projection centres of two photographs, metres."""

    first: str
    second: str
    distance_m: float = Field(gt=0)


class Options(Config):
    """Options of a reconstruction.

    cameras: known cameras, a cameras.json, a COLMAP model's folder or Metashape's XML (default: the cameras.json in the
    photographs' folder, if any). intrinsics: fx, fy, cx, cy in pixels of the one camera that took all photographs.
    model: a COLMAP model of these photographs, used instead of structure from motion. metric: the poses of a COLMAP
    model, in `model` or `cameras`, are in metres. board: a board.toml (default as cameras). distances: measured ones
    between cameras, for the scale. unscaled: go on without a metric scale. box_m: xmin, ymin, zmin, xmax, ymax, zmax of
    the region of interest in the mesh's frame; it cuts away the surroundings and saves most of the time. masks: folder
    with a mask for each photograph. mask: cut the target out by its colours where there are no masks. dense: where
    depth maps are made; auto: on a CUDA device, if pycolmap can use one. components: parts of the surface to keep.
    """

    cameras: Path | None = None
    intrinsics: tuple[float, float, float, float] | None = None
    model: Path | None = None
    metric: bool = False
    board: Path | None = None
    distances: tuple[Distance, ...] = ()
    unscaled: bool = False
    quality: Literal["draft", "normal", "high"] = "normal"
    box_m: tuple[float, float, float, float, float, float] | None = None
    masks: Path | None = None
    mask: Literal["none", "colour"] = "none"
    dense: Literal["auto", "cpu", "cuda"] = "auto"
    components: Literal["largest", "all"] = "largest"
    seed: int = Field(default=0, ge=0, lt=2**31)

    def box(self) -> np.ndarray | None:
        """The box's lowest and highest corner [2, 3]."""
        if self.box_m is None:
            return None
        box = np.array(self.box_m).reshape(2, 3)
        if not (box[0] < box[1]).all():
            raise HandbenchError(f"box_m: is {self.box_m}; expected xmin, ymin, zmin, xmax, ymax, zmax with min < max")
        return box

    @property
    def effort(self) -> Effort:
        """Resolution and iterations of the chosen quality."""
        return EFFORT[self.quality]
