"""Captures of the data set MAROON (Wirth et al. 2024, arXiv 2411.00527), read from its own folders.
One object at one distance is a capture.

    OBJECT/30/  metadata.json  alignment.json
                radar_72.0_82.0_128/  calibration.json
                radar_72.0_82.0_128/calibrated_data/  000000.npy  000000_emptyfiltered.npy …
                photogrammetry/  mesh.obj  mesh_masked.obj  rgb/ …

MAROON's radar frame is handbench's with x negated, or equal to it if the matrix in alignment.json
has no reflection (`bench.datasets.maroon_alignment`). Boxes are converted here, transforms there;
the antennas need no conversion.
"""

import re
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import AliasPath, Field

from handbench.bench.datasets.maroon_alignment import (
    ALIGNMENT,
    KEY,
    is_mirrored,
    load_alignment,
    load_matrix,
    load_part,
)
from handbench.bench.datasets.maroon_frame import read_frame
from handbench.bench.datasets.native import EMPTY_FILTERED, CaptureFile, NativeCapture
from handbench.calibration.transforms import Transform
from handbench.radar.data.arrays import qar50
from handbench.radar.data.capture import RadarCapture
from handbench.radar.data.depthmap import DepthMap
from handbench.support.config import Config, parse
from handbench.support.errors import HandbenchError
from handbench.support.files import content_hash, inside
from handbench.support.progress import say

FRAMES, METADATA, VOLUMES = "calibrated_data", "metadata.json", "calibration.json"
FOLDERS_OF_FRAMES = f"radar_*/{FRAMES}/"
REGISTRATIONS = "00_registration"  # next to the objects: captures of their calibration target
PHOTOGRAMMETRY = "photogrammetry"
MESHES = ("mesh_masked.obj", "mesh.obj")  # cropped to the object, and whole
# their shipped box, 0.25 to 0.4 m for objects at 0.3 m
START_M, STOP_M, STEP_M = -0.05, 0.10, 0.001
# their code's, where metadata.json has none: the first for objects at 0.3 m only
NEAR_ZMIN_M, ZMAX_M = (0.26, 0.7)
ROUNDED = 7  # decimals of metres: they keep float32
# the methods that want pixels, and those of voxels
PLANES = ("2fsk", "3fsk", "nfsk", "joint")
PROJECTIONS = ("broadband", "narrowband")
FEWEST_PX = 10  # an erosion that leaves no more than these is tried again with a smaller kernel
# the radar's kernel is this many times smaller than metadata.json's `mask_erosion`
RADAR_KERNEL = 4

Point = tuple[float, float, float]
Count = Annotated[int, Field(ge=1)]


class Metadata(Config, extra="ignore"):
    """The used part of a capture's `metadata.json`.

    mask_bb: bounds of the scored box in MAROON's radar frame, metres, under the keys xmin to zmax.
    """

    calibration: str | None = None
    distance_meters: float | None = Field(default=None, gt=0)
    mask_erosion: float = Field(default=0.0, ge=0, le=1000)
    mask_bb: dict[str, float] = Field(default_factory=dict)
    mask_3d_threshold: float = ZMAX_M  # of z: what mask_bb's zmax was called before


class Volume(Config, extra="ignore"):
    """The voxels of MAROON's own images: the corners of their box in its radar frame, metres, and
    their number along each axis."""

    bb_min: Point
    bb_max: Point
    grid_size: tuple[Count, Count, Count]


class Volumes(Config, extra="ignore"):
    """The used part of a radar's `calibration.json`: the volume of the first frame."""

    volume: Volume | None = Field(default=None, validation_alias=AliasPath("000000", "volume"))


