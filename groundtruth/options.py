"""Options of the command `handbench groundtruth`, which reconstructs a mesh from photographs."""

from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from pydantic import Field

from handbench.support.config import Config
from handbench.support.errors import HandbenchError

Quality = Literal["draft", "normal", "high"]


class Effort(NamedTuple):
    """Resolution and work of depth maps.

    shrink: divisor of the photographs' resolution. iterations: number of PatchMatch iterations.
    """

    shrink: int
    iterations: int


EFFORT = {"draft": Effort(4, 2), "normal": Effort(2, 3), "high": Effort(1, 4)}


class SparseOptions(Config):
    """Options for finding the cameras' poses and the metric scale.

    cameras: known cameras, as a cameras.json, a COLMAP model's folder or Metashape's XML (default:
    the cameras.json in the photographs' folder, if any). If all have poses, these are used
    unchanged.

    intrinsics: fx, fy, cx, cy in pixels of the one camera that took all photographs, without
    distortion. shared_intrinsics: how many unknown lenses are estimated: one for all photographs of
    a size (True), one for each photograph (False), or one for each camera, distinguished by EXIF
    data or picture size (None).

    model: a COLMAP model of these photographs, used instead of structure from motion; if it has no
    points, they are triangulated. metric: True if the poses of a COLMAP model, given as `model` or
    `cameras`, are in metres.

    board: file that describes the board (default: the board.toml in the photographs' folder, if
    any). unscaled: go on without a metric scale. seed: of random numbers.
    """

    cameras: Path | None = None
    intrinsics: tuple[float, float, float, float] | None = None
    shared_intrinsics: bool | None = None
    model: Path | None = None
    metric: bool = False
    board: Path | None = None
    unscaled: bool = False
    seed: int = Field(default=0, ge=0, lt=2**31)


class Region(Config):
    """Options for the region that is reconstructed.

    box_m: xmin, ymin, zmin, xmax, ymax, zmax of the region in the mesh's frame (default: found from
    board, cameras and sparse points); a small box saves most of the time. board: file that
    describes the board (default: the board.toml in the photographs' folder, if any).
    """

    board: Path | None = None
    box_m: tuple[float, float, float, float, float, float] | None = None

    def box(self) -> np.ndarray | None:
        """Return the lowest and highest corner [2, 3] of the box; None if no box is given. Raises
        HandbenchError if a lower bound is not below its upper bound."""
        if self.box_m is None:
            return None
        box = np.array(self.box_m).reshape(2, 3)
        if not (box[0] < box[1]).all():
            raise HandbenchError(
                f"box_m: is {self.box_m}; expected xmin, ymin, zmin, xmax, ymax, zmax with min < "
                "max"
            )
        return box


class DenseOptions(Region):
    """Options of the depth maps.

    quality: resolution and number of iterations. masks: folder with a mask of the target for each
    photograph. dense: device that computes the depth maps; "auto": a CUDA device, if pycolmap can
    use one. seed: of PatchMatch's random numbers on the CPU.
    """

    quality: Quality = "normal"
    masks: Path | None = None
    dense: Literal["auto", "cpu", "cuda"] = "auto"
    seed: int = Field(default=0, ge=0, lt=2**31)

    @property
    def effort(self) -> Effort:
        """Resolution and number of iterations that belong to `quality`."""
        return EFFORT[self.quality]


class Options(SparseOptions, DenseOptions):
    """Options of a whole reconstruction: the union of its three stages' options, of which each
    stage receives only its own."""

    def part(self, kind: type[Config], paths: bool = True) -> dict[str, Any]:
        """Return the options of one stage as plain values by name. kind: the stage's class of
        options. paths: False leaves out files and folders, for cache keys that have the hash of
        their content instead."""
        wanted = {
            name for name in kind.model_fields if paths or not isinstance(getattr(self, name), Path)
        }
        return self.model_dump(mode="json", include=wanted)
