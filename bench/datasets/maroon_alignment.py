"""MAROON's file of transforms, `alignment.json` (Wirth et al. 2024, arXiv 2411.00527), and the
depth sensors that it relates to the radar.

Under each key `SOURCE2DEST`, the file has a 4×4 matrix, row by row, that maps columns [p, 1] from
one frame to another. The frames are those of the sensors `radar`, `photogrammetry`, `kinect`,
`realsense` and `zed`, and a common `world`. Units are metres in the frames of radar and
photogrammetry, and millimetres in those of the cameras.

MAROON's code uses a left-handed radar frame (x to the right, y up, z away), so that p_handbench =
diag(−1, 1, 1) p_maroon, and a matrix from a right-handed sensor contains a reflection. A matrix
without a reflection has two explanations: the radar frame is handbench's already, or the sensor's
points are a mirror image. Both put the points in front of the radar, one of them mirrored in x, so
the radar's own depth map decides between them. docs/maroon.md has the evidence.
"""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from handbench.calibration.transforms import Transform, checked_numbers, identity, load_transform
from handbench.groundtruth.cameras.cameras import Camera
from handbench.groundtruth.mesh.depth import depth_on_grid
from handbench.groundtruth.mesh.mesh_files import mesh
from handbench.radar.data.capture import RadarCapture
from handbench.radar.data.grid import PixelGrid
from handbench.radar.methods.registry import method
from handbench.support.config import suggest
from handbench.support.errors import HandbenchError
from handbench.support.files import read_json
from handbench.support.limits import RAW_JSON_BYTES, RAW_VALUES
from handbench.support.pictures import open_picture
from handbench.support.progress import say

ALIGNMENT = "alignment.json"
# largest element by which a matrix may miss its rotation: without a message, and at all
ROUNDING, TOO_CROOKED = (1e-6, 1e-3)
FARTHEST_M = 10.0  # largest distance of two sensors of the set-up; more are millimetres
MIRROR_X = np.diag([-1.0, 1.0, 1.0, 1.0])
FRAMES = {"photogrammetry": "photo"}  # ours for theirs; the others keep their names
PIXELS = {"start_m": -0.15, "stop_m": 0.15, "step_m": 0.003}  # about x = 0
# 3-FSK, a ninth of the paper's pixels
LOOK = {"x": PIXELS, "y": PIXELS, "coarse_filter_px": 3, "fine_filter_px": 1}
FAR_MM = 20.0  # off the nearer reading the radar's depth is of something else
NEAR_MM = 5.0  # off the surface, with the mistake in the matrix undone
# by which the reading that the matrix does not suggest must fit better; below, the object is
# symmetric
CLEAR_MM = 0.5
# sensor → its lens in calibration.json (Kinect: own form)
LENSES = {"kinect": "", "realsense": "rgb", "zed": "left"}
SIDES = {"zed": "left"}  # sensor → further folder of its pictures
# step in depth over which neighbours are joined (code/main.py: triangulation_threshold)
LONGEST_MM = 10.0
# Kinect's modes NFOV_UNBINNED and 1080P, which their code asks for: sides of the whole picture,
# corner and sides of it.
MODES = {
    "D0": ((1024, 1024), (192, 180), (640, 576)),
    "PV0": ((1920, 1440), (0, 180), (1920, 1080)),
}
LOCATION, MODEL = "CALIBRATION_CameraLocation", "CALIBRATION_LensDistortionModelBrownConrady"
# FULL_OPENCV's parameters among the factory's 14
BROWN_CONRADY = [0, 1, 2, 3, 4, 5, 13, 12, 6, 7, 8, 9]
Triangles = tuple[np.ndarray, np.ndarray]  # vertices [n, 3] and faces [m, 3]


