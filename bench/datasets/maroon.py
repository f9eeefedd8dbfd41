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
from typing import Any

import numpy as np
from pydantic import Field

from handbench.bench.datasets.maroon_alignment import (
    ALIGNMENT,
    KEY,
    is_mirrored,
    load_alignment,
    read_table,
)
from handbench.bench.datasets.maroon_frame import read_frame
from handbench.bench.datasets.native import EMPTY_FILTERED, CaptureFile, NativeCapture
from handbench.calibration.transforms import Transform, checked_numbers
from handbench.radar.data.arrays import qar50
from handbench.radar.data.capture import RadarCapture
from handbench.radar.data.depthmap import DepthMap
from handbench.support.config import Config, parse
from handbench.support.errors import HandbenchError
from handbench.support.files import content_hash, inside
from handbench.support.progress import say

FRAMES, METADATA, VOLUMES = "calibrated_data", "metadata.json", "calibration.json"
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


class Metadata(Config, extra="ignore"):
    """The used part of a capture's `metadata.json`.

    mask_bb: bounds of the scored box in MAROON's radar frame, metres, under the keys xmin to zmax.
    """

    calibration: str | None = None
    distance_meters: float | None = Field(default=None, gt=0)
    mask_erosion: float = Field(default=0.0, ge=0, le=1000)
    mask_bb: dict[str, float] = Field(default_factory=dict)
    mask_3d_threshold: float = ZMAX_M  # of z: what mask_bb's zmax was called before


