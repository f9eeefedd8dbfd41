"""Options of `handbench groundtruth`."""

from pathlib import Path
from typing import Any, Literal, NamedTuple, Self

import numpy as np
from pydantic import Field

from handbench.support.config import Config, FileName
from handbench.support.errors import HandbenchError

Quality = Literal["draft", "normal", "high", "thorough"]


class Effort(NamedTuple):
    """How much work goes into depth maps.

    shrink: divisor of the photographs' resolution; iterations: of PatchMatch; thorough: sweep
    planes in several directions, and match each view repeatedly.
    """

    shrink: int
    iterations: int
    thorough: bool = False


EFFORT = {
    "draft": Effort(4, 2),
    "normal": Effort(2, 3),
    "high": Effort(1, 4),
    "thorough": Effort(1, 4, True),
}
# Processor time of a photograph, of a pair of them, of a megapixel's features and of its depths:
# measured on a hand.
PHOTO_S, PAIR_S, FEATURES_S, DEPTHS_S = (
    1.6,
    0.3,
    0.25,
    {"draft": 0.3, "normal": 1.5, "high": 7.5, "thorough": 15.0},
)
BASE_BYTES, MEGAPIXEL_BYTES = 6e8, 3e7  # at the peak: libraries, and a megapixel of all photographs


def predict_effort(count: int, megapixels: float, quality: Quality) -> tuple[float, float]:
    """Predict CPU seconds and peak memory in bytes of a reconstruction from `count` photographs
    with `megapixels` in total."""
    seconds = (
        PHOTO_S * count
        + PAIR_S * count * (count - 1) / 2
        + (FEATURES_S + DEPTHS_S[quality]) * megapixels
    )
    return seconds, BASE_BYTES + MEGAPIXEL_BYTES * megapixels


class Distance(Config):
    """A measured distance between the projection centres of two photographs, metres."""

    first: FileName
    second: FileName
    distance_m: float = Field(gt=0, le=100)


class SparseOptions(Config):
    """Options for finding the cameras' poses and the metric scale.

    cameras: file or folder of known cameras: a cameras.json, a COLMAP model's folder or Metashape's
    XML (default: the cameras.json in the photographs' folder, if any); if all have poses, these are
    used unchanged. intrinsics: fx, fy, cx, cy in pixels of the one camera that took all
    photographs, without distortion. refine_poses: let the bundle adjustment change known poses.
    refine_distortion: estimate the distortion that belongs to given intrinsics. shared_intrinsics:
    unknown lenses are the same for all photographs of a size (True) or one for each photograph
    (False; default: one for each camera, by EXIF data or size). model: a COLMAP model of these
    photographs, used instead of structure from motion; if it has no points, they are triangulated.
    metric: the poses of a COLMAP model, in `model` or `cameras`, are in metres. board: a board's
    file (default: the board.toml in the photographs' folder, if any). distances: measured distances
    between cameras, for the scale. unscaled: go on without a metric scale. seed: of random numbers.
    """

    cameras: Path | None = None
    intrinsics: tuple[float, float, float, float] | None = None
    refine_distortion: bool = False
    shared_intrinsics: bool | None = None
    model: Path | None = None
    refine_poses: bool = False
    metric: bool = False
    board: Path | None = None
    distances: tuple[Distance, ...] = ()
    unscaled: bool = False
    seed: int = Field(default=0, ge=0, lt=2**31)


class Region(Config):
    """Options for the region that is reconstructed.

    box_m: xmin, ymin, zmin, xmax, ymax, zmax of the region of interest in the mesh's frame
    (default: found automatically from board, cameras and sparse points); a small box saves most of
    the time. board: the board's file (default: board.toml in the photographs' folder, if any).
    """

    board: Path | None = None
    box_m: tuple[float, float, float, float, float, float] | None = None

    def shifted(self, by_m: np.ndarray) -> Self:
        """Return the options in a frame in which all positions are by_m [3] larger, metres."""
        if self.box_m is None:
            return self
        return self.model_copy(update={"box_m": tuple((self.box_m + np.tile(by_m, 2)).tolist())})

    def box(self) -> np.ndarray | None:
        """Return the box's lowest and highest corner [2, 3]; None if no box is given. Raises
        HandbenchError if a lower bound is not below its upper one."""
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

    quality: resolution and effort. masks: folder with a mask of the target for each photograph.
    mask: "colour" cuts the target out by its colours where there are no masks. dense: where depth
    maps are computed; auto: on a CUDA device, if pycolmap can use one. seed: of PatchMatch on the
    CPU.
    """

    quality: Quality = "normal"
    masks: Path | None = None
    mask: Literal["none", "colour"] = "none"
    dense: Literal["auto", "cpu", "cuda"] = "auto"
    seed: int = Field(default=0, ge=0, lt=2**31)

    @property
    def effort(self) -> Effort:
        """Resolution and iterations of the chosen quality."""
        return EFFORT[self.quality]


class MeshOptions(Region):
    """Options of the surface. components: the connected parts to keep; "target": with a board,
    those that rise above its plane on the cameras' side, without one all but tiny parts."""

    components: Literal["target", "largest", "all"] = "target"


class Options(SparseOptions, DenseOptions, MeshOptions):
    """Options of a reconstruction: those of its three stages. Each stage receives only its own."""

    def part(self, kind: type[Config], paths: bool = True) -> dict[str, Any]:
        """Return one stage's options as plain values, those of the class `kind`. paths=False:
        without files and folders, whose content is hashed instead."""
        wanted = {
            name for name in kind.model_fields if paths or not isinstance(getattr(self, name), Path)
        }
        return self.model_dump(mode="json", include=wanted)