def load_alignment(
    path: str | Path, source: str = "photogrammetry", mirrored: bool | None = None
) -> Transform:
    """Read the transform from a sensor's frame to handbench's radar frame (metres) from an
    alignment.json. It has no covariance.

    source: name of the sensor in the file; the frame of `photogrammetry` is called `photo` in the
    result. The sensor's points keep the unit that the matrix in the file expects; the transform's
    scale converts it. mirrored: True if x of the file's radar frame is opposite to handbench's
    (None: it is if the matrix contains a reflection). If the matrix disagrees with `mirrored`, the
    sensor's points are a mirror image, and the transform's scale is negative.

    The matrix is replaced by the nearest rotation times a scale. Raises HandbenchError for an
    unknown source, and unless the matrix is a finite 4×4 similarity.
    """
    content = read_table(path)
    key = f"{source}2radar"
    if key not in content:
        known = [name.removesuffix("2radar") for name in content if name.endswith("2radar")]
        raise HandbenchError(f"{path}: has no '{key}'; {suggest(source, known)}")
    matrix = checked_numbers(path, key, content[key], [(4, 4), (16,)]).reshape(4, 4)
    if np.abs(matrix[3] - [0, 0, 0, 1]).max() > ROUNDING:
        raise HandbenchError(
            f"{path}: the last row of '{key}' is {matrix[3].tolist()}; expected [0, 0, 0, 1]"
        )
    if np.linalg.norm(matrix[:3, 3]) > FARTHEST_M:
        raise HandbenchError(
            f"{path}: '{key}' has a shift of {np.linalg.norm(matrix[:3, 3]):.4g} m; expected at "
            f"most {FARTHEST_M:g} m; check that the unit is metres"
        )
    reflects = bool(np.linalg.det(matrix[:3, :3]) < 0)
    flip = MIRROR_X if (reflects if mirrored is None else mirrored) else np.eye(4)
    return Transform(FRAMES.get(source, source), "radar", _straight(path, key, flip @ matrix))


def read_table(path: str | Path, what: str = "MAROON's alignment.json") -> dict[str, Any]:
    """Read one of MAROON's JSON files as a dict. what: description of the file for messages. Raises
    HandbenchError for a file that is too large, or whose content is not a table of keys and
    values."""
    # it also holds intermediate data of the calibration
    content = read_json(path, what, RAW_VALUES, RAW_JSON_BYTES)
    if not isinstance(content, dict):
        raise HandbenchError(f"{path}: is not a table; expected {what}; copy it again")
    return content


def _straight(path: str | Path, key: str, matrix: np.ndarray) -> np.ndarray:
    """Return a matrix [4, 4] with its linear part replaced by the nearest rotation or reflection
    (polar decomposition) times the mean stretch.

    A small change is printed; path, key: the matrix's file and key, for messages. Raises
    HandbenchError if the change would be large.
    """
    u, stretch, vt = np.linalg.svd(matrix[:3, :3])
    scale, rotation = float(stretch.mean()), u @ vt
    crooked = float(np.abs(matrix[:3, :3] / scale - rotation).max()) if scale > 0 else np.inf
    if crooked > TOO_CROOKED:
        raise HandbenchError(
            f"{path}: '{key}' differs by {crooked:.2g} from a rotation with one scale; expected "
            f"at most {TOO_CROOKED:g} in any element; download the file again, or correct it"
        )
    if crooked > ROUNDING:
        say(
            f"{path}: '{key}' differs by {crooked:.1e} from a rotation, so the nearest rotation "
            "is used"
        )
    straight = matrix.copy()
    straight[:3, :3] = scale * rotation
    straight[3] = [0, 0, 0, 1]
    return straight


class Handedness(NamedTuple):
    """Handedness of a radar frame.

    mirrored: True if its x axis is opposite to handbench's. note: how that was found. suspect: True
    if the matrix in alignment.json has no reflection, or does not put the surface where the radar
    measures one.
    """

    mirrored: bool
    note: str
    suspect: bool = False


