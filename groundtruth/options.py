"""Options of the command `handbench groundtruth`, which reconstructs a mesh from photographs."""

from pathlib import Path
from typing import Literal

from pydantic import Field, field_validator

from handbench.support.config import Config

Quality = Literal["draft", "normal", "high"]
Lenses = Literal["auto", "one", "each"]


# divisor of the photographs' resolution
SHRINK: dict[Quality, int] = {"draft": 4, "normal": 2, "high": 1}


class SparseOptions(Config):
    """Options for finding the cameras' poses and the metric scale.

    cameras: known cameras, as a cameras.json, a COLMAP model's folder or Metashape's XML (default:
    the cameras.json in the photographs' folder, if any). What it holds is not changed: the lenses
    and, if all have poses, the poses. metric: True if the poses of a COLMAP model are in metres.

    intrinsics: fx, fy, cx, cy in pixels of the one camera that took all photographs, without
    distortion. lenses: how many unknown lenses there are: "one" for all photographs of a size,
    "each" photograph its own, or "auto": by EXIF data or, without them, one for each size.

    board: file that describes the board (default: the board.toml in the photographs' folder, if
    any). unscaled: go on without a metric scale. seed: of random numbers.
    """

    cameras: Path | None = None
    intrinsics: tuple[float, float, float, float] | None = None
    lenses: Lenses = "auto"
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

    @field_validator("box_m")
    @classmethod
    def _is_box(cls, box_m: tuple[float, ...] | None) -> tuple[float, ...] | None:
        if box_m is not None and any(box_m[k] >= box_m[k + 3] for k in range(3)):
            raise ValueError("expected xmin, ymin, zmin, xmax, ymax, zmax with min < max")
        return box_m


class DenseOptions(Region):
    """Options of the depth maps.

    quality: resolution. masks: folder with a mask of the target for each
    photograph. dense: device that computes the depth maps; "auto": a CUDA device, if pycolmap can
    use one. seed: of PatchMatch's random numbers on the CPU.
    """

    quality: Quality = "normal"
    masks: Path | None = None
    dense: Literal["auto", "cpu", "cuda"] = "auto"
    seed: int = Field(default=0, ge=0, lt=2**31)


class Options(SparseOptions, DenseOptions):
    """Options of a whole reconstruction: the union of its three stages' options, of which each
    stage receives only its own."""
