"""Photographs to a metric mesh."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np
from pydantic import Field

from calibration import Config, HandbenchError, atomic_folder, atomic_path, say, track, write_json
from groundtruth.board import Board, load_board
from groundtruth.cameras import Camera, load_cameras
from groundtruth.frame import Scale, apply, board_from_model, poses_from_model, registered
from groundtruth.fusion import Cloud
from groundtruth.markers import Corners, detect_corners, focal_length_px, require_board
from groundtruth.photos import Photo, find_photos
from groundtruth.sfm import structure_from_motion

if TYPE_CHECKING:
    import open3d as o3d
    import pycolmap

SUMMARY_VERSION = 1


class Effort(NamedTuple):
    """Depth maps have 1 / shrink of the photographs' resolution; iterations of PatchMatch."""

    shrink: int
    iterations: int


EFFORT = {"draft": Effort(4, 2), "normal": Effort(2, 3), "high": Effort(1, 4)}


class Options(Config):
    """How to reconstruct.

    cameras: a cameras.json (default: the one in the photographs' folder, if any). intrinsics: fx, fy, cx, cy in pixels
    of the one camera that took all photographs. board: a board.toml (default as cameras). unscaled: go on without a
    metric scale. box_m: xmin, ymin, zmin, xmax, ymax, zmax of the region of interest in the mesh's frame; it cuts away
    the surroundings and saves most of the time. components: parts of the surface that are kept.
    """

    cameras: Path | None = None
    intrinsics: tuple[float, float, float, float] | None = None
    board: Path | None = None
    unscaled: bool = False
    quality: Literal["draft", "normal", "high"] = "normal"
    box_m: tuple[float, float, float, float, float, float] | None = None
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


@dataclass(frozen=True)
class Result:
    """A mesh in the photo frame (metres, unless the scale's source is "none"), the fused cloud it was made of, and how
    well the photographs fit together."""

    mesh: o3d.geometry.TriangleMesh
    points_m: np.ndarray
    normals: np.ndarray
    cameras: tuple[Camera, ...]
    photographs: int
    reprojection_error_px: float
    scale: Scale
    pixel_m: float
    seconds: dict[str, float]

    def summary(self) -> dict[str, object]:
        """Plain values for `summary.json`."""
        return {
            "registered": len(self.cameras),
            "photographs": self.photographs,
            "reprojection_error_px": self.reprojection_error_px,
            "scale": asdict(self.scale),
            "pixel_m": self.pixel_m,
            "points": len(self.points_m),
            "vertices": len(self.mesh.vertices),
            "triangles": len(self.mesh.triangles),
            "seconds": {stage: round(seconds, 2) for stage, seconds in self.seconds.items()},
        }


def reconstruct(photos: str | Path, options: Options, workdir: str | Path | None = None) -> Result:
    """Photographs in a folder to a mesh.

    workdir receives `sparse/` (COLMAP model in the mesh's frame and scale), `dense.ply` (the fused cloud) and
    `summary.json` (resolved options, figures, seconds). Raises HandbenchError when photographs are missing or broken,
    do not register, carry no scale, or show too little surface.
    """
    clock = Clock()
    with clock("inputs"):
        pictures, options, cameras, board = _inputs(Path(photos), options)
    with clock("markers"):
        corners = _find_board(pictures, board)
    with clock("sfm"), tempfile.TemporaryDirectory(prefix="handbench-") as scratch:
        model = structure_from_motion(
            pictures,
            Path(scratch),
            cameras=cameras,
            intrinsics=options.intrinsics,
            focal_px=_focal_lengths(pictures, corners, board),
            seed=options.seed,
        )
    with clock("frame"):
        scale = _to_metric_frame(model, corners, board, cameras, options)
    with clock("dense"):
        cloud = _dense_cloud(pictures, model, options)
    with clock("mesh"):
        mesh = _surface(cloud, options)
    result = Result(
        mesh,
        cloud.points_m,
        cloud.normals,
        tuple(_camera(image) for image in registered(model)),
        len(pictures),
        model.compute_mean_reprojection_error(),
        scale,
        cloud.pixel_m,
        clock.seconds,
    )
    if workdir is not None:
        _write(Path(workdir), result, model, options)
    return result