def handedness_of(
    path: Path,
    source: str,
    surface: Callable[[], Triangles] | None,
    echoes: Callable[[], RadarCapture],
) -> Handedness:
    """Find the handedness of the radar frame in an alignment file, and print it.

    It follows from whether the file's matrix contains a reflection, and is checked by the radar's
    depth map: if the mirror image of the surface fits the radar's depths much better than the
    surface, the opposite handedness is taken. path: the file. source: the sensor. surface: function
    that returns what the sensor measured, in its own frame (None: nothing to check with). echoes:
    function that returns the capture's echoes.
    """
    mirrored = load_alignment(path, source, mirrored=False).scale < 0
    note, suspect = f"{source}2radar has {'a' if mirrored else 'no'} reflection", not mirrored
    try:
        if surface is None:
            raise HandbenchError("there is nothing to check it by")
        (vertices, faces), seen, carried = surface(), echoes(), load_alignment(path, source)
        own_mm, other_mm = _off_mm(carried.points(vertices), faces, seen)
        if min(own_mm, other_mm) > FAR_MM:
            suspect = True
            note += (
                f"; the radar's depth is {own_mm:.0f} mm from its surface, and {other_mm:.0f} mm "
                "mirrored"
                if np.isfinite(own_mm)
                else "; its surface is outside the radar's pixels"
            ) + _likely_mistake(carried.matrix, mirrored, (vertices, faces), seen)
        else:
            side = "further off" if other_mm >= own_mm else "nearer to"
            note += (
                f"; mirrored, its surface is {abs(other_mm - own_mm):.1f} mm {side} the radar's "
                "depth"
            )
            if other_mm < min(own_mm - CLEAR_MM, own_mm / 2):
                mirrored, suspect = not mirrored, True
    except HandbenchError as error:
        note += f", which was not checked ({error})"
    note += f": x of its radar frame is {'negated' if mirrored else 'taken as it is'}"
    say(f"{path}: {note}")
    return Handedness(mirrored, note, suspect)


def _likely_mistake(
    matrix: np.ndarray, mirrored: bool, surface: Triangles, echoes: RadarCapture
) -> str:
    """Find a mistake in a matrix that explains why its surface is not where the radar measures one.

    Tried are an inverted matrix, and wrong signs of its rows, columns or shifts. matrix [4, 4]:
    maps the surface to handbench's radar frame. mirrored: True if the file's matrix has a
    reflection. Returns a clause for a message; empty if no mistake explains it.
    """
    flip, (vertices, faces) = MIRROR_X if mirrored else np.eye(4), surface
    undone = {"inverted": flip @ np.linalg.inv(matrix) @ flip}
    for row, axis in enumerate("xyz"):
        sign, shifted = np.eye(4), matrix.copy()
        sign[row, row], shifted[row, 3] = -1, -matrix[row, 3]
        undone[f"with the other sign of {axis} in its shift"] = shifted
        # a reflection less or more: the file's frame then has the other handedness
        undone[f"with the other sign of its column of {axis}"] = MIRROR_X @ matrix @ sign
        undone[f"with the other sign of its row of {axis}"] = MIRROR_X @ sign @ matrix
    off_mm = dict.fromkeys(undone, np.inf)
    for name, each in undone.items():
        with suppress(HandbenchError):  # larger than anything before a radar
            off_mm[name] = _off_mm(vertices @ each[:3, :3].T + each[:3, 3], faces, echoes)[0]
    name = min(off_mm, key=lambda name: off_mm[name])
    off = f"; {name}, the matrix puts it {off_mm[name]:.1f} mm from the radar's depth"
    return off if off_mm[name] < NEAR_MM else ""


def _off_mm(vertices_m: np.ndarray, faces: np.ndarray, echoes: RadarCapture) -> tuple[float, float]:
    """Compute the mean distance in mm from the points of the radar's 3-FSK depth map to a surface,
    and to the surface mirrored in x.

    Both are infinite if the surface is outside the radar's pixels. Raises HandbenchError if the
    depth map is empty.
    """
    from scipy.spatial import KDTree

    chosen, middle_m = method("3fsk"), float(np.median(vertices_m[:, 2]))
    look = LOOK | ({"first_depth_m": middle_m} if middle_m > 0 else {})
    depth = chosen.run(echoes, chosen.configure(look, "handedness"), 0).depth
    z_m = depth.z_m if depth.wrapped is None else np.where(depth.wrapped, np.nan, depth.z_m)
    surface_m = depth_on_grid(mesh(vertices_m, faces), depth.x_m, depth.y_m)
    if not np.isfinite(z_m).any():
        raise HandbenchError("the radar image is empty")
    if not np.isfinite(surface_m).any():
        return np.inf, np.inf
    x_m, y_m = np.meshgrid(depth.x_m, depth.y_m)
    seen_m, *both_m = (
        np.stack([x_m, y_m, one_m], -1)[np.isfinite(one_m)]
        for one_m in (z_m, surface_m, surface_m[:, ::-1])
    )
    own_m, other_m = (float(KDTree(surface).query(seen_m)[0].mean()) for surface in both_m)
    return 1e3 * own_m, 1e3 * other_m


