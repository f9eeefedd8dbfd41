"""Captures of the data set MAROON (Wirth et al. 2024, arXiv 2411.00527), read from its own folders.
One object at one distance is a capture.

    OBJECT/30/  metadata.json  alignment.json
                radar_72.0_82.0_128/  calibration.json
                radar_72.0_82.0_128/calibrated_data/  000000.npy  000000_emptyfiltered.npy …
                photogrammetry/  mesh.obj  mesh_masked.obj  rgb/ …

MAROON's code uses a left-handed radar frame (x to the right, y up, z away), so that p_handbench =
diag(−1, 1, 1) p_maroon, and the matrix of `alignment.json` from the right-handed photogrammetry
contains a reflection. Without one, the radar frame is taken to be handbench's already. Under each
key `SOURCE2DEST`, this file has a 4×4 matrix, row by row, that maps columns [p, 1], metres. Boxes
and transforms are converted here; the antennas need no conversion.

A radar frame is a numpy file with a pickled dictionary, read without running any code in it. The
echoes `xr`, by MAROON's public code, are [receiver, transmitter, frequency] of 96 × 96 antennas.
Antennas 1 to 94 of both are used; these are `radar.data.arrays.qar50` in its order. MAROON images
them by Σ xr·e^{+j2πfτ}, so an echo is e^{−j2πfτ}, as in handbench, and nothing is conjugated. Pairs
of antennas that the radar could not use may be zero, and stay zero.

A pickle is a program that may call any function that it can name. Here it can name numpy's arrays,
types and scalars only, and gets a description in place of each; the numbers are then made from the
bytes in the descriptions, so that no array is larger than its file. Python's own unpickler is used,
because the one in C reserves as much memory as a number in the file says.
"""

import pickle
import pickletools
import re
from dataclasses import dataclass
from functools import cached_property
from io import BytesIO
from itertools import islice
from operator import index
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import AliasPath, Field

from handbench.bench.datasets.native import EMPTY_FILTERED, CaptureFile, NativeCapture
from handbench.calibration.transforms import Matrix, Transform
from handbench.radar.data.arrays import qar50
from handbench.radar.data.capture import RadarCapture, as_complex64
from handbench.radar.data.depthmap import DepthMap
from handbench.support.config import Config, ConfigT, parse
from handbench.support.errors import HandbenchError
from handbench.support.files import (
    MOST_STEPS,
    PICKLE_BYTES,
    RAW_JSON_BYTES,
    RAW_VALUES,
    content_hash,
    inside,
    read_bytes,
    read_json,
)
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
ALIGNMENT, KEY = "alignment.json", "photogrammetry2radar"
# largest element by which a matrix may miss its rotation: without a message, and at all
ROUNDING, TOO_CROOKED = (1e-6, 1e-3)
MIRROR_X = np.diag([-1.0, 1.0, 1.0, 1.0])
ANTENNAS, USED = 96, slice(1, 95)
KEYS = ("fvec", "xr")
WHAT = f"a radar frame of MAROON (a pickled dictionary with numbers {' and '.join(KEYS)})"
CORES = ("numpy.core.multiarray", "numpy._core.multiarray")  # before numpy 2, and since
NAMES = {
    *(("numpy", "dtype"), ("numpy", "ndarray")),
    *((core, name) for core in CORES for name in ("_reconstruct", "scalar")),
}

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


class Alignment(Config, extra="ignore"):
    """The used part of an `alignment.json`."""

    photogrammetry2radar: Matrix


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
        folder = self.radar / FRAMES
        ending = f"_{EMPTY_FILTERED}.npy" if self.empty_filtered else ".npy"
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


def load_part(model: type[ConfigT], path: Path) -> ConfigT:
    """Read the used part of one of MAROON's JSON files, which also hold intermediate data. Raises
    HandbenchError for a file that is missing or too large, or has wrong values."""
    content = read_json(path, f"MAROON's {path.name}", RAW_VALUES, RAW_JSON_BYTES)
    return parse(model, content, str(path))


