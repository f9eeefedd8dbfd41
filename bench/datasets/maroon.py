"""Captures of the data set MAROON (Wirth et al. 2024, arXiv 2411.00527), read from its own folders.
One object at one distance is a capture.

    OBJECT/30/  metadata.json  alignment.json
                radar_72.0_82.0_128/  calibration.json
                radar_72.0_82.0_128/calibrated_data/  000000.npy  000000_emptyfiltered.npy …
                photogrammetry/  mesh.obj  mesh_masked.obj  rgb/ …
                kinect/ realsense/ zed/  calibration.json  depth/  mask/ …

MAROON's radar frame is handbench's with x negated, or equal to it where
`bench.datasets.maroon_alignment` finds so. Boxes are converted here, transforms there; the antennas
need no conversion.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, cached_property
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import Field

from handbench.bench.datasets.maroon_alignment import (
    ALIGNMENT,
    LENSES,
    Handedness,
    OtherSensor,
    Triangles,
    handedness_of,
    load_alignment,
    pictures,
    read_table,
)
from handbench.bench.datasets.maroon_frame import read_frame
from handbench.bench.datasets.native import EMPTY_FILTERED, CaptureFile, NativeCapture
from handbench.calibration.transforms import Transform, checked_numbers
from handbench.groundtruth.mesh.mesh_files import read_triangles
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
# the first: of photographs cut to the object
MESHES = {"masked": "mesh_masked.obj", "whole": "mesh.obj"}
# their shipped box, 0.25 to 0.4 m for objects at 0.3 m
BEHIND_M = {"start_m": -0.05, "stop_m": 0.10, "step_m": 0.001}
# their code's, where metadata.json has none: the first for objects at 0.3 m only
NEAR_ZMIN_M, ZMAX_M = (0.26, 0.7)
ROUNDED = 7  # decimals of metres: they keep float32
# the methods that want pixels, and those of voxels
PLANES = ("2fsk", "3fsk", "nfsk", "joint", "prior-2fsk", *LENSES)
PROJECTIONS = ("broadband", "narrowband")
CHECK_SIGNS = (
    "check the signs in the matrix, above all that of x, and whether it should have a reflection"
)
FEWEST_PX = 10  # an erosion that leaves no more than these is tried again with a smaller kernel
# the radar's kernel is this many times smaller than metadata.json's `mask_erosion`
RADAR_KERNEL = 4


class Metadata(Config, extra="ignore"):
    """The used part of a capture's `metadata.json`.

    mask_bb: bounds of the scored box in MAROON's radar frame, metres, under the keys xmin to zmax.
    handbench_echo_scale: factor by which handbench 0.2 multiplied the echoes that it exported.
    """

    calibration: str | None = None
    distance_meters: float | None = Field(default=None, gt=0)
    mask_erosion: float = Field(default=0.0, ge=0, le=1000)
    mask_bb: dict[str, float] = Field(default_factory=dict)
    mask_3d_threshold: float | None = None  # what zmax was called before
    handbench_echo_scale: float = Field(default=1.0, ge=2**-100, le=2**100)


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

        MAROON's echoes are always calibrated, so `calibrated` has no effect. The result also has
        the other sensors that alignment.json relates to the radar. Raises HandbenchError if the
        frames have different frequencies.
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
        parts = samples.view(np.float32)  # a power of two changes none of their digits
        with np.errstate(over="ignore", invalid="ignore"):  # a capture names what is not finite
            parts *= np.float32(1 / self.metadata.handbench_echo_scale)
        try:
            return RadarCapture(samples, first.frequencies_hz, qar50(), sensors=self.sensors())
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
        masked, whole = (
            self.folder / PHOTOGRAMMETRY / MESHES[kind] for kind in ("masked", "whole")
        )
        if masked.is_file() or not whole.is_file():
            return masked if masked.is_file() else None
        say(f"{self.folder}: has no {masked.name}, so {whole.name} is used, as in MAROON's code")
        return whole

    def transform(self) -> Transform | None:
        """Return the transform from the photo frame to handbench's radar frame, with a note that
        says how the handedness of MAROON's radar frame was found. None if there is no
        alignment.json."""
        file, hand = self.alignment, self.handedness
        return (
            replace(load_alignment(file, mirrored=hand.mirrored), note=hand.note) if file else None
        )

    @property
    def handedness(self) -> Handedness:
        """Whether the x axis of the capture's radar frame is opposite to handbench's, and how that
        was found. Without an alignment.json, it is taken to be opposite, as in MAROON's code."""
        return _handedness(self, self.key(1))

    def warnings(self) -> list[str]:
        """Return a warning if the matrix in alignment.json has no reflection, or does not put the
        surface where the radar measures one; otherwise an empty list."""
        hand = self.handedness
        return [f"{ALIGNMENT}: {hand.note}; {CHECK_SIGNS}"] if hand.suspect else []

    def sensors(self) -> dict[str, OtherSensor]:
        """Return the other depth sensors, by name, that have both pictures in the capture's folder
        and a matrix in alignment.json."""
        file, mirrored = self.alignment, lambda: self.handedness.mirrored
        here = [name for name in LENSES if pictures(self.folder, name, "depth")]
        known = read_table(file) if file and here else {}
        return {
            n: OtherSensor(self.folder, n, file, mirrored)
            for n in here
            if file and f"{n}2radar" in known
        }

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
        turned = bool({"xmin", "xmax"} & self.metadata.mask_bb.keys()) and self.handedness.mirrored
        x_m, y_m = np.meshgrid(-depth.x_m if turned else depth.x_m, depth.y_m)
        for axis, values_m in zip("xyz", (x_m, y_m, depth.z_m), strict=True):
            low_m, high_m = self._bounds_m(axis)
            with np.errstate(invalid="ignore"):
                found &= (values_m >= low_m) & (values_m <= high_m)
        return found

    def key(self, frames: int | None = None) -> str:
        """Return a hash of all files that a run reads: descriptions, masks, the mesh (without one,
        the photographs), and the first `frames` frames (None: all) of the radar and the other
        sensors."""
        files = sorted(self._file(0).parent.glob(self._file(0).name.replace("000000", 6 * "[0-9]")))
        described = [self.folder / METADATA, self.alignment, self.radar / VOLUMES]
        for sensor in LENSES:
            depths, masks = (pictures(self.folder, sensor, kind) for kind in ("depth", "mask"))
            described += [self.folder / sensor / VOLUMES, *depths[:frames], *masks[-1:]]
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
        about = self.metadata
        near = NEAR_ZMIN_M if about.distance_meters == 0.3 else -np.inf
        low, high = {"z": (near, ZMAX_M)}.get(axis, (-np.inf, np.inf))
        high = (
            about.mask_3d_threshold if axis == "z" and about.mask_3d_threshold is not None else high
        )
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
        frame = read_table(file, f"MAROON's {VOLUMES}").get(f"{0:06d}", {}) if file.exists() else {}
        distance_m = self.metadata.distance_meters
        if isinstance(frame, dict) and "volume" in frame:
            box = self._axes(file, frame["volume"])
        elif distance_m is not None:
            ends = {
                end: round(distance_m + BEHIND_M[end], ROUNDED) for end in ("start_m", "stop_m")
            }
            box = {"z": BEHIND_M | ends}
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
        if low[0] != -high[0] and self.handedness.mirrored:
            low[0], high[0] = -high[0], -low[0]
        ends = zip(
            low.round(ROUNDED).tolist(),
            high.round(ROUNDED).tolist(),
            count.astype(int).tolist(),
            strict=True,
        )
        return {
            axis: {
                "start_m": a,
                "stop_m": b,
                "step_m": (b - a) / (n - 1) if n > 1 and b > a else BEHIND_M["step_m"],
            }
            for axis, (a, b, n) in zip("xyz", ends, strict=True)
        }


@cache
def _handedness(capture: MaroonCapture, key: str) -> Handedness:
    """Find out whether the x axis of a capture's radar frame is opposite to handbench's, from its
    mesh or, without one, from another sensor.

    key: hash of the capture's content; results are cached in this process by capture and key.
    """
    file, mesh_file = capture.alignment, capture.mesh()
    if file is None:
        return Handedness(True, "")
    found: dict[str, Callable[[], Triangles]] = {
        name: sensor.triangles for name, sensor in capture.sensors().items()
    }
    if mesh_file is not None:
        found = {PHOTOGRAMMETRY: lambda: read_triangles(mesh_file)[:2]}
    source, surface = next(iter(found.items()), (PHOTOGRAMMETRY, None))
    return handedness_of(file, source, surface, lambda: capture.echoes(1))


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