def load_any_transform(file: Path | None) -> Transform:
    """Read a transform to the radar frame from a file in handbench's format or, if the file is
    named alignment.json, in MAROON's.

    file: None returns the identity, for points that are in the radar frame already. Raises
    HandbenchError for a file in neither format.
    """
    if file is None:
        return identity("radar")
    transform = load_alignment(file) if file.name == ALIGNMENT else load_transform(file)
    return transform.require(transform.source, "radar", file)


def pictures(folder: Path, sensor: str, kind: str) -> list[Path]:
    """List the pictures of one kind ("depth" or "mask") of a sensor in a capture's folder, by
    frame."""
    return sorted((folder / sensor / kind / SIDES.get(sensor, "")).glob("[0-9]*.png"))


@dataclass(frozen=True)
class OtherSensor:
    """Another depth sensor in a MAROON capture's folder. Called with a pixel grid, it returns the
    depths that it measured.

    alignment: the file with the matrix from the sensor to the radar. mirrored: function that
    returns whether x of that file's radar frame is opposite to handbench's.
    """

    folder: Path
    name: str
    alignment: Path
    mirrored: Callable[[], bool]

    def __call__(self, grid: PixelGrid, frame: int = 0) -> np.ndarray:
        """Compute the depth z [ny, nx], metres, of the measured surface in handbench's radar frame
        on a pixel grid; NaN where the sensor measured no surface. Raises HandbenchError if the
        frame is missing."""
        points, faces = self.triangles(frame)
        transform = load_alignment(self.alignment, self.name, self.mirrored())
        return depth_on_grid(mesh(transform.points(points), faces), grid.x_m, grid.y_m)

    def triangles(self, frame: int = 0) -> Triangles:
        """Return the surface that the sensor measured in one frame, as vertices [n, 3] and
        triangles [m, 3], cropped to the object if there is a mask.

        The vertices are in the sensor's frame, in the unit that its matrix in alignment.json
        expects. Raises HandbenchError if the frame is missing, or if the pictures do not agree with
        the sensor's calibration.
        """
        from handbench.groundtruth.photos.photos import read_gray

        depths, masks = (pictures(self.folder, self.name, kind) for kind in ("depth", "mask"))
        if not frame < len(depths):
            raise HandbenchError(
                f"{self.folder / self.name}: has {len(depths)} depth pictures, but no frame "
                f"{frame}; copy the capture again"
            )
        counts, mask = _counts(depths[frame]), read_gray(masks[-1]) > 0 if masks else np.array(True)
        content = read_table(
            self.folder / self.name / "calibration.json", f"the cameras of MAROON's {self.name}"
        )
        try:
            depth_mm = counts * 1e3 * _numbers(content.get("capture", {}).get("scale", 1e-3), 1)
            points_mm, seen = (self._kinect if self.name == "kinect" else self._pinhole)(
                depth_mm, mask, content
            )
        except (HandbenchError, KeyError, TypeError, ValueError, AttributeError) as error:
            raise HandbenchError(
                f"{depths[frame].parent}: the depth picture does not fit its calibration.json "
                f"({error}); copy both again"
            ) from error
        scale = load_alignment(self.alignment, self.name).scale
        unit = {-3: 1.0, 0: 1e-3}.get(round(np.log10(scale)))
        if unit is None:
            raise HandbenchError(
                f"{self.alignment}: '{self.name}2radar' has the scale {scale:.3g}; expected 0.001 "
                "(from millimetres) or 1 (from metres)"
            )
        return unit * points_mm, _joined(depth_mm, seen)

    def _pinhole(
        self, depth_mm: np.ndarray, mask: np.ndarray, content: Any
    ) -> tuple[np.ndarray, np.ndarray]:
        """Compute the points of a sensor that is a pinhole camera. depth_mm [height, width]: 0
        where unknown; mask: True on the object; content: of the sensor's calibration.json.

        Returns the points [n, 3] in mm, and the mask [height, width] of their pixels.
        """
        lens, (height, width), seen = (
            content[LENSES[self.name]],
            depth_mm.shape,
            (depth_mm > 0) & mask,
        )
        params = tuple(
            _numbers([lens[key] for key in ("fx", "fy", "cx", "cy")], 4) + [0, 0, 0.5, 0.5]
        )
        camera = Camera(name=self.name, width=width, height=height, model="PINHOLE", params=params)
        return _points(camera, depth_mm, seen), seen

    def _kinect(
        self, depth_mm: np.ndarray, mask: np.ndarray, content: Any
    ) -> tuple[np.ndarray, np.ndarray]:
        """Compute the points of the Kinect. depth_mm [height, width]: 0 where unknown; mask: True
        on the object, at the colour camera's pixels; content: of the sensor's calibration.json.

        Returns the points [n, 3] in mm, and the mask [height, width] of their depth pixels. The
        points are in the frame of the depth camera or of the colour camera, whichever
        alignment.json refers to.
        """
        from scipy.ndimage import map_coordinates

        cameras = {
            c["Location"].removeprefix(LOCATION): c
            for c in content["CalibrationInformation"]["Cameras"]
        }
        depth, colour = (kinect_camera(cameras[place]) for place in MODES)
        rotation, shift_m = (
            _numbers(cameras["PV0"]["Rt"][key], n)
            for key, n in (("Rotation", 9), ("Translation", 3))
        )
        points_mm = _points(depth, depth_mm, seen := depth_mm > 0)
        of_colour_mm = points_mm @ rotation.reshape(3, 3).T + 1e3 * shift_m
        if mask.ndim:
            pixels = np.asarray(colour.colmap().img_from_cam(of_colour_mm)) - 0.5
            kept = map_coordinates(mask.astype(np.uint8), pixels.T[::-1], order=0) > 0
            points_mm, of_colour_mm, seen[seen] = points_mm[kept], of_colour_mm[kept], kept
        space = read_table(self.alignment).get("kinect_calib", {}).get("space", "color")
        return (points_mm if space == "depth" else of_colour_mm), seen