def load_alignment(path: Path) -> Transform:
    """Read the transform from the frame of the photographs to handbench's radar frame from an
    alignment.json. It has no covariance.

    The matrix is replaced by the nearest rotation (polar decomposition) times the mean stretch, and
    a small change is printed. Raises HandbenchError unless the matrix is a finite 4×4 similarity.
    """
    matrix = load_matrix(path)
    if is_mirrored(matrix):
        matrix = MIRROR_X @ matrix
    u, stretch, vt = np.linalg.svd(matrix[:3, :3])
    scale, straight = float(stretch.mean()), np.eye(4)
    straight[:3, :3], straight[:3, 3] = scale * (u @ vt), matrix[:3, 3]
    crooked = float(np.abs(matrix - straight).max())
    if crooked >= TOO_CROOKED * scale:
        raise HandbenchError(
            f"{path}: '{KEY}' differs by {crooked:.2g} from a rotation with one scale; expected "
            f"less than {TOO_CROOKED:g} in any element; download the file again, or correct it"
        )
    if crooked > ROUNDING:
        say(
            f"{path}: '{KEY}' differs by {crooked:.1e} from a rotation, so the nearest rotation "
            "is used"
        )
    return Transform("photo", "radar", straight)


def is_mirrored(matrix: np.ndarray) -> bool:
    """Tell whether x of the radar frame of an alignment.json's matrix is opposite to handbench's:
    whether the matrix contains a reflection."""
    return bool(np.linalg.det(matrix[:3, :3]) < 0)


def load_matrix(path: Path) -> np.ndarray:
    """Read the matrix [4, 4] of an alignment.json. Raises HandbenchError for other numbers."""
    return np.reshape(load_part(Alignment, path).photogrammetry2radar, (4, 4))


def read_frame(file: Path) -> tuple[np.ndarray, np.ndarray]:
    """Read a radar frame of MAROON from its file `calibrated_data/NNNNNN.npy`, and bring its axes
    into handbench's order: samples [f, tx, rx], complex64, and their frequencies [f], Hz. Raises
    HandbenchError for any other file."""
    fvec, xr = read_numbers(file)
    expected = ANTENNAS, ANTENNAS, fvec.size
    if xr.shape != expected:
        raise HandbenchError(f"{file}: 'xr' is {xr.shape}; expected {expected} [rx, tx, f]")
    return as_complex64(xr[USED, USED].transpose(2, 1, 0)), fvec.ravel()


def read_numbers(path: Path) -> list[np.ndarray]:
    """Read the numbers under KEYS in the dictionary of a pickled .npy file, without calling any
    function that the file names. Raises HandbenchError for a file without them."""
    content = read_bytes(path, WHAT, PICKLE_BYTES)
    try:
        stream = BytesIO(content)
        np.lib.format.read_magic(stream)
        np.lib.format.read_array_header_1_0(stream)
        start = stream.tell()
        if any(islice(pickletools.genops(stream), MOST_STEPS, None)):
            raise ValueError("its pickle has too many steps")
        stream.seek(start)
        [held] = _Unpickler(stream).load().state[-1]
        return [_array(held[key]) for key in KEYS]
    except Exception as error:  # broken pickles raise whatever the opcode at hand stumbles over
        reason = str(error)[:200] if isinstance(error, ValueError) else "its pickle is damaged"
        raise HandbenchError(
            f"{path}: was not read ({reason}); expected {WHAT}; download it again"
        ) from error


class _Described:
    """One of numpy's objects as a pickle describes it: the arguments of the function that makes it,
    and its state."""

    def __init__(self, *arguments: Any) -> None:
        self.arguments, self.state = arguments, ()

    def __setstate__(self, state: Any) -> None:
        self.state = state


class _Unpickler(pickle._Unpickler):
    """An unpickler that knows numpy's arrays, types and scalars only."""

    def find_class(self, module: str, name: str) -> type[_Described]:
        if (module, name) not in NAMES:
            raise ValueError(f"it uses {module}.{name}, which is not allowed")
        return _Described

    def load_reduce(self: Any) -> None:
        """Describe the object that the topmost two of the stack, a function and its arguments,
        make. Python's error for others would print them, which a few bytes can make endless."""
        arguments, function = self.stack.pop(), self.stack.pop()
        if function is not _Described or not isinstance(arguments, tuple):
            raise ValueError("it calls something else than numpy's functions")
        self.stack.append(_Described(*arguments))

    dispatch = pickle._Unpickler.dispatch | {pickle.REDUCE[0]: load_reduce}


def _array(value: Any) -> np.ndarray:
    """Make the array that a pickle describes. Raises an error if it is not one of numbers, or if
    its bytes do not have its shape."""
    _, shape, dtype, by_column, content = value.state
    number = np.dtype("".join((dtype.state[1], dtype.arguments[0])))  # such as "<" and "c8"
    if number.kind not in "iufc":
        raise ValueError("it has an array of other objects than numbers")
    numbers = np.frombuffer(content, number)
    return numbers.reshape(tuple(map(index, shape)), order="F" if by_column else "C")