@dataclass(frozen=True)
class MaroonCapture(NativeCapture):
    """One object at one distance, from the data set MAROON. empty_filtered: True to use the frames
    from which the empty room was subtracted."""

    empty_filtered: bool = False

    @staticmethod
    def fits(folder: Path) -> bool:
        """Tell whether `folder` has MAROON's radar data (radar_*/calibrated_data), so that this
        class can read it."""
        return any(folder.glob(FOLDERS_OF_FRAMES))

    @cached_property
    def metadata(self) -> Metadata:
        """The content of the capture's metadata.json."""
        return load_part(Metadata, self.folder / METADATA)

    @cached_property
    def about(self) -> CaptureFile:
        """The description of the capture, named OBJECT-DISTANCE. The methods' images cover the box
        in MAROON's calibration.json."""
        folder = self.folder.resolve()
        name = re.sub("_{2,}", "_", f"{folder.parent.name}-{folder.name}").lstrip(".")
        facts = {
            "name": f"{name}-{EMPTY_FILTERED}" if self.empty_filtered else name,
            "kind": "other",
            "distance_m": self.metadata.distance_meters,
            "source": "MAROON (Wirth et al. 2024)",
            "methods": self._settings(),
        }
        return parse(CaptureFile, facts, str(self.folder))

    @property
    def radar(self) -> Path:
        """The folder of the radar's data. Raises HandbenchError unless there is exactly one."""
        found = list(self.folder.glob(FOLDERS_OF_FRAMES))
        if len(found) != 1:
            raise HandbenchError(
                f"{self.folder}: has {len(found)} folders {FOLDERS_OF_FRAMES}; expected exactly "
                "one; move the others away"
            )
        return found[0].parent

    def echoes(self, frames: int | None = None, calibrated: bool = True) -> RadarCapture:
        """Read the echoes of the first `frames` frames (None: all).

        MAROON's echoes are always calibrated, so `calibrated` has no effect. Raises HandbenchError
        if the frames have different frequencies.
        """
        files = self._frames(frames)
        samples, tones_hz = zip(*map(read_frame, files), strict=True)
        try:
            if len({each.tobytes() for each in tones_hz}) > 1:
                raise HandbenchError("the frequencies 'fvec' of its frames differ; keep one sweep")
            return RadarCapture(np.stack(samples), tones_hz[0], qar50())
        except HandbenchError as error:
            raise HandbenchError(f"{files[0].parent}: {error}") from None

    @property
    def photos(self) -> Path | None:
        """The folder of the capture's photographs; None if there is none."""
        folder = self.folder / PHOTOGRAMMETRY / "rgb"
        return folder if folder.is_dir() else None

    def mesh(self) -> Path | None:
        """Return the file of the mesh that is cropped to the object, in the frame of MAROON's
        photogrammetry, metres. If it is missing, the whole mesh is used and a message printed, as
        in MAROON's code; None if there is no mesh."""
        masked, whole = (self.folder / PHOTOGRAMMETRY / name for name in MESHES)
        if masked.is_file():
            return masked
        if not whole.is_file():
            return None
        say(f"{self.folder}: has no {masked.name}, so {whole.name} is used, as in MAROON's code")
        return whole

    def transform(self) -> Transform | None:
        """Return the transform from the photo frame to handbench's radar frame; None if there is no
        alignment.json."""
        return load_alignment(self.alignment) if self.alignment else None

    @property
    def mirrored(self) -> bool:
        """Whether the x axis of the capture's radar frame is opposite to handbench's, as in
        MAROON's code; it is not if the matrix in alignment.json has no reflection."""
        return self.alignment is None or is_mirrored(load_matrix(self.alignment))

    def warnings(self) -> list[str]:
        """Return a warning if the matrix in alignment.json has no reflection; otherwise an empty
        list."""
        if self.mirrored:
            return []
        return [
            f"{ALIGNMENT}: {KEY} has no reflection, so x of its radar frame is taken as it is; "
            "check the signs in the matrix, above all that of x"
        ]

    def mask(self, depth: DepthMap, erode: bool = False) -> np.ndarray:
        """Return the mask [ny, nx] of the pixels of a depth map that MAROON's code scores: those
        with a depth inside the box mask_bb of metadata.json.

        erode: also remove the target's edges, by an erosion with a square of a quarter of
        metadata.json's `mask_erosion` pixels, as in the paper (but not in MAROON's shipped
        configuration). Raises HandbenchError for an empty box, such as that in MAROON's README.
        """
        metadata, found = self.metadata, np.isfinite(depth.z_m)
        if erode:
            found = eroded(found, round(metadata.mask_erosion / RADAR_KERNEL))
        x_m, y_m = np.meshgrid(-depth.x_m if self.mirrored else depth.x_m, depth.y_m)
        bounds_m = {"zmax": metadata.mask_3d_threshold}
        if metadata.distance_meters == 0.3:
            bounds_m["zmin"] = NEAR_ZMIN_M
        bounds_m |= metadata.mask_bb
        for axis, values_m in zip("xyz", (x_m, y_m, depth.z_m), strict=True):
            low_m = bounds_m.get(f"{axis}min", -np.inf)
            high_m = bounds_m.get(f"{axis}max", np.inf)
            if low_m >= high_m:
                raise HandbenchError(
                    f"{self.folder / METADATA}: mask_bb has {axis}max {high_m:g} below {axis}min "
                    f"{low_m:g}, so no pixel would be scored; correct it"
                )
            found &= (values_m >= low_m) & (values_m <= high_m)
        return found

    def key(self, frames: int | None = None) -> str:
        """Return a hash of all files that a run reads: descriptions, masks, the mesh (without one,
        the photographs), and the first `frames` frames (None: all) of the radar."""
        described = [self.folder / METADATA, self.alignment, self.radar / VOLUMES]
        found = [*described, self.mesh() or self.photos, *self._frames(frames)]
        read = [path for path in found if path is not None and path.exists()]
        return content_hash([f"{path.parent.name}/{path.name}" for path in read], *read)

    def _frames(self, count: int | None) -> list[Path]:
        """Return the files of the first `count` frames (None: all); the first one's name if there
        are none."""
        folder, ending = (
            self.radar / FRAMES,
            f"_{EMPTY_FILTERED}.npy" * self.empty_filtered or ".npy",
        )
        files = sorted(folder.glob(f"{6 * '[0-9]'}{ending}")) or [folder / f"000000{ending}"]
        return files[:count]

    @cached_property
    def alignment(self) -> Path | None:
        """The file alignment.json of the capture; if it is missing, that of the calibration which
        metadata.json names, and a message is printed; None if there is neither."""
        file, name = self.folder / ALIGNMENT, self.metadata.calibration
        if name and not file.exists():
            registrations = self.folder.resolve().parent.parent / REGISTRATIONS
            file = inside(registrations, name, f"{self.folder / METADATA}: calibration") / ALIGNMENT
            if file.exists():
                say(f"{self.folder}: has no {ALIGNMENT}, so {file} is used")
        return file if file.exists() else None

    def _settings(self) -> dict[str, Any]:
        """Return the settings of each method, by its id, that say which pixels or voxels are
        imaged.

        They are the box in MAROON's calibration.json for the first frame or, without one, the
        depths of MAROON's shipped configuration, placed at the object's distance. Empty if the
        distance is unknown too.
        """
        file, distance_m = self.radar / VOLUMES, self.metadata.distance_meters
        volume = load_part(Volumes, file).volume if file.exists() else None
        if volume is None:
            if distance_m is None:
                return {}
            start_m, stop_m = (round(distance_m + end_m, ROUNDED) for end_m in (START_M, STOP_M))
            depths = {"z": {"start_m": start_m, "stop_m": stop_m, "step_m": STEP_M}}
            return dict.fromkeys(PROJECTIONS, depths)
        low_m, high_m = np.round([volume.bb_min, volume.bb_max], ROUNDED)
        if self.mirrored:
            low_m[0], high_m[0] = -high_m[0], -low_m[0]
        box = {}
        ends_m = zip(low_m.tolist(), high_m.tolist(), volume.grid_size, strict=True)
        for axis, (start_m, stop_m, count) in zip("xyz", ends_m, strict=True):
            step_m = (stop_m - start_m) / max(count - 1, 1) or STEP_M
            box[axis] = {"start_m": start_m, "stop_m": stop_m, "step_m": step_m}
        pixels = {axis: box[axis] for axis in "xy"}
        return dict.fromkeys(PLANES, pixels) | dict.fromkeys(PROJECTIONS, box)


def eroded(mask: np.ndarray, pixels: int) -> np.ndarray:
    """Erode a mask [ny, nx] by a square of `pixels` × `pixels`, or by the largest smaller square
    that leaves more than 10 pixels (FEWEST_PX), as MAROON's `SensorVisualizer.add_sensor` does.

    The mask's rows go upwards in y and its columns along handbench's x. MAROON's images are such
    maps turned by 180°, which matters for an even square, so the mask is turned for the erosion.
    Pixels beyond the border of the map do not erode the mask.
    """
    import cv2

    theirs = np.ascontiguousarray(mask[::-1, ::-1], np.uint8)
    for side in range(pixels, 1, -1):
        smaller = cv2.erode(theirs, np.ones((side, side), np.uint8)) > 0
        if np.count_nonzero(smaller) > FEWEST_PX:
            return smaller[::-1, ::-1]
    return mask.astype(bool)