def kinect_camera(factory: dict[str, Any]) -> Camera:
    """Make the camera model of the Kinect's depth or colour camera, in the mode that MAROON uses,
    from its factory calibration. Raises ValueError for a lens model other than the Kinect's."""
    lens, place = factory["Intrinsics"], factory["Location"].removeprefix(LOCATION)
    (wide, high), (left, top), (width, height) = MODES[place]
    if lens["ModelType"] != MODEL:
        raise ValueError(f"the lens model is {lens['ModelType']}; expected {MODEL}")
    cx, cy, fx, fy, *others = _numbers(lens["ModelParameters"], 14)
    params = np.array([fx * wide, fy * high, cx * wide - left, cy * high - top, *others])[
        BROWN_CONRADY
    ]
    return Camera(name=place, width=width, height=height, model="FULL_OPENCV", params=tuple(params))


def _numbers(values: Any, count: int) -> np.ndarray:
    return checked_numbers("its", "numbers", np.reshape(values, -1).tolist(), [(count,)], 1e4)


def _points(camera: Camera, depth_mm: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """Compute the points [n, 3] in the camera's frame, mm, of the n pixels in the mask seen
    [height, width]. depth_mm [height, width]: their depths along z."""
    if depth_mm.shape != (camera.height, camera.width):
        raise ValueError(
            f"a picture has {depth_mm.shape[::-1]} pixels; expected {(camera.width, camera.height)}"
        )
    xy = np.asarray(camera.colmap().cam_from_img(np.argwhere(seen)[:, ::-1] + 0.5))
    return np.concatenate([xy, np.ones((len(xy), 1))], axis=1) * depth_mm[seen, None]


def _joined(depth_mm: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """Join the points of neighbouring pixels to triangles, unless their depths differ by more than
    10 mm (LONGEST_MM). seen [height, width]: mask of the n pixels with a point. Returns triangles
    [m, 3] of point indices."""
    index = np.where(seen, np.cumsum(seen).reshape(seen.shape) - 1, -1)
    corners = np.stack(
        [index[:-1, :-1], index[1:, :-1], index[:-1, 1:], index[1:, 1:]], axis=-1
    ).reshape(-1, 4)
    faces = np.concatenate([corners[:, [0, 1, 2]], corners[:, [3, 2, 1]]])
    faces = faces[(faces >= 0).all(axis=1)]
    return faces[np.ptp(depth_mm[seen][faces], axis=1) <= LONGEST_MM]


def _counts(file: Path) -> np.ndarray:
    """Read the values [height, width] of a gray picture with 16 bits, as float64."""
    with open_picture(file) as image:
        if image.mode != "I;16":
            raise HandbenchError(
                f"{file}: has pixels of mode {image.mode}; expected grey pixels of 16 bits; copy "
                "it again"
            )
        return np.asarray(image, np.float64)