class Clock:
    """Seconds per stage."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}

    @contextmanager
    def __call__(self, stage: str) -> Iterator[None]:
        start = time.perf_counter()
        yield
        self.seconds[stage] = time.perf_counter() - start


def _inputs(
    folder: Path, options: Options
) -> tuple[tuple[Photo, ...], Options, tuple[Camera, ...] | None, Board | None]:
    """Everything that can be refused before the work starts."""
    options.box()
    pictures = find_photos(folder)
    beside = {"cameras": folder / "cameras.json", "board": folder / "board.toml"}
    if options.intrinsics is not None:
        del beside["cameras"]
    found = {key: path for key, path in beside.items() if getattr(options, key) is None and path.is_file()}
    options = options.model_copy(update=found)
    if options.cameras is not None and options.intrinsics is not None:
        raise HandbenchError("cameras and intrinsics: both are given; give the intrinsics in one of them")
    cameras = None if options.cameras is None else _cameras_of(pictures, options.cameras)
    board = None if options.board is None else load_board(options.board)
    posed = cameras is not None and sum(c.R is not None and c.t is not None for c in cameras) >= 3
    if board is None and not posed and not options.unscaled:
        raise HandbenchError(
            f"{folder}: nothing gives the scale: no board.toml and no camera poses (R, t in cameras.json); "
            "add --board or --cameras, or give --unscaled for a mesh of arbitrary size"
        )
    return pictures, options, cameras, board


def _cameras_of(pictures: tuple[Photo, ...], path: Path) -> tuple[Camera, ...]:
    """The file's camera of each photograph."""
    known = {camera.name: camera for camera in load_cameras(path)}
    for photo in pictures:
        camera = known.get(photo.name)
        if camera is None:
            raise HandbenchError(f"{path}: has no camera for {photo.name}; add one, or remove the photograph")
        if (camera.width, camera.height) != (photo.width, photo.height):
            raise HandbenchError(
                f"{path}: {photo.name} is {camera.width} × {camera.height} there, the photograph has {photo.width} × "
                f"{photo.height} pixels; calibrate at the size of the stored pixels (EXIF orientation is ignored)"
            )
        camera.colmap()
    return tuple(known[photo.name] for photo in pictures)


def _find_board(pictures: tuple[Photo, ...], board: Board | None) -> dict[str, Corners]:
    if board is None:
        return {}
    return require_board({p.name: detect_corners(p, board) for p in track(pictures, "markers")}, board)


def _focal_lengths(
    pictures: tuple[Photo, ...], corners: dict[str, Corners], board: Board | None
) -> dict[str, float]:
    """A focal length for each photograph, from the board or, where it shows too little of it, from the others."""
    if board is None:
        return {}
    found = {photo.name: focal_length_px(photo, corners[photo.name], board) for photo in pictures}
    known = [focal for focal in found.values() if focal is not None]
    return {name: focal or float(np.median(known)) for name, focal in found.items()} if known else {}


def _to_metric_frame(
    model: pycolmap.Reconstruction,
    corners: dict[str, Corners],
    board: Board | None,
    cameras: tuple[Camera, ...] | None,
    options: Options,
) -> Scale:
    if board is not None:
        matrix, scale = board_from_model(model, corners, board)
    elif not options.unscaled:
        matrix, scale = poses_from_model(model, cameras or ())
    else:
        return Scale("none")
    apply(model, matrix)
    return scale


def _dense_cloud(pictures: tuple[Photo, ...], model: pycolmap.Reconstruction, options: Options) -> Cloud:
    from groundtruth.dense import depth_maps, open_views
    from groundtruth.fusion import fuse
    from groundtruth.mesh import clean

    effort = EFFORT[options.quality]
    views, tracks, points_m = open_views(pictures, model, effort.shrink, options.box())
    maps = depth_maps(views, tracks, points_m, effort.iterations, options.seed)
    return clean(fuse(maps, options.box()))


def _surface(cloud: Cloud, options: Options) -> o3d.geometry.TriangleMesh:
    from groundtruth.mesh import surface

    return surface(cloud, options.components, options.box())


def _camera(image: pycolmap.Image) -> Camera:
    camera, pose = image.camera, image.cam_from_world()
    return Camera(
        name=image.name,
        width=camera.width,
        height=camera.height,
        model=camera.model_name,
        params=tuple(camera.params.tolist()),
        R=tuple(map(tuple, pose.rotation.matrix().tolist())),
        t=tuple(pose.translation.tolist()),
    )


def _write(workdir: Path, result: Result, model: pycolmap.Reconstruction, options: Options) -> None:
    from calibration.meshes import load_open3d

    o3d = load_open3d()
    with atomic_folder(workdir / "sparse") as folder:
        model.write_binary(folder)
    points = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(result.points_m))
    points.normals = o3d.utility.Vector3dVector(result.normals)
    with atomic_path(workdir / "dense.ply") as temporary:
        if not o3d.io.write_point_cloud(str(temporary), points):
            raise OSError(f"open3d could not write {workdir / 'dense.ply'}")
    write_json(
        workdir / "summary.json",
        {"version": SUMMARY_VERSION, "options": options.model_dump(mode="json"), **result.summary()},
    )
    say(f"{workdir}: sparse/, dense.ply and summary.json written")