@dataclass(frozen=True)
class MaroonCapture(NativeCapture):
    """One object at one distance, from the data set MAROON. empty_filtered: True to use the frames
    from which the empty room was subtracted."""

    empty_filtered: bool = False

    @staticmethod
    def fits(folder: Path) -> bool:
        """Tell whether `folder` has MAROON's radar data (radar_*/calibrated_data), so that this
        class can read it."""
        return any((radar / FRAMES).is_dir() for radar in folder.glob("radar_*"))

    @cached_property
    def metadata(self) -> Metadata:
        """The content of the capture's metadata.json; default values if there is no such file."""
        return parse(
            Metadata,
            read_table(self.folder / METADATA, f"MAROON's {METADATA}"),
            str(self.folder / METADATA),
        )

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
        found = sorted(radar for radar in self.folder.glob("radar_*") if (radar / FRAMES).is_dir())
        if len(found) != 1:
            raise HandbenchError(
                f"{self.folder}: has {len(found)} folders radar_*/{FRAMES} "
                f"({', '.join(f.name for f in found)}); expected exactly one; move the others "
                "away"
            )
        return found[0]

    def echoes(self, frames: int | None = None, calibrated: bool = True) -> RadarCapture:
        """Read the echoes of the first `frames` frames (None: as many as the first frame's file
        states).

        MAROON's echoes are always calibrated, so `calibrated` has no effect. Raises HandbenchError
        if the frames have different frequencies.
        """
        first = read_frame(self._file(0))
        count = first.count if frames is None else min(frames, first.count)
        read = [first, *(read_frame(self._file(k)) for k in range(1, count))]
        for number, frame in enumerate(read):
            if not np.array_equal(frame.frequencies_hz, first.frequencies_hz):
                raise HandbenchError(
                    f"{self._file(number)}: its frequencies 'fvec' differ from those of the first "
                    "frame; use frames of one sweep only"
                )
        samples = np.stack([frame.samples for frame in read])
        try:
            return RadarCapture(samples, first.frequencies_hz, qar50())
        except HandbenchError as error:
            raise HandbenchError(f"{self._file(0).parent}: {error}") from None

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
        return self.alignment is None or is_mirrored(self.alignment)

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
        found = np.isfinite(depth.z_m)
        if erode:
            found = eroded(found, round(self.metadata.mask_erosion / RADAR_KERNEL))
        x_m, y_m = np.meshgrid(-depth.x_m if self.mirrored else depth.x_m, depth.y_m)
        for axis, values_m in zip("xyz", (x_m, y_m, depth.z_m), strict=True):
            low_m, high_m = self._bounds_m(axis)
            with np.errstate(invalid="ignore"):
                found &= (values_m >= low_m) & (values_m <= high_m)
        return found

    def key(self, frames: int | None = None) -> str:
        """Return a hash of all files that a run reads: descriptions, masks, the mesh (without one,
        the photographs), and the first `frames` frames (None: all) of the radar."""
        files = sorted(self._file(0).parent.glob(self._file(0).name.replace("000000", 6 * "[0-9]")))
        described = [self.folder / METADATA, self.alignment, self.radar / VOLUMES]
        found = [*described, self.mesh() or self.photos, *files[:frames]]
        read = [path for path in found if path is not None and path.exists()]
        return content_hash([f"{path.parent.name}/{path.name}" for path in read], *read)

    def _file(self, frame: int) -> Path:
        return self.radar / FRAMES / f"{frame:06d}{f'_{EMPTY_FILTERED}' * self.empty_filtered}.npy"

    @cached_property
    def alignment(self) -> Path | None:
        """The file alignment.json of the capture; if it is missing, that of the calibration which
        metadata.json names, and a message is printed; None if there is neither."""
        own = self.folder / ALIGNMENT
        name = self.metadata.calibration
        if own.exists() or not name:
            return own if own.exists() else None
        registrations = self.folder.resolve().parent.parent / REGISTRATIONS
        of_calibration = (
            inside(registrations, name, f"{self.folder / METADATA}: calibration") / ALIGNMENT
        )
        if not of_calibration.is_file():
            return None
        say(f"{self.folder}: has no {ALIGNMENT}, so {of_calibration} is used")
        return of_calibration

    def _bounds_m(self, axis: str) -> tuple[float, float]:
        """Return the lower and upper bound of the scored box along an axis ("x", "y" or "z") of
        MAROON's radar frame, metres. Bounds that metadata.json lacks are those in MAROON's code.
        Raises HandbenchError if the box is empty."""
        about, low, high = self.metadata, -np.inf, np.inf
        if axis == "z":
            low = NEAR_ZMIN_M if about.distance_meters == 0.3 else low
            high = about.mask_3d_threshold
        low, high = about.mask_bb.get(f"{axis}min", low), about.mask_bb.get(f"{axis}max", high)
        if low >= high:
            raise HandbenchError(
                f"{self.folder / METADATA}: mask_bb has {axis}max {high:g} below {axis}min "
                f"{low:g}, so no pixel would be scored; correct it"
            )
        return low, high

    def _settings(self) -> dict[str, Any]:
        """Return the settings of each method, by its id, that say which pixels or voxels are
        imaged.

        They are the box in MAROON's calibration.json for the first frame or, without one, the box
        of MAROON's shipped configuration, placed at the object's distance. Empty if the distance is
        unknown too.
        """
        file = self.radar / VOLUMES
        frame = read_table(file, f"MAROON's {VOLUMES}").get("000000", {}) if file.exists() else {}
        distance_m = self.metadata.distance_meters
        if isinstance(frame, dict) and "volume" in frame:
            box = self._axes(file, frame["volume"])
        elif distance_m is not None:
            start_m, stop_m = (round(distance_m + end_m, ROUNDED) for end_m in (START_M, STOP_M))
            box = {"z": {"start_m": start_m, "stop_m": stop_m, "step_m": STEP_M}}
        else:
            return {}
        pixels = {axis: box[axis] for axis in "xy" if axis in box}
        return dict.fromkeys(PLANES, pixels) | dict.fromkeys(PROJECTIONS, box)

    def _axes(self, file: Path, volume: Any) -> dict[str, dict[str, float]]:
        """Convert the entry `volume` of MAROON's calibration.json to start, stop and step along the
        x, y and z axes of handbench's radar frame, metres. file: the calibration.json, named in
        messages. Raises HandbenchError for an invalid entry."""
        box = volume if isinstance(volume, dict) else {}
        low, high, count = (
            checked_numbers(file, key, box.get(key), [(3,)], 1e4)
            for key in ("bb_min", "bb_max", "grid_size")
        )
        if (count < 1).any() or (count % 1 != 0).any() or (high < low).any():
            raise HandbenchError(
                f"{file}: 'volume' extends from {low.tolist()} to {high.tolist()} in "
                f"{count.tolist()} voxels; expected whole numbers ≥ 1, and bb_min below bb_max"
            )
        if self.mirrored:
            low[0], high[0] = -high[0], -low[0]
        axes = {}
        for axis, *values in zip(
            "xyz", low.round(ROUNDED), high.round(ROUNDED), count, strict=True
        ):
            start_m, stop_m, n = map(float, values)
            step_m = (stop_m - start_m) / (n - 1) if n > 1 and stop_m > start_m else STEP_M
            axes[axis] = {"start_m": start_m, "stop_m": stop_m, "step_m": step_m}
        return axes


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
